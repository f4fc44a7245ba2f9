//! Explanations of a motion by its coils: a faulty one, a faulty one among others that are all weak, two exchanged
//! ones.

use nalgebra::{Matrix2, Vector2};

use super::{AS_PLANNED, AccelerometerPhasors, MotionVerdict, PulseJudge, is_fault};
use upm_core::signal::{CHANNELS, MOTORS};

/// Plausible gains of an amplifier and its coil; a gain outside them is the error of something else, attributed to a
/// coil with hardly any share in the motion.
const COIL_GAINS: std::ops::RangeInclusive<f64> = -1.6..=2.0;

/// Gains of a coil with which a run goes on, since the next observation compensates for them: those that an amplifier's
/// supply gives all its coils.
pub const BEARABLE_GAINS: std::ops::RangeInclusive<f64> = 0.7..=1.4;

impl PulseJudge<'_> {
    /// Score and verdict for the gain of `coil` that fits the reading best.
    pub(super) fn coil(&self, coil: usize) -> (f64, MotionVerdict) {
        let [share, others] = self.split(coil);
        let along = |accelerometer_phasors: &AccelerometerPhasors| self.dot(&share, accelerometer_phasors, 0..CHANNELS);
        let gain = (along(&self.read.accel_mps2) - along(&others)) / along(&share);
        let is_plausible = is_fault(gain) && COIL_GAINS.contains(&gain);
        let score = if is_plausible { self.score(&sum([(&share, gain), (&others, 1.0)]), None) } else { f64::INFINITY };
        (score, MotionVerdict::Coil { coil, gain })
    }

    /// The verdict for one coil with one gain while the other three share another, as under a sagging supply.
    pub(super) fn one_coil_of_weak_ones(&self) -> Option<MotionVerdict> {
        let best = (0..MOTORS).map(|coil| self.coil_and_others(coil)).min_by(|(a, _), (b, _)| a.total_cmp(b));
        best.filter(|(score, _)| *score <= self.expected.limit).map(|(_, verdict)| verdict)
    }

    /// Score and verdict for the gains of `coil` and of all others that fit the reading best.
    fn coil_and_others(&self, coil: usize) -> (f64, MotionVerdict) {
        let parts = self.split(coil);
        let dot = |a: &AccelerometerPhasors, b: &AccelerometerPhasors| self.dot(a, b, 0..CHANNELS);
        let normal = Matrix2::from_fn(|row, column| dot(&parts[row], &parts[column]));
        let seen = Vector2::from_fn(|row, _| dot(&parts[row], &self.read.accel_mps2));
        let Some(inverse) = normal.try_inverse() else { return (f64::INFINITY, MotionVerdict::Other) };
        let [gain, shared]: [f64; 2] = (inverse * seen).into();
        let is_plausible = COIL_GAINS.contains(&gain) && BEARABLE_GAINS.contains(&shared) && is_fault(gain / shared);
        let [own, others] = &parts;
        let score = if is_plausible { self.score(&sum([(own, gain), (others, shared)]), None) } else { f64::INFINITY };
        (score, MotionVerdict::Coil { coil, gain })
    }

    /// The planned motion as the accelerometers feel it: the share of `coil`, and that of all others.
    fn split(&self, coil: usize) -> [AccelerometerPhasors; 2] {
        let mut played = AS_PLANNED;
        played[coil].1 = 0.0;
        let others = self.expected.readings(self.planned.len(), played, self.sensors);
        [sum([(&self.planned, 1.0), (&others, -1.0)]), others]
    }

    pub(super) fn swap(&self, coils: [usize; 2]) -> (f64, MotionVerdict) {
        let mut played = AS_PLANNED;
        played.swap(coils[0], coils[1]);
        let predicted = self.expected.readings(self.planned.len(), played, self.sensors);
        (self.score(&predicted, None), MotionVerdict::Swapped { coils })
    }
}

/// Sum of two readings, each times a factor.
fn sum([(a, of_a), (b, of_b)]: [(&AccelerometerPhasors, f64); 2]) -> AccelerometerPhasors {
    a.iter().zip(b).map(|(a, b)| std::array::from_fn(|c| a[c] * of_a + b[c] * of_b)).collect()
}
