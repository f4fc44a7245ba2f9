//! Choice of the samples of a trace to evaluate, and their conversion to m/s².

use std::f64::consts::TAU;
use std::ops::Range;

use super::FitError;
use upm_core::signal::{AccelTrace, CHANNEL_NAMES, CHANNELS, Envelope, MISSING_SAMPLE};

/// Most base periods in one fit. The plate's own resonance, excited by the attack, decays through the sustain; a short
/// polynomial follows it over three periods, but not over six.
pub const MAX_PERIODS: usize = 3;

/// A stretch of whole base periods at full height.
#[derive(Clone, Debug, PartialEq)]
pub struct SteadyWindow {
    /// Indices of the samples.
    pub samples: Range<usize>,
    /// Time of the first sample after the start of the pulse, s.
    pub start_s: f64,
    /// Time between samples, s.
    pub step_s: f64,
    /// Base periods, 1 to [`MAX_PERIODS`].
    pub periods: usize,
}

impl SteadyWindow {
    /// Times of the samples after the start of the pulse, s.
    pub fn times_s(&self) -> impl Iterator<Item = f64> + '_ {
        (0..self.samples.len()).map(|i| self.start_s + i as f64 * self.step_s)
    }
}

/// The latest whole base periods at full height in `trace`, [`MAX_PERIODS`] at most. The latest, because low-pass and
/// plate have then had the longest time to settle.
///
/// # Errors
///
/// [`FitError::Unreadable`] for sample times that are not numbers, and for a base frequency that is not positive or has
/// fewer than 16 samples to its period; [`FitError::TooShort`] for less than one base period at full height.
pub fn sustain_window(trace: &AccelTrace, envelope: &Envelope, base_radps: f64) -> Result<SteadyWindow, FitError> {
    if !(trace.sample_hz.is_finite() && trace.sample_hz > 0.0 && trace.first_sample_s.is_finite()) {
        return Err(FitError::Unreadable("sample times are not numbers"));
    }
    // Four coefficients and a drift need a sampling rate well above the second harmonic.
    if !(base_radps > 0.0 && trace.sample_hz * TAU >= 16.0 * base_radps) {
        return Err(FitError::Unreadable("fewer than 16 samples to the base period"));
    }
    let (step_s, period_s) = (1.0 / trace.sample_hz, TAU / base_radps);
    let from = sample_index(trace, envelope.attack_s);
    let to = sample_index(trace, envelope.attack_s + envelope.sustain_s).min(trace.len());
    let found_s = to.saturating_sub(from) as f64 * step_s;
    // Half a sample of tolerance: whole periods are seldom whole samples.
    let periods = (((found_s + 0.5 * step_s) / period_s) as usize).min(MAX_PERIODS);
    if periods == 0 {
        return Err(FitError::TooShort { found_s, needed_s: period_s });
    }
    let length = (periods as f64 * period_s * trace.sample_hz).round() as usize;
    let first = to.saturating_sub(length).max(from);
    Ok(SteadyWindow { samples: first..to, start_s: trace.time_s(first), step_s, periods })
}

/// Index of the first sample not before `t_s`; 0 for times before the trace.
fn sample_index(trace: &AccelTrace, t_s: f64) -> usize {
    ((t_s - trace.first_sample_s) * trace.sample_hz - 1e-6).ceil().max(0.0) as usize
}

/// The samples of `window` in m/s², channel by channel.
///
/// # Errors
///
/// [`FitError::Missing`] or [`FitError::Clipped`] of the first channel with a single such sample: a fit that
/// interpolated it would be wrong without any indication. Samples beyond the end of the trace are missing.
pub fn accelerations_mps2(trace: &AccelTrace, window: &SteadyWindow) -> Result<[Vec<f64>; CHANNELS], FitError> {
    let mut accelerations = [const { Vec::new() }; CHANNELS];
    for ((channel, counts), out) in CHANNEL_NAMES.into_iter().zip(&trace.counts).zip(&mut accelerations) {
        let counts = counts.get(window.samples.clone()).unwrap_or_default();
        let missing =
            counts.iter().filter(|&&count| count == MISSING_SAMPLE).count() + window.samples.len() - counts.len();
        if missing > 0 {
            return Err(FitError::Missing { channel, samples: missing });
        }
        let limit = trace.count_limit;
        let clipped = counts.iter().filter(|count| count.unsigned_abs() >= limit.unsigned_abs()).count();
        if clipped > 0 {
            return Err(FitError::Clipped { channel, samples: clipped, limit });
        }
        out.extend(counts.iter().map(|&count| f64::from(count) * trace.mps2_per_count));
    }
    Ok(accelerations)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn is_silent(samples: usize) -> AccelTrace {
        AccelTrace {
            sample_hz: 5000.0,
            first_sample_s: 0.0,
            mps2_per_count: 60.0 / 1024.0,
            count_limit: 1023,
            counts: std::array::from_fn(|_| vec![0; samples]),
        }
    }

    const PULSE: Envelope = Envelope { attack_s: 0.02, sustain_s: 0.1, rest_s: 0.05 };

    proptest! {
        #[test]
        fn window_is_whole_periods_at_full_height(
            attack_s in 0.0..0.05f64, sustain_s in 0.0..0.3f64, first_sample_s in -0.001..0.04f64,
            samples in 0..2000usize, hz in 20.0..150.0f64,
        ) {
            let envelope = Envelope { attack_s, sustain_s, rest_s: 0.05 };
            let trace = AccelTrace { first_sample_s, ..is_silent(samples) };
            match sustain_window(&trace, &envelope, TAU * hz) {
                Ok(window) => {
                    prop_assert!(window.samples.end <= samples);
                    prop_assert!((1..=MAX_PERIODS).contains(&window.periods));
                    for t_s in window.times_s() {
                        prop_assert!(t_s > attack_s - 1e-6 && t_s < attack_s + sustain_s + 1e-6);
                    }
                    let span_s = window.samples.len() as f64 / trace.sample_hz;
                    prop_assert!((span_s * hz - window.periods as f64).abs() <= 0.51 * hz / trace.sample_hz);
                }
                Err(FitError::TooShort { found_s, needed_s }) => prop_assert!(found_s < needed_s),
                Err(other) => prop_assert!(false, "{other}"),
            }
        }
    }

    #[test]
    fn one_bad_sample_inside_spoils_it_and_outside_does_not() {
        let window = sustain_window(&is_silent(1000), &PULSE, TAU * 50.0).unwrap();
        for (at, count, fault) in [
            (299, MISSING_SAMPLE, None),
            (600, 1023, None),
            (300, MISSING_SAMPLE, Some(FitError::Missing { channel: "x2", samples: 1 })),
            (599, 1023, Some(FitError::Clipped { channel: "x2", samples: 1, limit: 1023 })),
            (400, -1024, Some(FitError::Clipped { channel: "x2", samples: 1, limit: 1023 })),
        ] {
            let mut trace = is_silent(1000);
            trace.counts[2][at] = count;
            assert_eq!(accelerations_mps2(&trace, &window).err(), fault);
        }
    }
}
