//! Explanations of a motion by its coils: a faulty one, a faulty one among others that are all weak, two exchanged
//! ones.

use nalgebra::{Matrix2, Vector2};

use super::{Felt, Judge, MotionVerdict, Played, felt, is_fault};
use upm_core::signal::{CHANNELS, MOTORS};

/// Plausible gains of an amplifier and its coil; a gain outside them is the error of something else, attributed to a
/// coil with hardly any share in the motion.
const COIL_GAINS: std::ops::RangeInclusive<f64> = -1.6..=2.0;

/// Plausible common gains of the coils, set by the amplifier's supply.
const SHARED_GAINS: std::ops::RangeInclusive<f64> = 0.7..=1.4;

impl Judge<'_> {
    /// Score and verdict for the gain of `coil` that fits the reading best.
    pub(super) fn coil(&self, coil: usize) -> (f64, MotionVerdict) {
        let (base_radps, harmonics) = (self.expected.drive.base_radps, self.planned.len());
        let predicted = |gain: f64| {
            let velocity = self.expected.velocity(harmonics, &Played::Gain { coil, gain });
            felt(&velocity, base_radps, self.sensors.position_m)
        };
        let dead = predicted(0.0);
        let share: Felt = self.planned.iter().zip(&dead).map(|(a, b)| std::array::from_fn(|c| a[c] - b[c])).collect();
        let missing = self.read.accel_mps2.iter().zip(&dead).map(|(a, b)| std::array::from_fn(|c| a[c] - b[c]));
        let information = self.dot(&share, &share, 0..CHANNELS);
        let gain = self.dot(&share, &missing.collect(), 0..CHANNELS) / information;
        let is_plausible = is_fault(gain) && COIL_GAINS.contains(&gain);
        let score = if is_plausible { self.score(&predicted(gain)) } else { f64::INFINITY };
        (score, MotionVerdict::Coil { coil, gain, gain_sd: information.recip().sqrt() })
    }

    /// The verdict for one coil with one gain while the other three share another, as under a sagging supply.
    pub(super) fn one_coil_of_weak_ones(&self) -> Option<MotionVerdict> {
        let best = (0..MOTORS).map(|coil| self.coil_and_others(coil)).min_by(|(a, _), (b, _)| a.total_cmp(b));
        best.filter(|(score, _)| *score <= 1.0).map(|(_, verdict)| verdict)
    }

    /// Score and verdict for the gains of `coil` and of all others that fit the reading best.
    fn coil_and_others(&self, coil: usize) -> (f64, MotionVerdict) {
        let dead = self.expected.velocity(self.planned.len(), &Played::Gain { coil, gain: 0.0 });
        let others = felt(&dead, self.expected.drive.base_radps, self.sensors.position_m);
        let combined = |own: f64, shared: f64| -> Felt {
            let rows = self.planned.iter().zip(&others);
            rows.map(|(all, rest)| std::array::from_fn(|c| (all[c] - rest[c]) * own + rest[c] * shared)).collect()
        };
        let share = combined(1.0, 0.0);
        let across = self.dot(&share, &others, 0..CHANNELS);
        let normal = Matrix2::new(
            self.dot(&share, &share, 0..CHANNELS),
            across,
            across,
            self.dot(&others, &others, 0..CHANNELS),
        );
        let seen = [&share, &others].map(|part| self.dot(part, &self.read.accel_mps2, 0..CHANNELS));
        let Some(inverse) = normal.try_inverse() else { return (f64::INFINITY, MotionVerdict::Other) };
        let gains = inverse * Vector2::from(seen);
        let (gain, shared) = (gains.x, gains.y);
        let is_plausible = COIL_GAINS.contains(&gain) && SHARED_GAINS.contains(&shared) && is_fault(gain / shared);
        let score = if is_plausible { self.score(&combined(gain, shared)) } else { f64::INFINITY };
        (score, MotionVerdict::Coil { coil, gain, gain_sd: inverse.m11.sqrt() })
    }

    pub(super) fn swap(&self, coils: [usize; 2]) -> (f64, MotionVerdict) {
        let velocity = self.expected.velocity(self.planned.len(), &Played::Swapped(coils));
        let predicted = felt(&velocity, self.expected.drive.base_radps, self.sensors.position_m);
        (self.score(&predicted), MotionVerdict::Swapped { coils })
    }
}
