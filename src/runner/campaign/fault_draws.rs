//! Faults drawn at random: a random half of all kinds, of it some, at random times.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::numbers::{index, log_within, within};
use upm_core::random::Rng;
use upm_sim::faults::{FaultKind, FaultyComponent};

/// Share of schedules without a fault.
const NONE_SHARE: f64 = 0.2;
/// Onset and length of a fault, s.
const ONSET_S: [f64; 2] = [0.01, 20.0];
const LENGTH_S: [f64; 2] = [0.02, 20.0];
/// Share of faults that begin just after the frame that the first plan is made of, and that time, s: planning takes no
/// plate time, and pulses start 1 ms after their frame.
const PLAN_ONSET: [f64; 2] = [0.03, 0.034];
/// Of a job that ends at a known time, share of faults that begin shortly before, and how long before, s.
const LAST_SHARE: f64 = 0.25;
const LAST_S: [f64; 2] = [0.04, 0.3];

/// How faults are drawn.
pub(super) struct FaultDraw {
    /// Most of them.
    most: usize,
    /// All have ended by then, s; `None` where half of them stay.
    until_s: Option<f64>,
}

impl FaultDraw {
    pub fn of(argument: &Value) -> Option<Self> {
        let members = argument.as_object()?;
        let most = members.get("most").map_or(Some(5), Value::as_u64)?;
        let until_s = members.get("until_s").map(Value::as_f64);
        let is_known = members.keys().all(|key| ["most", "until_s"].contains(&key.as_str()));
        let fits = is_known && (1..=8).contains(&most) && until_s.is_none_or(|s| s.is_some_and(|s| s > 0.2));
        fits.then_some(Self { most: most as usize, until_s: until_s.flatten() })
    }
}

/// Sizes that one value of a fault is drawn from: log-uniform, or for indices one of those there are.
enum Size {
    Within(f64, f64),
    EitherSign(f64, f64),
    Whole(f64, f64),
    Other,
}

/// Sizes of the values of a fault; small ones, which are hard to notice, are as likely as large ones.
fn sizes(component: FaultyComponent, kind: FaultKind) -> Vec<Size> {
    use FaultKind as K;
    use Size::{EitherSign, Other, Whole, Within};
    match kind {
        K::Late => vec![Whole(1.0, 30.0)],
        K::Drop | K::Chatter => vec![Within(0.01, 1.0)],
        K::Shift => vec![EitherSign(0.2, 120.0), EitherSign(0.2, 120.0)],
        K::Rotate => vec![EitherSign(0.05, 20.0)],
        K::Exposure => vec![Within(0.05, 2.0)],
        K::Gain if component == FaultyComponent::Light => vec![Within(0.05, 2.0)],
        K::Gain | K::Resonance => vec![Within(0.5, 2.0)],
        K::Flicker => vec![Within(0.5, 120.0)],
        K::Hand => vec![Within(0.02, 0.6)],
        K::Ghost => vec![EitherSign(5.0, 90.0), EitherSign(5.0, 90.0)],
        K::LowPass => vec![Within(20.0, 500.0)],
        K::Clipped => vec![Within(1.0, 40.0)],
        K::Moved => vec![EitherSign(0.5, 30.0), EitherSign(0.5, 30.0)],
        K::Friction => vec![Within(0.2, 5.0)],
        K::Bumped => vec![EitherSign(0.2, 10.0), EitherSign(0.2, 10.0)],
        K::Tilt => vec![EitherSign(0.1, 5.0)],
        K::Oil => vec![EitherSign(5.0, 90.0), EitherSign(5.0, 90.0), Within(5.0, 50.0)],
        K::Hang => vec![Within(0.02, 0.5)],
        K::Skew => vec![EitherSign(0.005, 0.5)],
        K::Swapped => vec![Other, Other],
        _ => Vec::new(),
    }
}

