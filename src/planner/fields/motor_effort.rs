//! Effort of a motion: the motor counts needed to play it.

use nalgebra::{Complex, Matrix3, Vector3};
use wide::f64x4;

use super::harmonic_basis::{HarmonicBasis, SimdF64};
use upm_cor_library::{FieldResponse, motor_harmonics};
use upm_core::signal::Envelope;

/// Fraction of the motors' limit that a motion fills. The peak is sampled at least 32 times in the period of the
/// highest harmonic; between two samples it rises by half a percent at most.
const EFFORT: f64 = 0.99;

/// Motor counts per m/s of every coefficient.
#[derive(Clone, Debug)]
pub(super) struct MotorEffort {
    /// Axis amplitudes (counts) from velocity phasors (m/s; spin as the speed half a side out), for each harmonic.
    counts_from_motion: Vec<Matrix3<Complex<f64>>>,
    limit_counts: f64,
    /// Envelope of a pulse; its flanks are the same for every sustain.
    envelope: Envelope,
    /// Price of a coefficient: the square of the counts it asks for, per (m/s)².
    pub weights: Vec<f64>,
}

impl MotorEffort {
    /// Effort under the response `fields`; `None` when a harmonic moves the plate along fewer than three axes.
    pub fn new(basis: &HarmonicBasis, fields: &FieldResponse, half_side_m: f64) -> Option<Self> {
        let scaled = |response: &Matrix3<Complex<f64>>| {
            let mut response = *response;
            response.row_mut(2).scale_mut(half_side_m);
            response.try_inverse()
        };
        let counts_from_motion: Vec<_> =
            fields.twist_from_counts.iter().take(basis.harmonics).map(scaled).collect::<Option<_>>()?;
        let price = |j: usize| {
            let column = counts_from_motion[basis.harmonic_of(j) - 1].column(j / basis.per_axis()).into_owned();
            motor_harmonics(&column).iter().map(|h| h.cos * h.cos + h.sin * h.sin).sum::<f64>()
        };
        let weights = (0..basis.len()).map(price).collect();
        let envelope = Envelope { attack_s: fields.attack_s, ..Envelope::default() };
        Some(Self { counts_from_motion, limit_counts: fields.limit_counts, envelope, weights })
    }

    /// `sqrt(Σ weight c²)`.
    #[inline]
    pub fn norm(&self, coefficients: &[f64]) -> f64 {
        coefficients.iter().zip(&self.weights).map(|(c, w)| w * c * c).sum::<f64>().sqrt()
    }

    /// Scales the motion to its share of the motors' limit.
    #[inline]
    pub fn fill(&self, basis: &HarmonicBasis, coefficients: &mut [f64]) {
        let peak = self.peak_counts(basis, coefficients);
        if peak > 0.0 {
            let scale = EFFORT * self.limit_counts / peak;
            coefficients.iter_mut().for_each(|c| *c *= scale);
        }
    }

    /// Largest sample of any motor in a pulse, its flanks included, counts.
    fn peak_counts(&self, basis: &HarmonicBasis, coefficients: &[f64]) -> f64 {
        let n = basis.per_axis();
        let factors = |(k, counts): (usize, &Matrix3<Complex<f64>>)| {
            let phasor =
                |axis: usize| Complex::new(coefficients[axis * n + 2 * k - 2], -coefficients[axis * n + 2 * k - 1]);
            let motors = motor_harmonics(&(counts * Vector3::new(phasor(0), phasor(1), phasor(2))));
            let forces = motors.map(|harmonic| [harmonic.cos, harmonic.sin]);
            let momenta = forces.map(|force| basis.integral(force, k));
            [0, 1].map(|i| {
                let [[a, b, c, d], [e, f, g, h]] = [forces, momenta].map(|of_motors| of_motors.map(|parts| parts[i]));
                SimdF64::from([a, b, c, d, e, f, g, h])
            })
        };
        let factors: Vec<[SimdF64; 2]> = (1..).zip(&self.counts_from_motion).map(factors).collect();
        basis.sums(&factors).into_iter().fold(0.0, |peak, sums| self.higher_peak(peak, sums))
    }

    /// The larger of `peak` and the highest count that a sample with these four forces and four momenta can reach,
    /// counts.
    fn higher_peak(&self, peak: f64, forces_and_momenta: SimdF64) -> f64 {
        let [a, b, c, d, e, f, g, h] = forces_and_momenta.to_array();
        let (forces, momenta) = ([a, b, c, d], [e, f, g, h]);
        // upper bound over all flanks, which spares most samples the exact evaluation
        let force = f64x4::from(forces).abs();
        let momentum = f64x4::from(momenta).abs() / self.envelope.attack_s;
        let bound = (force + momentum).max(0.5 * force + 2.0 * momentum);
        if bound.simd_le(f64x4::splat(peak)).all() {
            return peak;
        }
        let exact =
            forces.into_iter().zip(momenta).map(|(force, momentum)| self.envelope.largest(force, momentum, 0.0));
        exact.fold(peak, f64::max)
    }
}
