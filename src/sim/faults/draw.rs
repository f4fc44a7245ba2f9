//! Random faults by seed, for campaigns.

use rand_pcg::rand_core::Rng as _;

use super::{FaultKind, FaultSpec, FaultyComponent};
use upm_core::random::{Rng, Streams};
use upm_core::signal::{CHANNELS, MOTORS};
use upm_core::time::PlateTime;

/// Share of the draws without a fault.
const NONE: f64 = 0.2;
/// Share of the faults that never end.
const FOR_GOOD: f64 = 0.5;
/// Most faults at once.
const MOST: usize = 5;
/// Ranges of onsets and of lengths, s.
const ONSET_S: [f64; 2] = [0.01, 20.0];
const LENGTH_S: [f64; 2] = [0.02, 20.0];

/// The faults of `seed` for a rig with `parts` parts: a fifth of all seeds has none, the others one to five, from a
/// random half of the vocabulary. Onset, length and size are distributed evenly over their logarithms.
pub fn drawn_faults(seed: u64, parts: usize) -> Vec<FaultSpec> {
    let mut draw = Draw(Streams::new(seed).stream("drawn faults"));
    if draw.share() < NONE {
        return Vec::new();
    }
    let vocabulary: Vec<(FaultyComponent, FaultKind)> =
        components(parts).flat_map(|c| c.kinds().map(move |kind| (c, kind))).collect();
    let half: Vec<(FaultyComponent, FaultKind)> = vocabulary.into_iter().filter(|_| draw.share() < 0.5).collect();
    if half.is_empty() {
        return Vec::new();
    }
    let count = 1 + draw.below(MOST);
    (0..count)
        .map(|_| {
            let (component, kind) = half[draw.below(half.len())];
            let values = draw.values(kind, component, parts);
            let from_s = draw.log_uniform(ONSET_S);
            let to_s = (draw.share() >= FOR_GOOD).then(|| from_s + draw.log_uniform(LENGTH_S));
            let milliseconds = |s: f64| PlateTime::from_secs((s * 1e3).round() * 1e-3);
            FaultSpec { component, kind, values, from: milliseconds(from_s), to: to_s.map(milliseconds) }
        })
        .collect()
}

fn components(parts: usize) -> impl Iterator<Item = FaultyComponent> {
    use FaultyComponent::{Accelerometer, Coil, Part, Parts};
    let numbered = (0..MOTORS).map(Coil).chain((0..CHANNELS).map(Accelerometer)).chain((0..parts).map(Part));
    FaultyComponent::SINGLE.into_iter().chain(numbered).filter(move |component| parts > 1 || *component != Parts)
}

struct Draw(Rng);

impl Draw {
    /// Uniform from 0 to 1.
    fn share(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 * 2f64.powi(-53)
    }

    /// Uniform whole number below `count`.
    fn below(&mut self, count: usize) -> usize {
        ((self.share() * count as f64) as usize).min(count.saturating_sub(1))
    }

    fn log_uniform(&mut self, [least, most]: [f64; 2]) -> f64 {
        least * libm::pow(most / least, self.share())
    }

    /// Value in `range` with a random sign.
    fn signed(&mut self, range: [f64; 2]) -> f64 {
        let size = self.log_uniform(range);
        if self.share() < 0.5 { -size } else { size }
    }

    /// Plausible values, to three decimals.
    fn values(&mut self, kind: FaultKind, component: FaultyComponent, parts: usize) -> [f64; 3] {
        let values = match kind {
            FaultKind::Late => [self.log_uniform([1.0, 30.0]).round(), 0.0, 0.0],
            FaultKind::Drop | FaultKind::Chatter => [self.log_uniform([0.01, 1.0]), 0.0, 0.0],
            FaultKind::Hand => [self.log_uniform([0.02, 0.6]), 0.0, 0.0],
            FaultKind::Shift => [self.signed([0.2, 120.0]), self.signed([0.2, 120.0]), 0.0],
            FaultKind::Rotate => [self.signed([0.05, 20.0]), 0.0, 0.0],
            FaultKind::Gain | FaultKind::Resonance => [self.log_uniform([0.5, 2.0]), 0.0, 0.0],
            FaultKind::Exposure => [self.log_uniform([0.05, 2.0]), 0.0, 0.0],
            FaultKind::Friction => [self.log_uniform([0.2, 5.0]), 0.0, 0.0],
            FaultKind::Flicker => [self.log_uniform([0.5, 120.0]), 0.0, 0.0],
            FaultKind::LowPass => [self.log_uniform([20.0, 500.0]), 0.0, 0.0],
            FaultKind::Clipped => [self.log_uniform([1.0, 40.0]), 0.0, 0.0],
            FaultKind::Moved => [self.signed([0.5, 30.0]), self.signed([0.5, 30.0]), 0.0],
            FaultKind::Bumped => [self.signed([0.2, 10.0]), self.signed([0.2, 10.0]), 0.0],
            FaultKind::Tilt => [self.signed([0.1, 5.0]), 0.0, 0.0],
            FaultKind::Skew => [self.signed([0.005, 0.5]), 0.0, 0.0],
            FaultKind::Hang => [0.1, 0.0, 0.0],
            FaultKind::Ghost => [self.signed([5.0, 100.0]), self.signed([5.0, 100.0]), 0.0],
            FaultKind::Oil => [self.signed([5.0, 100.0]), self.signed([5.0, 100.0]), self.log_uniform([5.0, 50.0])],
            FaultKind::Swapped => {
                let count = if component == FaultyComponent::Coils { MOTORS } else { parts };
                let first = self.below(count);
                let second = (first + 1 + self.below(count.saturating_sub(1))) % count.max(1);
                [first as f64, second as f64, 0.0]
            }
            _ => [0.0; 3],
        };
        values.map(|value| (value * 1e3).round() * 1e-3)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draw_repeats_by_seed_and_stays_within_the_vocabulary() {
        let drawn: Vec<Vec<FaultSpec>> = (0..2000).map(|seed| drawn_faults(seed, 3)).collect();
        assert_eq!(drawn_faults(7, 3), drawn[7]);
        let none = drawn.iter().filter(|faults| faults.is_empty()).count();
        assert!((330..470).contains(&none), "{none} of 2000 without a fault");
        for fault in drawn.iter().flatten() {
            assert!(fault.component.kinds().any(|kind| kind == fault.kind), "{fault:?}");
            for (value, range) in fault.values.iter().zip(fault.kind.values()) {
                assert!((range.min..=range.max).contains(value), "{fault:?}");
            }
            assert!(fault.to.is_none_or(|to| to > fault.from), "{fault:?}");
        }
        let kinds = |kind: FaultKind| drawn.iter().flatten().filter(|fault| fault.kind == kind).count();
        assert!(FaultKind::ALL.into_iter().all(|kind| kinds(kind) > 5), "every kind comes up");
    }
}
