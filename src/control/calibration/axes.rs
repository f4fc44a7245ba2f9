use std::f64::consts::TAU;

use nalgebra::{Complex, Matrix3};

use super::axis_pulse::{AROUND, AxisPulse, NAMES};
use super::coils::CoilGains;
use super::fault::LEAST_LAG_DEG;
use super::session::EFFORT;
use super::{CalibrationError, CalibrationSession, MiswiredChannel};
use upm_core::phasor::argument;
use upm_core::rig::RigModel;
use upm_core::signal::{CHANNELS, Harmonic, MotorArrangement};
use upm_perception::estimation::{AxisPhasors, check_channels, relative_gains};
use upm_planning::cor_library::AxisShape;

/// Number of passes that measure and correct the pre-compensation; the last one only confirms.
const PASSES: usize = 3;
/// Amplitude, in counts, at which a waveform's peak is computed.
const TRIAL_COUNTS: i32 = 10_000;
/// Sustain of an axis pulse, s.
const READ_SUSTAIN_S: f64 = 0.25;
/// Share of [`EFFORT`] that the axis pulses use; the rest is room for the corrected waveform's higher peak.
const OF_EFFORT: f64 = 0.75;
/// A channel that reads less than this share of the strongest one is dead: every channel sees at least one whole axis.
const DEAD_CHANNEL: f64 = 0.1;
/// Least and largest gain of a channel relative to the others.
const CHANNEL_GAIN: (f64, f64) = (0.8, 1.25);
/// Largest share of the readings that may contradict a rigid plate.
const CHANNEL_MISFIT: f64 = 0.05;

/// Measured response of the three axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Axes {
    /// Waveforms that make every axis move as `A (sin wt + ½ cos 2wt)`, A per count equal to that of a free mass.
    pub shapes: [AxisShape; 3],
    /// Twist (m/s, m/s, rad/s) from axis amplitudes fx, fy and s in counts.
    pub twist_from_counts: Matrix3<f64>,
    /// Gain of each accelerometer channel relative to the others: its reading for a true 1.
    pub accelerometer_gain: [f64; CHANNELS],
    /// The last pulse of each axis; the closing pulses are compared with it.
    pub(super) opening: [AxisPulse; 3],
}

/// Amplitudes X1, X2, Y1, Y2 that act on one axis alone (Eq. 7), and the axis amplitude they make.
fn axis_amplitudes(arrangement: MotorArrangement, axis: usize, counts: i32) -> ([i32; 4], f64) {
    let amplitude = AROUND[axis].iter().map(|share| share.abs() * counts).sum::<i32>();
    (arrangement.turned(AROUND[axis].map(|share| share * counts)), f64::from(amplitude))
}

pub(super) fn measure(session: &mut CalibrationSession<'_>) -> Result<Axes, CalibrationError> {
    let sustain_s = session.read_sustain_s(READ_SUSTAIN_S);
    let arrangement = session.model.motor_arrangement;
    let mut shapes = [AxisShape::FREE_MASS; 3];
    let mut twist_from_counts = Matrix3::zeros();
    let mut shown = Vec::new();
    let mut pulses: [AxisPulse; 3] = Default::default();
    for pass in 0..PASSES {
        let mut responses = [AxisPhasors::default(); 3];
        for axis in 0..3 {
            session.report("axes", 3 * pass + axis, 3 * PASSES);
            let headroom = session.headroom(axis_amplitudes(arrangement, axis, TRIAL_COUNTS).0, &shapes);
            let counts = OF_EFFORT * EFFORT * headroom * f64::from(TRIAL_COUNTS);
            let (amplitudes, amplitude) = axis_amplitudes(arrangement, axis, counts as i32);
            let drive = session.drive(amplitudes, &shapes, sustain_s);
            let (pulse, [there, back]) = AxisPulse::play(session, axis, drive)?;
            shown.push(pulse.shown);
            pulses[axis] = pulse;
            responses[axis] = per_count(&there.axes[axis], &back.axes[axis], amplitude);
            twist_from_counts.set_column(axis, &((there.pump - back.pump) * (0.5 / amplitude)).vector());
        }
        session.sensors.gain = relative_gains(&shown, session.sensors.position_m);
        check(session, &pulses, &shapes, &responses)?;
        if pass + 1 < PASSES {
            shapes = std::array::from_fn(|axis| {
                mended(shapes[axis], &responses[axis], free_mass_speed(axis, session.model))
            });
        }
    }
    Ok(Axes { shapes, twist_from_counts, accelerometer_gain: session.sensors.gain, opening: pulses })
}

