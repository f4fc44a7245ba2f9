//! The accelerometers' amplitude spectrum of one pulse, by FFT, compared with the least-squares fit of two harmonics.

use std::f64::consts::TAU;

use super::{ExperimentResult, Figure};
use upm_chart::{Axis, Chart, Color};
use upm_core::signal::{CHANNEL_NAMES, CHANNELS, RecordedPulse};
use upm_perception::estimation::{FitFault, SteadyWindow, TwistFit, accelerations_mps2, amplitude_spectrum};

/// Largest deviation of the transformed periods from whole samples.
const UNEVEN_SAMPLES: f64 = 1e-3;
/// Highest harmonic excluded, with those below it, from the noise floor.
const LAST_HARMONIC: usize = 4;
/// Lowest amplitude drawn, m/s².
const LEAST_DRAWN_MPS2: f64 = 1e-4;
/// Time after the attack that is skipped, s.
const SETTLING_S: f64 = 3e-3;

/// Amplitudes of every channel, corrected for gain, over the last whole base periods at full height.
#[derive(Clone, Debug)]
pub(super) struct TraceSpectrum {
    /// Base periods transformed: the bin of harmonic k is `k · periods`.
    periods: usize,
    hz: Vec<f64>,
    amplitude_mps2: [Vec<f64>; CHANNELS],
    samples: usize,
}

impl TraceSpectrum {
    pub fn of(pulse: &RecordedPulse) -> Result<Self, FitFault> {
        let window = whole_periods(pulse)?;
        let channels = accelerations_mps2(&pulse.trace, &window)?;
        let samples = window.samples.len();
        let amplitudes = |channel: usize| -> Vec<f64> {
            let gain = pulse.channel_gain[channel];
            amplitude_spectrum(&channels[channel]).iter().map(|bin| bin.norm() / gain).collect()
        };
        let bin_hz = 1.0 / (samples as f64 * window.step_s);
        Ok(Self {
            periods: window.periods,
            hz: (0..=samples / 2).map(|k| k as f64 * bin_hz).collect(),
            amplitude_mps2: std::array::from_fn(amplitudes),
            samples,
        })
    }

    /// Standard deviation of the white noise with the measured floor above the fourth harmonic, between the harmonics,
    /// m/s² a sample: its mean square amplitude in a bin is `4 sd²/N`.
    pub fn noise_mps2(&self) -> f64 {
        let above = LAST_HARMONIC * self.periods + 1;
        let floor = |amplitudes: &Vec<f64>| -> Vec<f64> {
            let bins = amplitudes.iter().enumerate().skip(above);
            bins.filter(|(k, _)| k % self.periods != 0).map(|(_, a)| a * a).collect()
        };
        let squares: Vec<f64> = self.amplitude_mps2.iter().flat_map(floor).collect();
        let mean = squares.iter().sum::<f64>() / squares.len().max(1) as f64;
        (0.25 * mean * self.samples as f64).sqrt()
    }

    /// Adds figures and chart to `outcome`, whose fit is `fit`.
    pub fn add_to(&self, outcome: &mut ExperimentResult, fit: &TwistFit) {
        for (channel, (name, amplitudes)) in CHANNEL_NAMES.iter().zip(&self.amplitude_mps2).enumerate() {
            for (k, harmonic) in [(1, "w"), (2, "2w")] {
                let [c, s] = [0, 1].map(|i| fit.accel_mps2[channel][2 * (k - 1) + i]);
                let bin = amplitudes.get(k * self.periods).copied().unwrap_or(f64::NAN);
                let name = format!("{name}: FFT amplitude at {harmonic}");
                outcome.figures.push(Figure::against(name, "m/s²", bin, c.hypot(s), "least squares, Eq. 12"));
            }
        }
        let source = "floor of the spectrum above 4w, between harmonics";
        outcome.figures.push(Figure::alone("noise of a sample", "m/s²", self.noise_mps2(), source));
        outcome.charts.push(self.chart());
    }

    fn chart(&self) -> Chart {
        let drawn = |amplitude_mps2: f64| amplitude_mps2.max(LEAST_DRAWN_MPS2);
        let axes = [Axis::log("frequency (Hz)"), Axis::log("amplitude (m/s²)")];
        let title = "Amplitude spectrum of the accelerations; dots mark the harmonics w and 2w";
        let mut chart = Chart::over("waveform-fit-spectrum", title, axes);
        for (channel, (name, amplitudes)) in CHANNEL_NAMES.iter().zip(&self.amplitude_mps2).enumerate() {
            let mut bins = self.hz.iter().zip(amplitudes).map(|(&hz, &amplitude)| [hz, drawn(amplitude)]);
            let harmonics = [1, 2].iter().filter_map(|k| bins.clone().nth(k * self.periods));
            let (color, harmonics) = (Color::nth(channel), harmonics.collect::<Vec<_>>());
            bins.next();
            chart = chart.line(name, color, bins).dots("", color, harmonics);
        }
        let floor_mps2 = drawn(self.noise_mps2() * 2.0 / (self.samples as f64).sqrt());
        let ends = [1, self.hz.len() - 1].map(|k| [self.hz[k], floor_mps2]);
        chart.dashes("noise floor", Color::Gray, ends)
    }
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
