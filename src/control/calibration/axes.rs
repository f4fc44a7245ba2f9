use std::f64::consts::TAU;

use nalgebra::{Complex, Matrix3, Vector3};

use super::coils::Coils;
use super::fault::LEAST_LAG_DEG;
use super::workbench::Workbench;
use super::{CalibrationFault, CalibrationParams, channels};
use upm_core::geometry::Twist;
use upm_core::rig::RigModel;
use upm_core::signal::{CHANNELS, Drive, Harmonic};
use upm_library::AxisShape;
use upm_perception::estimation::{AxisPhasors, Coefficients, FitFault, TwistFit, relative_gains};

/// Times the pre-compensation is measured and mended; the last pass only confirms.
const PASSES: usize = 3;
/// Peak of `cos a - sin 2a`.
const WAVE_PEAK: f64 = 1.7602;
/// Amplitude that a waveform's peak is tried with.
const TRIAL_COUNTS: i32 = 10_000;
/// Part of the count limit the axis pulses use; leaves room for the mended waveform's higher peak.
const EFFORT: f64 = 0.75;
/// What faults call the axes.
pub(super) const NAMES: [&str; 3] = ["axis x", "axis y", "axis spin"];

/// How the three axes answer.
#[derive(Clone, Debug, PartialEq)]
pub struct Axes {
    /// Waveforms that make every axis move as `A (sin wt + ½ cos 2wt)`, A per count that of a free mass.
    pub shapes: [AxisShape; 3],
    /// Twist (m/s, m/s, rad/s) from axis amplitudes `fx = X1-X2`, `fy = Y1-Y2`, `s = (Y1+Y2)-(X1+X2)` in counts.
    pub twist_from_counts: Matrix3<f64>,
    /// What each accelerometer channel shows for a true 1, against the others.
    pub accelerometer_gain: [f64; CHANNELS],
    /// The last pulse of each axis, what the closing pulses are held against.
    pub(super) opening: [AxisPulse; 3],
}

/// A pulse of one axis, played both ways.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct AxisPulse {
    pub drive: Drive,
    /// What the channels showed, half the difference of both ways, m/s², with their gains in it.
    pub shown: [Coefficients; CHANNELS],
}

impl AxisPulse {
    /// Plays `drive` both ways; the pulse and both readings.
    pub fn play(
        bench: &mut Workbench<'_>,
        axis: usize,
        drive: Drive,
    ) -> Result<(Self, [TwistFit; 2]), CalibrationFault> {
        let read = |bench: &mut Workbench<'_>, drive: &Drive| {
            bench.read_twist(NAMES[axis], drive).map_err(|fault| match fault {
                CalibrationFault::Trace { fault: FitFault::TooWeak { found_mps2, needed_mps2 }, .. } => {
                    CalibrationFault::Still { axis: NAMES[axis], found_mps2, needed_mps2 }
                }
                other => other,
            })
        };
        let there = read(bench, &drive)?;
        let back = read(bench, &drive.clone().reversed())?;
        let shown = half_difference(&there, &back, &bench.sensors.gain);
        Ok((Self { drive, shown }, [there, back]))
    }
}