/// Refuses channels and coils that contradict the rig file. Channels are checked first because they measure the coils.
/// A resonance that is too high distorts the coils' gains, but not the detection of dead, reversed or exchanged ones.
fn check(
    session: &CalibrationSession<'_>,
    pulses: &[AxisPulse; 3],
    shapes: &[AxisShape; 3],
    responses: &[AxisPhasors; 3],
) -> Result<(), CalibrationError> {
    // One pulse each of x, y and spin shows channels that are dead, reversed or off in gain, the worst first, and
    // readings that fit no rigid plate.
    let found = check_channels(&pulses.each_ref().map(|pulse| pulse.shown), session.sensors.position_m);
    let fault = |channel, fault| Err(CalibrationError::Channel { channel, fault });
    if let Some((channel, share)) = worst(found.share, |share| share < DEAD_CHANNEL, |share| -share) {
        return fault(channel, MiswiredChannel::Dead { share });
    }
    if found.misfit > CHANNEL_MISFIT {
        return Err(CalibrationError::NotRigid { misfit: found.misfit });
    }
    let plausible = |gain: f64| (CHANNEL_GAIN.0..=CHANNEL_GAIN.1).contains(&gain);
    if let Some((channel, gain)) = worst(found.gain, |gain| !plausible(gain), |gain| (gain - 1.0).abs()) {
        let miswired = if gain < 0.0 { MiswiredChannel::Reversed { gain } } else { MiswiredChannel::Gain { gain } };
        return fault(channel, miswired);
    }
    let [first, second] = CoilGains::read(pulses, &session.sensors, session.model);
    second.check_working()?;
    for axis in 0..3 {
        let lag_deg = -argument(responses[axis].first / shapes[axis].0[0].phasor()).to_degrees();
        if lag_deg.is_nan() || lag_deg < LEAST_LAG_DEG {
            let base_hz = session.model.base_radps / TAU;
            return Err(CalibrationError::Resonance { axis: NAMES[axis], lag_deg, base_hz });
        }
    }
    second.check_gains(&first)
}

/// Index and value of the `bad` channel for which `how` is largest.
fn worst(values: [f64; CHANNELS], bad: impl Fn(f64) -> bool, how: impl Fn(f64) -> f64) -> Option<(usize, f64)> {
    values.into_iter().enumerate().filter(|(_, value)| bad(*value)).max_by(|a, b| how(a.1).total_cmp(&how(b.1)))
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

/// The waveform that makes the axis answer as `A (sin wt + ½ cos 2wt)`, phasors -jA and A/2, from its measured response
/// to `shape` (velocity phasors per count). A is that of a free mass, so that Eq. 15 holds for the amplitudes sent.
fn mended(shape: AxisShape, response: &AxisPhasors, speed: f64) -> AxisShape {
    let AxisShape([old_first, old_second]) = shape;
    let force_first = -Complex::i() * speed * old_first.phasor() / response.first;
    let force_second = Complex::from(0.5 * speed) * old_second.phasor() / response.second;
    let new = [force_first, force_second].map(Harmonic::from_phasor);
    if new.iter().all(|harmonic| harmonic.cos.is_finite() && harmonic.sin.is_finite()) { AxisShape(new) } else { shape }
}
