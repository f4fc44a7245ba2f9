use std::f64::consts::TAU;

use super::texts::{chart, figure, figures};
use super::{ExperimentResult, Figure, LabError};
use upm_chart::Color;
use upm_core::signal::{CHANNEL_NAMES, RecordedPulse};
use upm_core::units::mm_from_m;
use upm_perception::estimation::{
    AccelerometerPair, FitError, SteadyWindow, TwistFit, accelerations_mps2, amplitude_spectrum, fit_twist,
    sustain_window,
};

/// Determines the plate's motion from a trace recorded on any rig (UPM paper, section 3.2, App. B and C).
///
/// # Errors
///
/// [`LabError::Rig`] for a trace that [`fit_twist`] cannot evaluate. A spectrum that cannot be computed is only
/// noted.
pub fn waveform_fit_of(pulse: &RecordedPulse) -> Result<ExperimentResult, LabError> {
    let fault = |fault: FitError| LabError::Rig(format!("recorded pulse: {fault}"));
    let fit = fit(pulse).map_err(fault)?;
    let window = sustain_window(&pulse.trace, &pulse.envelope, pulse.base_radps).map_err(fault)?;
    let shown = accelerations_mps2(&pulse.trace, &window).map_err(fault)?;
    let mut chart = chart("waveform-fit");
    for (channel, (name, shown)) in CHANNEL_NAMES.iter().zip(shown).enumerate() {
        let (gain, color, fitted) = (pulse.channel_gain[channel], Color::nth(channel), fit.accel_mps2[channel]);
        let mean = shown.iter().sum::<f64>() / shown.len().max(1) as f64;
        let measured = window.times_s().zip(shown).map(|(t_s, shown)| [1e3 * t_s, (shown - mean) / gain]);
        let line = window.times_s().map(|t_s| [1e3 * t_s, at(&fitted, pulse.base_radps * t_s)]);
        chart = chart.dots(name, color, measured).line("", color, line);
    }
    let (figures, charts, recorded) = (figures_of(&fit), vec![chart], Some(pulse.clone()));
    let mut outcome = ExperimentResult { figures, charts, recorded, ..ExperimentResult::default() };
    // the spectrum uses more of the trace than the fit does, and needs periods of whole samples
    match spectrum_figures(pulse, &fit) {
        Ok(figures) => outcome.figures.extend(figures),
        Err(fault) => outcome.notes.push(format!("spectrum: {fault}")),
    }
    Ok(outcome)
}

fn figures_of(fit: &TwistFit) -> Vec<Figure> {
    let center_mm = fit.pump.center_of_rotation().map(|center_m| center_m.map(mm_from_m));
    let center = center_mm.into_iter().flat_map(|at| [("x", at.x), ("y", at.y)]);
    let mut found: Vec<Figure> = center.map(|(axis, mm)| figure("COR along {}", mm).of(axis)).collect();
    found.extend(figures([
        ("spin amplitude", fit.pump.spin_radps),
        ("second over first harmonic", fit.quality.harmonic_ratio),
        ("phase of the second harmonic", fit.quality.harmonic_phase_rad.to_degrees()),
        ("residual rms", fit.motion.residual_rms_mps2),
    ]));
    for (name, coefficients) in CHANNEL_NAMES.iter().zip(&fit.accel_mps2) {
        for (wave, value) in ["cos wt", "sin wt", "cos 2wt", "sin 2wt"].iter().zip(coefficients) {
            found.push(Figure::alone(format!("{name}: {wave}"), "m/s²", *value, "least squares, Eq. 12"));
        }
    }
    found
}

/// The fit with the channels' gains corrected.
pub(super) fn fit(pulse: &RecordedPulse) -> Result<TwistFit, FitError> {
    let sensors = AccelerometerPair { position_m: pulse.accelerometer_in_plate_m, gain: pulse.channel_gain };
    fit_twist(&pulse.trace, &pulse.envelope, pulse.base_radps, &sensors)
}

/// Two harmonics at the phase `wt`.
fn at([c1, s1, c2, s2]: &[f64; 4], phase_rad: f64) -> f64 {
    let ((sin1, cos1), (sin2, cos2)) = (phase_rad.sin_cos(), (2.0 * phase_rad).sin_cos());
    c1 * cos1 + s1 * sin1 + c2 * cos2 + s2 * sin2
}

/// Largest deviation of the transformed periods from whole samples.
const UNEVEN_SAMPLES: f64 = 1e-3;
/// Time after the attack that is skipped, s.
const SETTLING_S: f64 = 3e-3;

/// Amplitudes of every channel, corrected for gain, over the last whole base periods at full height, against the fit.
pub(super) fn spectrum_figures(pulse: &RecordedPulse, fit: &TwistFit) -> Result<Vec<Figure>, FitError> {
    let window = whole_periods(pulse)?;
    let mut figures = Vec::new();
    for (channel, shown) in accelerations_mps2(&pulse.trace, &window)?.iter().enumerate() {
        let bins = amplitude_spectrum(shown);
        for (k, harmonic) in [(1, "w"), (2, "2w")] {
            let [c, s] = [0, 1].map(|i| fit.accel_mps2[channel][2 * (k - 1) + i]);
            let name = format!("{}: FFT amplitude at {harmonic}", CHANNEL_NAMES[channel]);
            let bin = bins.get(k * window.periods).map_or(f64::NAN, |bin| bin.norm() / pulse.channel_gain[channel]);
            figures.push(Figure::against(name, "m/s²", bin, c.hypot(s), "least squares, Eq. 12"));
        }
    }
    Ok(figures)
}

/// The longest sequence of whole samples and base periods at full height, the latest one.
fn whole_periods(pulse: &RecordedPulse) -> Result<SteadyWindow, FitError> {
    let (trace, envelope) = (&pulse.trace, &pulse.envelope);
    let index = |t_s: f64| ((t_s - trace.first_sample_s) * trace.sample_hz - 1e-6).ceil().max(0.0) as usize;
    // the force steps where the flank ends, and the motors' low-pass takes a few milliseconds to follow
    let (from, to) =
        (index(envelope.attack_s + SETTLING_S), index(envelope.attack_s + envelope.sustain_s).min(trace.len()));
    let period_samples = TAU / pulse.base_radps * trace.sample_hz;
    let most = (to.saturating_sub(from) as f64 / period_samples + 1e-9) as usize;
    let even = |periods: &usize| {
        let samples = *periods as f64 * period_samples;
        (samples - samples.round()).abs() <= UNEVEN_SAMPLES
    };
    let periods = (2..=most).rev().find(even).ok_or(FitError::Unreadable("no base periods are whole samples"))?;
    let first = to - (periods as f64 * period_samples).round() as usize;
    Ok(SteadyWindow { samples: first..to, start_s: trace.time_s(first), step_s: 1.0 / trace.sample_hz, periods })
}