/// Faults of a job with so many parts, in the form of its file; `hold_s` is when it ends, where that is known.
pub(super) fn drawn(draw: &FaultDraw, (parts, hold_s): (u64, Option<f64>), rng: &mut Rng) -> Value {
    let share = |rng: &mut Rng| within(0.0, 1.0, rng);
    if share(rng) < NONE_SHARE {
        return json!([]);
    }
    let mut by_name: BTreeMap<String, Vec<(FaultyComponent, FaultKind)>> = BTreeMap::new();
    for component in components(parts as usize) {
        for kind in component.kinds().filter(|kind| sizes(component, *kind).len() == kind.values().len()) {
            by_name.entry(format!("{} {}", component.class(), kind.code())).or_default().push((component, kind));
        }
    }
    // a draw from half of the kinds meets rare ones more often together (swarm testing)
    let mut names: Vec<_> = by_name.into_values().collect();
    let swarm = names.len() / 2;
    shuffle(&mut names, rng);
    let count = 1 + index(draw.most, rng);
    let mut entries = Vec::new();
    for choices in names.iter().take(swarm).take(count) {
        let (component, kind) = choices[index(choices.len(), rng)];
        let mut from_s = log_within(ONSET_S[0], ONSET_S[1], rng);
        if share(rng) < PLAN_ONSET[0] {
            from_s = PLAN_ONSET[1];
        } else if let Some(end_s) = hold_s.filter(|_| share(rng) < LAST_SHARE) {
            from_s = (end_s - log_within(LAST_S[0], LAST_S[1], rng)).max(ONSET_S[0]);
        }
        let ends = share(rng) < 0.5;
        let mut to_s = ends.then_some(from_s + log_within(LENGTH_S[0], LENGTH_S[1], rng));
        if let Some(until_s) = draw.until_s {
            from_s = from_s.min(until_s - 0.1);
            to_s = Some(to_s.map_or(until_s, |to_s| to_s.clamp(from_s + 0.01, until_s)));
        }
        let values = values(component, kind, parts as usize, rng);
        let thousandths = |s: f64| (s * 1e3).round() / 1e3;
        let mut entry = json!({ "component": component.name(), "kind": kind.code(), "from_s": thousandths(from_s) });
        if let Some(to_s) = to_s {
            entry["to_s"] = thousandths(to_s).into();
        }
        match values[..] {
            [] => {}
            [one] => entry["value"] = one.into(),
            _ => entry["value"] = values.into(),
        }
        entries.push(entry);
    }
    Value::Array(entries)
}

/// All components of a rig with so many parts.
fn components(parts: usize) -> impl Iterator<Item = FaultyComponent> {
    use FaultyComponent as C;
    let single = [C::Camera, C::Light, C::View, C::Coils, C::Plate, C::Device, C::Clock];
    let wired = (0..4).flat_map(|i| [C::Coil(i), C::Accelerometer(i)]);
    let parted = (0..parts).map(C::Part).chain((parts > 1).then_some(C::Parts));
    single.into_iter().chain(wired).chain(parted)
}

fn values(component: FaultyComponent, kind: FaultKind, parts: usize, rng: &mut Rng) -> Vec<f64> {
    let mut others = (0..if component == FaultyComponent::Coils { 4 } else { parts }).collect::<Vec<_>>();
    shuffle(&mut others, rng);
    let value = |size: Size| match size {
        Size::Within(least, most) => log_within(least, most, rng),
        Size::EitherSign(least, most) => log_within(least, most, rng) * [-1.0, 1.0][index(2, rng)],
        Size::Whole(least, most) => log_within(least, most, rng).round(),
        Size::Other => others.pop().unwrap_or_default() as f64,
    };
    sizes(component, kind).into_iter().map(value).map(|value| (value * 1e3).round() / 1e3).collect()
}

/// Brings `items` into a random order (Fisher and Yates).
fn shuffle<T>(items: &mut [T], rng: &mut Rng) {
    (1..items.len()).rev().for_each(|last| items.swap(last, index(last + 1, rng)));
}