impl Axes {
    /// Plate speed amplitude of the strongest translation along x, m/s.
    pub(super) fn top_speed_mps(&self, count_limit: f64) -> f64 {
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
    let sustain_s = params.read_sustain_s.max(0.25).min(bench.model.max_sustain_s);
    let mut shapes = [AxisShape::FREE_MASS; 3];
    let mut twist_from_counts = Matrix3::zeros();
    let mut shown = Vec::new();
    let mut pulses: [AxisPulse; 3] = Default::default();
    for pass in 0..PASSES {
        let mut responses = [AxisPhasors::default(); 3];
        for axis in 0..3 {
            bench.report("axes", 3 * pass + axis, 3 * PASSES);
            let headroom = bench.headroom(axis_amplitudes(axis, TRIAL_COUNTS).0, &shapes);
            let counts = EFFORT * params.effort * headroom * f64::from(TRIAL_COUNTS);
            let (amplitudes, amplitude) = axis_amplitudes(axis, counts as i32);
            let drive = bench.drive(amplitudes, &shapes, sustain_s);
            let (pulse, [there, back]) = AxisPulse::play(bench, axis, drive)?;
            shown.push(pulse.shown);
            pulses[axis] = pulse;
            responses[axis] = per_count(&there.axes[axis], &back.axes[axis], amplitude);
            twist_from_counts.set_column(axis, &(as_vector((there.pump - back.pump) * (0.5 / amplitude))));
        }
        bench.sensors.gain = relative_gains(&shown, bench.sensors.position_m);
        check(bench, &pulses, &shapes, &responses)?;
        if pass + 1 < PASSES {
            shapes =
                std::array::from_fn(|axis| mended(shapes[axis], &responses[axis], free_mass_speed(axis, bench.model)));
        }
    }
    Ok(Axes { shapes, twist_from_counts, accelerometer_gain: bench.sensors.gain, opening: pulses })
}

/// Refuses channels and coils that cannot be as the rig file says. Channels first, for coils are judged by them; a
/// resonance that is too high spoils the size of coils, but not what names one that is dead, reversed or exchanged.
fn check(
    bench: &Workbench<'_>,
    pulses: &[AxisPulse; 3],
    shapes: &[AxisShape; 3],
    responses: &[AxisPhasors; 3],
) -> Result<(), CalibrationFault> {
    channels::check(&pulses.each_ref().map(|pulse| pulse.shown), bench.sensors.position_m)?;
    let [first, second] = Coils::read(pulses, &bench.sensors, bench.model);
    second.check_working()?;
    for axis in 0..3 {
        refuse_resonance(axis, shapes[axis], &responses[axis], bench.model)?;
    }
    second.check_gains(&first)
}

/// What the channels showed, their gains put back in, with all that does not turn round with the drive left out.
fn half_difference(there: &TwistFit, back: &TwistFit, gain: &[f64; CHANNELS]) -> [Coefficients; CHANNELS] {
    let (there, back) = (&there.accel_mps2, &back.accel_mps2);
    std::array::from_fn(|c| std::array::from_fn(|k| 0.5 * (there[c][k] - back[c][k]) * gain[c]))
}

fn per_count(there: &AxisPhasors, back: &AxisPhasors, amplitude: f64) -> AxisPhasors {
    let mean = |there: Complex<f64>, back: Complex<f64>| (there - back) / Complex::from(2.0 * amplitude);
    AxisPhasors { first: mean(there.first, back.first), second: mean(there.second, back.second) }
}

/// Speed amplitude of one count on a free mass (Eq. 33 far above resonance): `N/(m w)`, for spin `r N/(I w)`.
fn free_mass_speed(axis: usize, model: &RigModel) -> f64 {
    let force_n = model.newtons_per_count;
    let accel =
        if axis < 2 { force_n / model.plate_mass_kg } else { model.lever_arm_m * force_n / model.plate_inertia_kgm2 };
    accel / model.base_radps
}

pub(super) fn phasor(harmonic: Harmonic) -> Complex<f64> {
    Complex::new(harmonic.cos, -harmonic.sin)
}

fn refuse_resonance(
    axis: usize,
    shape: AxisShape,
    response: &AxisPhasors,
    model: &RigModel,
) -> Result<(), CalibrationFault> {
    let lag_deg = -(response.first / phasor(shape.0[0])).arg().to_degrees();
    if lag_deg >= LEAST_LAG_DEG {
        return Ok(());
    }
    Err(CalibrationFault::Resonance { axis: NAMES[axis], lag_deg, base_hz: model.base_radps / TAU })
}

/// The waveform that makes the axis answer as `A (sin wt + ½ cos 2wt)`, phasors -jA and A/2, from how it answered
/// (velocity phasors per count) to `shape`. With A that of a free mass Eq. 15 holds for the amplitudes sent.
fn mended(shape: AxisShape, response: &AxisPhasors, speed: f64) -> AxisShape {
    let AxisShape([old_first, old_second]) = shape;
    let force_first = -Complex::i() * speed * phasor(old_first) / response.first;
    let force_second = Complex::from(0.5 * speed) * phasor(old_second) / response.second;
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
        let gain = [Complex::from_polar(0.9, -1.7), Complex::from_polar(0.4, -1.2)];
        let response = AxisPhasors { first: gain[0], second: gain[1] * Complex::i() };
        let AxisShape(mended) = mended(AxisShape::FREE_MASS, &response, 0.7);
        let velocity: Vec<Complex<f64>> = mended.iter().zip(gain).map(|(&h, gain)| phasor(h) * gain).collect();
        assert!((velocity[0] - Complex::new(0.0, -0.7)).norm() < 1e-12);
        assert!((velocity[1] - Complex::new(0.35, 0.0)).norm() < 1e-12);
    }
}
