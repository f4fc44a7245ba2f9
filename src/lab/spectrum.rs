//! The accelerometers' amplitude spectrum of one pulse, by FFT, compared with the least-squares fit of two harmonics.

use std::f64::consts::TAU;

use super::Figure;
use upm_core::signal::{CHANNEL_NAMES, RecordedPulse};
use upm_perception::estimation::{FitFault, SteadyWindow, TwistFit, accelerations_mps2, amplitude_spectrum};

/// Largest deviation of the transformed periods from whole samples.
const UNEVEN_SAMPLES: f64 = 1e-3;
/// Time after the attack that is skipped, s.
const SETTLING_S: f64 = 3e-3;

/// Amplitudes of every channel, corrected for gain, over the last whole base periods at full height, against the fit.
pub(super) fn spectrum_figures(pulse: &RecordedPulse, fit: &TwistFit) -> Result<Vec<Figure>, FitFault> {
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
fn whole_periods(pulse: &RecordedPulse) -> Result<SteadyWindow, FitFault> {
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
    let periods = (2..=most).rev().find(even).ok_or(FitFault::Unreadable("no base periods are whole samples"))?;
    let first = to - (periods as f64 * period_samples).round() as usize;
    Ok(SteadyWindow { samples: first..to, start_s: trace.time_s(first), step_s: 1.0 / trace.sample_hz, periods })
}
