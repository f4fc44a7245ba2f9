//! Effort of a motion: the motor counts needed to play it.

use nalgebra::{Complex, Matrix3, Vector3};
use wide::f64x4;

use super::harmonic_basis::{HarmonicBasis, SimdF64};
use crate::cor_library::{Library, motor_harmonics};
use upm_core::signal::{Envelope, Follows, MOTORS};

/// Fraction of the motors' limit that a motion fills. The peak is sampled at least 32 times in the period of the
/// highest harmonic; between two samples it rises by half a percent at most.
const EFFORT: f64 = 0.99;

/// Span of a coefficient, as counts over all motors together, relative to the limit of one. A motion with one
/// coefficient at its span takes, root mean square, at least 1.06 of that limit at one of four motors.
const SPAN: f64 = 3.0;

/// Motor counts per m/s of every coefficient.
#[derive(Clone, Debug)]
pub(super) struct MotorEffort {
    /// Axis amplitudes (counts) from velocity phasors (m/s; spin as the speed half a side out), for each harmonic.
    counts_from_motion: Vec<Matrix3<Complex<f64>>>,
    /// Forces on the envelope's slope and curvature for one of x, y and spin, for each harmonic.
    flanks: Vec<[Vector3<Complex<f64>>; 2]>,
    pub limit_counts: f64,
    /// Envelope of a pulse; its flanks are the same for every sustain.
    envelope: Envelope,
    /// Price of a coefficient: the square of the counts it asks for, per (m/s)².
    pub weights: Vec<f64>,
}

impl MotorEffort {
    /// Effort under the responses in `library`; `None` without fields and when a harmonic moves the plate along fewer
    /// than three axes.
    pub fn new(basis: &HarmonicBasis, library: &Library, half_side_m: f64) -> Option<Self> {
        let (fields, plate) = (library.fields.as_ref()?, library.plate.unwrap_or_default());
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
        let unit = Vector3::repeat(Complex::from(1.0));
        let flanks = (1..=basis.harmonics).map(|k| plate.flanks(&unit, k as f64 * fields.base_radps)).collect();
        Some(Self { counts_from_motion, flanks, limit_counts: fields.limit_counts, envelope, weights })
    }

    /// `sqrt(Σ weight c²)`.
    pub fn norm(&self, coefficients: &[f64]) -> f64 {
        coefficients.iter().zip(&self.weights).map(|(c, w)| w * c * c).sum::<f64>().sqrt()
    }

    /// Scales the motion to its share of the motors' limit, by `most` at most.
    pub fn scale(&self, basis: &HarmonicBasis, coefficients: &mut [f64], most: f64) {
        let peak = self.peak_counts(basis, coefficients);
        if peak > 0.0 {
            let scale = (EFFORT * self.limit_counts / peak).min(most);
            coefficients.iter_mut().for_each(|c| *c *= scale);
        }
    }

    /// For each coefficient the value that alone takes [`SPAN`] times the motors' limit, m/s.
    pub fn spans(&self) -> impl Iterator<Item = f64> + Clone {
        self.weights.iter().map(|weight| SPAN * self.limit_counts / weight.sqrt())
    }

    /// Largest sample of any motor in a pulse, its flanks included, counts.
    fn peak_counts(&self, basis: &HarmonicBasis, coefficients: &[f64]) -> f64 {
        match basis.follows {
            Follows::Velocity => {
                let forces: Vec<_> = self.forces(basis, coefficients).iter().map(motor_forces).collect();
                let momenta = (1..).zip(&forces).map(|(k, force)| force.map(|force| basis.integral(force, k)));
                let samples = basis.sums(&side_by_side(&forces, momenta)).into_iter();
                samples.fold(0.0, |peak, sample| self.higher_peak(peak, [sample, SimdF64::ZERO]))
            }
            Follows::Displacement => {
                self.samples(basis, coefficients).fold(0.0, |peak, sample| self.higher_peak(peak, sample))
            }
        }
    }

    /// The steady counts of a motion in every phase of a period, and its shares of the envelope's slope (counts·s) and
    /// of its curvature (counts·s²).
    pub fn counts(&self, basis: &HarmonicBasis, coefficients: &[f64]) -> Vec<[[f64; MOTORS]; 3]> {
        self.samples(basis, coefficients).map(apart).collect()
    }

