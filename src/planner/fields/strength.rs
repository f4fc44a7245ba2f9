//! How strong a motion may be: what the motors have to play for it.

use nalgebra::{Complex, Matrix3, Vector3};

use super::waves::Waves;
use crate::library::{FieldResponse, motor_harmonics};
use crate::signal::Envelope;

/// Part of the motors' limit that a motion fills. Samples are looked at 32 times in the period of the highest harmonic or
/// oftener: between two of them one rises by half a percent at most.
const EFFORT: f64 = 0.99;

/// Counts at every motor, per m/s of every coefficient.
#[derive(Clone, Debug)]
pub(super) struct Strength {
    /// Axis amplitudes (counts) from velocity phasors (m/s; spin as the speed half a side out), for each harmonic.
    counts_from_motion: Vec<Matrix3<Complex<f64>>>,
    limit_counts: f64,
    /// Of every pulse, however long it is held.
    envelope: Envelope,
    /// Price of a coefficient: the square of the counts it asks for, per (m/s)².
    pub weights: Vec<f64>,
}

impl Strength {
    /// `None` when a harmonic moves the plate along fewer than three axes.
    pub fn new(waves: &Waves, fields: &FieldResponse, half_side_m: f64) -> Option<Self> {
        let scaled = |response: &Matrix3<Complex<f64>>| {
            let mut response = *response;
            response.row_mut(2).scale_mut(half_side_m);
            response.try_inverse()
        };
        let counts_from_motion: Vec<_> =
            fields.twist_from_counts.iter().take(waves.harmonics).map(scaled).collect::<Option<_>>()?;
        let price = |j: usize| {
            let column = counts_from_motion[waves.harmonic_of(j) - 1].column(j / waves.per_axis()).into_owned();
            motor_harmonics(&column).iter().map(|h| h.cos * h.cos + h.sin * h.sin).sum::<f64>()
        };
        let weights = (0..waves.len()).map(price).collect();
        let envelope = Envelope { attack_s: fields.attack_s, ..Envelope::default() };
        Some(Self { counts_from_motion, limit_counts: fields.limit_counts, envelope, weights })
    }

    /// `sqrt(Σ weight c²)`.
    pub fn norm(&self, coefficients: &[f64]) -> f64 {
        coefficients.iter().zip(&self.weights).map(|(c, w)| w * c * c).sum::<f64>().sqrt()
    }

    /// Makes the motion as strong as the motors allow.
    pub fn fill(&self, waves: &Waves, coefficients: &mut [f64]) {
        let peak = self.peak_counts(waves, coefficients);
        if peak > 0.0 {
            let scale = EFFORT * self.limit_counts / peak;
            coefficients.iter_mut().for_each(|c| *c *= scale);
        }
    }

    /// Largest sample of any motor in a pulse, its flanks included, counts.
    fn peak_counts(&self, waves: &Waves, coefficients: &[f64]) -> f64 {
        let n = waves.per_axis();
        let mut motors = [vec![0.0; waves.len()], vec![0.0; waves.len()]];
        for (k, counts) in self.counts_from_motion.iter().enumerate() {
            let phasor =
                |axis: usize| Complex::new(coefficients[axis * n + 2 * k], -coefficients[axis * n + 2 * k + 1]);
            let axes = counts * Vector3::new(phasor(0), phasor(1), phasor(2));
            for (motor, harmonic) in motor_harmonics(&axes).into_iter().enumerate() {
                let at = motor % 2 * n + 2 * k;
                motors[motor / 2][at..at + 2].copy_from_slice(&[harmonic.cos, harmonic.sin]);
            }
        }
        // two motors stand where x and y of a motion would: their force is its velocity, their momentum its offset
        let peaks = motors.iter().flat_map(|pair| {
            let samples = waves.motion(pair).into_iter().zip(waves.offsets_m(pair));
            samples.map(|([a, b, _], momentum)| {
                self.envelope.largest(a, momentum.x).max(self.envelope.largest(b, momentum.y))
            })
        });
        peaks.fold(0.0, f64::max)
    }
}
