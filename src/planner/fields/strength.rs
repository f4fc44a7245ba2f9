//! How strong a motion may be: what the motors have to play for it.

use nalgebra::{Complex, Matrix3, Vector3};

use super::waves::Waves;

/// Part of the motors' limit that a motion fills: the flanks ask for a little more than the sustain.
const EFFORT: f64 = 0.94;

/// Counts at every motor, per m/s of every coefficient.
#[derive(Clone, Debug)]
pub(super) struct Strength {
    /// Axis amplitudes (counts) from velocity phasors (m/s; spin as the speed half a side out), for each harmonic.
    counts_from_motion: Vec<Matrix3<Complex<f64>>>,
    limit_counts: f64,
    /// Price of a coefficient: the square of the counts it asks for, per (m/s)².
    pub weights: Vec<f64>,
}

impl Strength {
    /// `motion_from_counts`: the measured response, spin in rad/s. `None` when a harmonic moves the plate along
    /// fewer than three axes.
    pub fn new(
        waves: &Waves,
        motion_from_counts: &[Matrix3<Complex<f64>>],
        half_side_m: f64,
        limit_counts: f64,
    ) -> Option<Self> {
        let scaled = |response: &Matrix3<Complex<f64>>| {
            let mut response = *response;
            response.row_mut(2).scale_mut(half_side_m);
            response.try_inverse()
        };
        let counts_from_motion: Vec<_> =
            motion_from_counts.iter().take(waves.harmonics).map(scaled).collect::<Option<_>>()?;
        let price = |j: usize| {
            let column = counts_from_motion[waves.harmonic_of(j) - 1].column(j / waves.per_axis()).into_owned();
            at_motors(&column).iter().map(|c| c.norm_sqr()).sum::<f64>()
        };
        let weights = (0..waves.len()).map(price).collect();
        Some(Self { counts_from_motion, limit_counts, weights })
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

    /// Largest sample of any motor in a period, counts.
    fn peak_counts(&self, waves: &Waves, coefficients: &[f64]) -> f64 {
        let n = waves.per_axis();
        let mut played = vec![0.0; waves.len()];
        let mut motors = [vec![0.0; n], vec![0.0; n], vec![0.0; n], vec![0.0; n]];
        for (k, counts) in self.counts_from_motion.iter().enumerate() {
            let phasor =
                |axis: usize| Complex::new(coefficients[axis * n + 2 * k], -coefficients[axis * n + 2 * k + 1]);
            let axes = counts * Vector3::new(phasor(0), phasor(1), phasor(2));
            for (motor, sample) in motors.iter_mut().zip(at_motors(&axes)) {
                (motor[2 * k], motor[2 * k + 1]) = (sample.re, -sample.im);
            }
        }
        let mut peak = 0.0f64;
        for pair in [[0, 1], [2, 3]] {
            played[..n].copy_from_slice(&motors[pair[0]]);
            played[n..2 * n].copy_from_slice(&motors[pair[1]]);
            let samples = waves.motion(&played);
            peak = samples.iter().flat_map(|[a, b, _]| [a.abs(), b.abs()]).fold(peak, f64::max);
        }
        peak
    }
}

/// Eq. 7 turned round, without squeeze: motors X1, X2, Y1, Y2 from axis amplitudes.
fn at_motors(axes: &Vector3<Complex<f64>>) -> [Complex<f64>; 4] {
    let (x, y, turn) = (axes.x * 0.5, axes.y * 0.5, axes.z * 0.25);
    [x - turn, -x - turn, y + turn, -y + turn]
}
