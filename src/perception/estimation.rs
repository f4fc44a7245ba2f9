//! Plate motion from accelerometer traces: a trace is reduced to harmonics, a plate twist and a centre of rotation (UPM
//! paper, section 3.2, App. B and C).

mod accelerometer_phasors;
mod gains;
mod judgement;
mod pump;
mod rigid;
mod spectrum;
mod take_over;
mod types;
mod wave;
mod window;

#[cfg(test)]
mod plate_tests;

pub use gains::{ChannelCheck, check_channels, relative_gains};
pub use judgement::{BEARABLE_GAINS, ExpectedMotion, MotionJudgement, MotionVerdict, judge};
pub use pump::{force_sign, nearest_pump};
pub use rigid::twist_from_corners;
pub use spectrum::{OscillatorFit, amplitude_spectrum, axis_lines, fit_oscillator};
pub use take_over::TakeOver;
pub use types::{AccelerometerPair, AxisPhasors, Coefficients, FitError, PlateFit, PumpWaveQuality, TwistFit, WaveFit};
pub use wave::fit_wave;
pub use window::{MAX_PERIODS, SteadyWindow, accelerations_mps2, sustain_window};

use upm_core::signal::{AccelTrace, Envelope, TwistWave};

/// Smallest amplitude of the first or second harmonic that can be evaluated, m/s²; a part slips from about 1.7 m/s² on.
pub const WEAKEST_MPS2: f64 = 0.3;

/// Fits the plate's motion at the full height of a rotation's pulse shaped by `envelope` to its accelerometer trace.
/// `base_radps` is the drive's base frequency.
///
/// # Errors
///
/// As [`fit_wave`].
pub fn fit_twist(
    trace: &AccelTrace,
    envelope: &Envelope,
    base_radps: f64,
    sensors: &AccelerometerPair,
) -> Result<TwistFit, FitError> {
    let motion = fit_wave(trace, envelope, base_radps, 2, sensors)?;
    let axes = axis_phasors(&motion.wave);
    let (pump, quality) = nearest_pump(&axes, sensors.position_m.norm());
    let accel_mps2 = motion.accel_mps2.each_ref().map(|pairs| std::array::from_fn(|k| pairs[k / 2][k % 2]));
    Ok(TwistFit { motion, accel_mps2, axes, pump, quality })
}

fn refuse_bad(sensors: &AccelerometerPair) -> Result<(), FitError> {
    let arm_m = sensors.position_m.norm();
    if !(arm_m.is_finite() && arm_m > 0.0) {
        return Err(FitError::Unreadable("accelerometers have no distance between them"));
    }
    if !sensors.gain.iter().all(|gain| gain.is_finite() && *gain > 0.0) {
        return Err(FitError::Unreadable("a gain is not a number above 0"));
    }
    Ok(())
}

/// Rejects a trace that ends within the sustain: samples were lost in transmission, and how many is unknown.
fn refuse_cut_short(trace: &AccelTrace, envelope: &Envelope) -> Result<(), FitError> {
    let (found_s, needed_s) = (trace.time_s(trace.len().saturating_sub(1)), envelope.attack_s + envelope.sustain_s);
    if found_s + 1.5 / trace.sample_hz >= needed_s { Ok(()) } else { Err(FitError::CutShort { found_s, needed_s }) }
}

/// The first two harmonics of `wave` as phasors of x, y and spin; missing harmonics are zero.
pub fn axis_phasors(wave: &TwistWave) -> [AxisPhasors; 3] {
    let [first, second] = [0, 1].map(|k| wave.harmonics.get(k).copied().unwrap_or_default().phasor());
    std::array::from_fn(|axis| AxisPhasors { first: first[axis], second: second[axis] })
}
