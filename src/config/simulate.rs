use super::fault::{Fault, Faults, Path};
use super::job::known_kind;
use super::place::PlacedPart;
use super::raw_simulate::{PlateMode, RawPulse, RawSimulate};
use super::read::{Origin, parse, text_of};
use super::rig::RigSpec;
use super::room::check_apart;
use crate::geometry::{Twist, Vec2};
use crate::signal::Envelope;
use crate::sim::PartParams;
use crate::units::{m_from_mm, mm_from_m};

/// Most samples put out, over all parts.
const MOST_SAMPLES: f64 = 1e7;

/// A validated open-loop experiment.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulateSpec {
    /// The rig.
    pub rig: RigSpec,
    /// How the plate moves.
    pub plate: PlateMode,
    /// Parts where they start, friction as their kind has it.
    pub parts: Vec<PlacedPart>,
    /// Pulses, one after another.
    pub pulses: Vec<PulseSpec>,
    /// Samples a second put out.
    pub sample_hz: f64,
}

/// One pulse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PulseSpec {
    /// Amplitude T of the plate's pump wave `T (cos wt - ½ cos 2wt)`, its sign included.
    pub pump: Twist,
    /// Outline of the pulse.
    pub envelope: Envelope,
}

impl SimulateSpec {
    /// Reads and validates the experiment file at `path` and the rig it names; every fault is told.
    pub fn load(path: &std::path::Path) -> Result<Self, Vec<Fault>> {
        let text = text_of(path).map_err(|fault| vec![fault])?;
        Self::from_json(&text, &Origin::of_file(path))
    }

    /// Validates the experiment in `text`; every fault is told.
    pub fn from_json(text: &str, origin: &Origin) -> Result<Self, Vec<Fault>> {
        let raw = parse(text, &origin.file)?;
        let mut faults = Faults::of(&origin.file);
        let made = Self::build(raw, origin, &mut faults);
        faults.into_result(made)
    }

    fn build(raw: RawSimulate, origin: &Origin, faults: &mut Faults) -> Option<Self> {
        let root = Path::root();
        for (i, pulse) in raw.pulses.iter().enumerate() {
            check_pulse(pulse, &root.key("pulses").index(i), faults);
        }
        let rig = RigSpec::from_source(raw.rig.clone(), origin, &root.key("rig"), faults)?;
        let parts = placed(&raw, &rig, faults);
        let pulses: Vec<PulseSpec> = raw.pulses.iter().filter_map(|pulse| PulseSpec::of(pulse, &rig)).collect();
        let total_s: f64 = pulses.iter().map(|pulse| pulse.envelope.total_s()).sum();
        let samples = total_s * raw.sample_hz * raw.parts.len() as f64;
        let found = format!("{samples:.0} samples of all parts over {total_s:.3} s");
        faults.demand(samples <= MOST_SAMPLES, &root.key("sample_hz"), found, format!("up to {MOST_SAMPLES:.0}"));
        Some(Self { rig, plate: raw.plate, parts, pulses, sample_hz: raw.sample_hz })
    }
}

impl PulseSpec {
    /// The pulse in SI; `None` for one that is neither rotation nor translation.
    fn of(raw: &RawPulse, rig: &RigSpec) -> Option<Self> {
        let forwards = match (raw.cor_mm, raw.omega_rad_s, raw.direction_deg, raw.speed_mps) {
            (Some(cor_mm), Some(omega_radps), ..) => Twist::about(Vec2::from(cor_mm.map(m_from_mm)), omega_radps),
            (.., Some(direction_deg), Some(speed_mps)) => {
                let (sin, cos) = direction_deg.to_radians().sin_cos();
                Twist::new(speed_mps * cos, speed_mps * sin, 0.0)
            }
            _ => return None,
        };
        let envelope = Envelope {
            attack_s: raw.attack_s.unwrap_or(rig.model.attack_s),
            sustain_s: raw.sustain_s,
            rest_s: raw.rest_s.unwrap_or(rig.model.rest_s),
        };
        Some(Self { pump: forwards * f64::from(raw.rotation), envelope })
    }
}

fn check_pulse(raw: &RawPulse, at: &Path, faults: &mut Faults) {
    let given = [raw.cor_mm.is_some(), raw.omega_rad_s.is_some(), raw.direction_deg.is_some(), raw.speed_mps.is_some()];
    if !matches!(given, [true, true, false, false] | [false, false, true, true]) {
        let names = ["cor_mm", "omega_rad_s", "direction_deg", "speed_mps"];
        let found: Vec<&str> = names.into_iter().zip(given).filter_map(|(name, given)| given.then_some(name)).collect();
        let found = if found.is_empty() { "neither".to_owned() } else { found.join(", ") };
        faults.push(at, found, "cor_mm and omega_rad_s, or direction_deg and speed_mps");
    }
}

fn placed(raw: &RawSimulate, rig: &RigSpec, faults: &mut Faults) -> Vec<PlacedPart> {
    let half_m = 0.5 * rig.model.plate_side_m;
    let mut numbers = vec![0_usize; rig.kinds.len()];
    let (mut parts, mut discs) = (Vec::new(), Vec::new());
    for (i, part) in raw.parts.iter().enumerate() {
        let at = Path::root().key("parts").index(i);
        let Some(kind) = known_kind(&part.kind, rig, &at.key("kind"), faults) else { continue };
        let (Some(spec), Some(number)) = (rig.kinds.get(kind), numbers.get_mut(kind)) else { continue };
        *number += 1;
        let (position_m, radius_m) = (Vec2::from(part.position_mm.map(m_from_mm)), spec.kind.radius_m);
        let at = at.key("position_mm");
        for (k, found) in part.position_mm.into_iter().enumerate() {
            let most_mm = mm_from_m(half_m);
            let allowed = format!("from -{most_mm} to {most_mm} (its centre on the plate)");
            faults.demand(found.abs() <= most_mm, &at.index(k), found, allowed);
        }
        discs.push((position_m, radius_m, at));
        let id = format!("{}-{number}", part.kind);
        let (thickness_m, mass_kg, friction) = (spec.kind.thickness_m, spec.mass_kg, spec.friction);
        parts.push(PlacedPart {
            kind,
            id,
            position_m,
            params: PartParams { radius_m, thickness_m, mass_kg, friction },
        });
    }
    check_apart(&discs, faults);
    parts
}
