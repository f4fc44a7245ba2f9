use nalgebra::{Complex, Matrix3, Vector3};

use super::workbench::Workbench;
use super::{CalibrationFault, CalibrationParams};
use crate::geometry::Twist;
use crate::library::AxisShape;
use crate::signal::Harmonic;

/// Times the pre-compensation is measured and mended; the last pass only confirms.
const PASSES: usize = 3;
/// Peak of `cos a - sin 2a`.
const WAVE_PEAK: f64 = 1.7602;
/// Part of the count limit the axis pulses use; leaves room for the mended waveform's higher peak.
const EFFORT: f64 = 0.75;

/// How the three axes answer.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Axes {
    /// Waveforms that make every axis move as `A (sin wt + ½ cos 2wt)`.
    pub shapes: [AxisShape; 3],
    /// Twist (m/s, m/s, rad/s) from axis amplitudes `fx = X1-X2`, `fy = Y1-Y2`, `s = (Y1+Y2)-(X1+X2)` in counts.
    pub twist_from_counts: Matrix3<f64>,
}

impl Axes {
    /// Plate speed amplitude of the strongest translation along x, m/s.
    pub fn top_speed_mps(&self, count_limit: f64) -> f64 {
        let strongest = 2.0 * count_limit / WAVE_PEAK;
        self.twist_from_counts.column(0).xy().norm() * strongest
    }
}

/// Amplitudes X1, X2, Y1, Y2 that act on one axis alone (Eq. 7), and the axis amplitude they make.
fn axis_amplitudes(axis: usize, counts: i32) -> ([i32; 4], f64) {
    match axis {
        0 => ([counts, -counts, 0, 0], 2.0 * f64::from(counts)),
        1 => ([0, 0, counts, -counts], 2.0 * f64::from(counts)),
        _ => ([-counts, -counts, counts, counts], 4.0 * f64::from(counts)),
    }
}

pub(super) fn measure(bench: &mut Workbench<'_>, params: &CalibrationParams) -> Result<Axes, CalibrationFault> {
    const NAMES: [&str; 3] = ["axis x", "axis y", "axis spin"];
    let counts = (EFFORT * params.effort * bench.model.count_limit / WAVE_PEAK) as i32;
    let sustain_s = params.read_sustain_s.max(0.25).min(bench.model.max_sustain_s);
    let mut shapes = [AxisShape::FREE_MASS; 3];
    let mut twist_from_counts = Matrix3::zeros();
    for pass in 0..PASSES {
        for axis in 0..3 {
            bench.report("axes", 3 * pass + axis, 3 * PASSES);
            let (amplitudes, amplitude) = axis_amplitudes(axis, counts);
            let drive = bench.drive(amplitudes, &shapes, sustain_s);
            let there = bench.read_twist(NAMES[axis], &drive)?;
            let back = bench.read_twist(NAMES[axis], &drive.reversed())?;
            let mean = |f: fn(&crate::estimation::AxisPhasors) -> Complex<f64>| {
                (f(&there.axes[axis]) - f(&back.axes[axis])) / Complex::from(2.0 * amplitude)
            };
            twist_from_counts.set_column(axis, &(as_vector((there.pump - back.pump) * (0.5 / amplitude))));
            if pass + 1 < PASSES {
                shapes[axis] = mended(shapes[axis], mean(|phasors| phasors.first), mean(|phasors| phasors.second));
            }
        }
    }
    Ok(Axes { shapes, twist_from_counts })
}

/// The waveform that makes the axis answer as `A (sin wt + ½ cos 2wt)`, phasors -jA and A/2, from how it answered
/// (velocity phasors per count) to `shape`. The first harmonic keeps unit height.
fn mended(shape: AxisShape, first: Complex<f64>, second: Complex<f64>) -> AxisShape {
    let phasor = |harmonic: Harmonic| Complex::new(harmonic.cos, -harmonic.sin);
    let AxisShape([old_first, old_second]) = shape;
    let gain_first = first / phasor(old_first);
    let gain_second = second / phasor(old_second);
    let force_first = -Complex::i() * gain_first.norm() / gain_first;
    let force_second = Complex::from(0.5 * gain_first.norm()) / gain_second;
    let new = [force_first, force_second].map(|force| Harmonic { cos: force.re, sin: -force.im });
    if new.iter().all(|harmonic| harmonic.cos.is_finite() && harmonic.sin.is_finite()) { AxisShape(new) } else { shape }
}

pub(super) fn as_vector(twist: Twist) -> Vector3<f64> {
    Vector3::new(twist.velocity_mps.x, twist.velocity_mps.y, twist.spin_radps)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mending_inverts_the_response() {
        let response = [Complex::from_polar(0.9, -1.7), Complex::from_polar(0.4, -1.2)];
        let unit = [Complex::new(1.0, 0.0), Complex::i()];
        let AxisShape(mended) = mended(AxisShape::FREE_MASS, response[0] * unit[0], response[1] * unit[1]);
        let velocity: Vec<Complex<f64>> =
            mended.iter().zip(response).map(|(h, gain)| Complex::new(h.cos, -h.sin) * gain).collect();
        assert!((velocity[0] - Complex::new(0.0, -0.9)).norm() < 1e-12);
        assert!((velocity[1] - Complex::new(0.45, 0.0)).norm() < 1e-12);
    }
}
