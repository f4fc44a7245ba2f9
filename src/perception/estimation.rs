//! Plate motion from accelerometer traces: a trace is reduced to harmonics, a plate twist and a centre of rotation (UPM
//! paper, section 3.2, App. B and C).

mod accelerometer_phasors;
mod gains;
mod harmonics;
mod judgement;
mod pump;
mod rigid;
mod spectrum;
mod types;
mod wave;
mod window;

#[cfg(test)]
mod plate_tests;

pub use gains::{ChannelCheck, check_channels, relative_gains};
pub use harmonics::{Coefficients, HarmonicFit, fit_channels, velocity_mps};
pub use judgement::{ChannelFault, ExpectedMotion, Mismatch, MotionJudgement, MotionVerdict, judge};
pub use pump::{force_sign, nearest_pump};
pub use rigid::twist_from_corners;
pub use spectrum::{OscillatorFit, amplitude_spectrum, axis_lines, fit_oscillator};
pub use types::{AccelerometerPair, AxisPhasors, FitFault, PlateFit, PumpWaveQuality, TwistFit, WaveFit};
pub use wave::fit_wave;
pub use window::{MAX_PERIODS, SteadyWindow, accelerations_mps2, sustain_window};

use nalgebra::Complex;

use upm_core::geometry::{Twist, Vec2};
use upm_core::signal::{AccelTrace, CHANNELS, Envelope, TwistHarmonic, TwistWave};

/// Smallest amplitude of the first or second harmonic that can be evaluated, m/s²; a part slips from about 1.7 m/s² on.
pub const WEAKEST_MPS2: f64 = 0.3;

/// Fits the plate's motion at the full height of a pulse shaped by `envelope` to its accelerometer trace. `base_radps`
/// is the drive's base frequency.
///
/// # Errors
///
/// As [`sustain_window`] and [`accelerations_mps2`]; [`FitFault::CutShort`] for a trace that ends within the sustain
/// and [`FitFault::TooWeak`] for a motion below [`WEAKEST_MPS2`]. [`FitFault::Unreadable`] also for sensors without a
/// distance between them, for gains that are not above 0, and for harmonics that cannot be told from drift.
pub fn fit_twist(
    trace: &AccelTrace,
    envelope: &Envelope,
    base_radps: f64,
    sensors: &AccelerometerPair,
) -> Result<TwistFit, FitFault> {
    refuse_bad(sensors)?;
    let window = sustain_window(trace, envelope, base_radps)?;
    refuse_cut_short(trace, envelope)?;
    let channels = accelerations_mps2(trace, &window)?;
    let fits = fit_channels(&window, &channels, base_radps)?;
    let accel_mps2 = std::array::from_fn(|channel| fits[channel].coefficients.map(|c| c / sensors.gain[channel]));
    refuse_weak(&accel_mps2)?;
    let wave = twist_wave(&accel_mps2, base_radps, sensors.position_m);
    let axes = axis_phasors(&wave);
    let (pump, quality) = nearest_pump(&axes, sensors.position_m.norm());
    let residual_sum: f64 = fits.iter().map(|fit| fit.residual_sum).sum();
    let residual_rms_mps2 = (residual_sum / (CHANNELS * window.samples.len()) as f64).sqrt();
    let variance = |k: usize| fits.iter().map(|fit| fit.sd[k] * fit.sd[k]).sum::<f64>() / CHANNELS as f64;
    let accel_sd_mps2 = std::array::from_fn(|k| variance(k).sqrt());
    let channel_residual_mps2 = fits.map(|fit| (fit.residual_sum / window.samples.len() as f64).sqrt());
    Ok(TwistFit { accel_mps2, accel_sd_mps2, channel_residual_mps2, residual_rms_mps2, wave, axes, pump, quality })
}

fn refuse_bad(sensors: &AccelerometerPair) -> Result<(), FitFault> {
    let arm_m = sensors.position_m.norm();
    if !(arm_m.is_finite() && arm_m > 0.0) {
        return Err(FitFault::Unreadable("accelerometers have no distance between them"));
    }
    if !sensors.gain.iter().all(|gain| gain.is_finite() && *gain > 0.0) {
        return Err(FitFault::Unreadable("a gain is not a number above 0"));
    }
    Ok(())
}

/// Rejects a trace that ends within the sustain: samples were lost in transmission, and how many is unknown.
fn refuse_cut_short(trace: &AccelTrace, envelope: &Envelope) -> Result<(), FitFault> {
    let (found_s, needed_s) = (trace.time_s(trace.len().saturating_sub(1)), envelope.attack_s + envelope.sustain_s);
    if found_s + 1.5 / trace.sample_hz >= needed_s { Ok(()) } else { Err(FitFault::CutShort { found_s, needed_s }) }
}

fn refuse_weak(accel_mps2: &[Coefficients; CHANNELS]) -> Result<(), FitFault> {
    let largest = |k: usize| accel_mps2.iter().map(|c| c[k].hypot(c[k + 1])).fold(0.0, f64::max);
    let found_mps2 = largest(0).max(largest(2));
    // Written so that NaN is rejected too.
    if found_mps2 >= WEAKEST_MPS2 && found_mps2.is_finite() {
        Ok(())
    } else {
        Err(FitFault::TooWeak { found_mps2, needed_mps2: WEAKEST_MPS2 })
    }
}

/// The plate's two-harmonic velocity from the four channels' acceleration coefficients.
pub fn twist_wave(accel_mps2: &[Coefficients; CHANNELS], base_radps: f64, accelerometer_in_plate_m: Vec2) -> TwistWave {
    let [x1, y1, x2, y2] = accel_mps2.map(|coefficients| velocity_mps(&coefficients, base_radps));
    let [cos1, sin1, cos2, sin2]: [Twist; 4] = std::array::from_fn(|k| {
        twist_from_corners(Vec2::new(x1[k], y1[k]), Vec2::new(x2[k], y2[k]), accelerometer_in_plate_m)
    });
    let harmonics = vec![TwistHarmonic { cos: cos1, sin: sin1 }, TwistHarmonic { cos: cos2, sin: sin2 }];
    TwistWave { base_radps, harmonics }
}

/// The first two harmonics of `wave` as phasors of x, y and spin; missing harmonics are zero.
pub fn axis_phasors(wave: &TwistWave) -> [AxisPhasors; 3] {
    let harmonic = |k: usize| wave.harmonics.get(k).copied().unwrap_or_default();
    let (first, second) = (harmonic(0), harmonic(1));
    let part = |axis: usize, twist: Twist| [twist.velocity_mps.x, twist.velocity_mps.y, twist.spin_radps][axis];
    let phasor = |axis: usize, h: TwistHarmonic| Complex::new(part(axis, h.cos), -part(axis, h.sin));
    std::array::from_fn(|axis| AxisPhasors { first: phasor(axis, first), second: phasor(axis, second) })
}