    /// In every phase of a period the four forces and their shares of the envelope's slope, and those of its curvature.
    fn samples(&self, basis: &HarmonicBasis, coefficients: &[f64]) -> impl Iterator<Item = [SimdF64; 2]> {
        let forces = self.forces(basis, coefficients);
        let flanks = |i: usize| -> Vec<_> {
            let flanks = forces.iter().zip(&self.flanks);
            flanks.map(|(force, flanks)| motor_forces(&flanks[i].component_mul(force))).collect()
        };
        let curvatures = side_by_side(&flanks(1), std::iter::repeat([[0.0; 2]; MOTORS]));
        let steady: Vec<_> = forces.iter().map(motor_forces).collect();
        let forces_and_slopes = basis.sums(&side_by_side(&steady, flanks(0)));
        forces_and_slopes.into_iter().zip(basis.sums(&curvatures)).map(|(sample, curvatures)| [sample, curvatures])
    }

    /// Phasors of the axis amplitudes of every harmonic, counts.
    fn forces(&self, basis: &HarmonicBasis, coefficients: &[f64]) -> Vec<Vector3<Complex<f64>>> {
        let n = basis.per_axis();
        let force = |(k, counts): (usize, &Matrix3<Complex<f64>>)| {
            let phasor =
                |axis: usize| Complex::new(coefficients[axis * n + 2 * k - 2], -coefficients[axis * n + 2 * k - 1]);
            counts * Vector3::new(phasor(0), phasor(1), phasor(2))
        };
        (1..).zip(&self.counts_from_motion).map(force).collect()
    }

    /// The larger of `peak` and the highest count that a sample can reach whose four forces, their shares of the
    /// envelope's slope and their shares of its curvature are these, counts.
    fn higher_peak(&self, peak: f64, sample: [SimdF64; 2]) -> f64 {
        let [forces, slopes, curvatures] = apart(sample);
        // upper bound over all flanks, which spares most samples the exact evaluation
        let force = f64x4::from(forces).abs();
        let slope = f64x4::from(slopes).abs() / self.envelope.attack_s;
        let curvature = f64x4::from(curvatures).abs() * 4.0 / (self.envelope.attack_s * self.envelope.attack_s);
        let bound = (force + slope).max(0.5 * force + 2.0 * slope) + curvature;
        if bound.simd_le(f64x4::splat(peak)).all() {
            return peak;
        }
        let exact = (0..MOTORS).map(|motor| self.envelope.largest(forces[motor], slopes[motor], curvatures[motor]));
        exact.fold(peak, f64::max)
    }
}

/// Coefficients of cos and sin of each motor.
fn motor_forces(counts: &Vector3<Complex<f64>>) -> [[f64; 2]; MOTORS] {
    motor_harmonics(counts).map(|harmonic| [harmonic.cos, harmonic.sin])
}

/// Forces of the motors in a sample, and their shares of the envelope's slope and of its curvature.
fn apart([forces_and_slopes, curvatures]: [SimdF64; 2]) -> [[f64; MOTORS]; 3] {
    let [a, b, c, d, e, f, g, h] = forces_and_slopes.to_array();
    let [j, k, l, m, ..] = curvatures.to_array();
    [[a, b, c, d], [e, f, g, h], [j, k, l, m]]
}

/// Two quantities of the motors for [`HarmonicBasis::sums`].
fn side_by_side(
    first: &[[[f64; 2]; MOTORS]],
    second: impl IntoIterator<Item = [[f64; 2]; MOTORS]>,
) -> Vec<[SimdF64; 2]> {
    let lanes = |(first, second): (&[[f64; 2]; MOTORS], [[f64; 2]; MOTORS])| {
        [0, 1].map(|i| {
            let [[a, b, c, d], [e, f, g, h]] = [*first, second].map(|of_motors| of_motors.map(|parts| parts[i]));
            SimdF64::from([a, b, c, d, e, f, g, h])
        })
    };
    first.iter().zip(second).map(lanes).collect()
}
