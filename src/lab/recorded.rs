use super::spectrum::TraceSpectrum;
use super::{ExperimentResult, Figure, LabFault};
use upm_chart::{Chart, Color, Layer, Mark};
use upm_core::signal::{CHANNEL_NAMES, RecordedPulse};
use upm_core::units::mm_from_m;
use upm_perception::estimation::{
    AccelerometerPair, FitFault, TwistFit, accelerations_mps2, fit_twist, sustain_window,
};

/// Determines the plate's motion from a trace recorded on any rig (UPM paper, section 3.2, App. B and C).
///
/// # Errors
///
/// [`LabFault::Trace`] for a trace that [`fit_twist`] cannot evaluate. A spectrum that cannot be computed is only
/// noted.
pub fn waveform_fit_of(pulse: &RecordedPulse) -> Result<ExperimentResult, LabFault> {
    let fault = |fault| LabFault::Trace { what: "recorded pulse".to_owned(), fault };
    let fit = fit(pulse).map_err(fault)?;
    let window = sustain_window(&pulse.trace, &pulse.envelope, pulse.base_radps).map_err(fault)?;
    let shown = accelerations_mps2(&pulse.trace, &window).map_err(fault)?;
    let times_s: Vec<f64> = window.times_s().collect();
    let (mut layers, mut velocity_layers) = (Vec::new(), Vec::new());
    let mut off_mps = 0.0f64;
    for (channel, (name, shown)) in CHANNEL_NAMES.iter().zip(shown).enumerate() {
        let (gain, color) = (pulse.channel_gain[channel], Color::nth(channel));
        let curves = Curves::new(&times_s, &shown, gain, &fit.accel_mps2[channel], pulse.base_radps);
        off_mps = off_mps.max(curves.integral_off_mps());
        layers.push(Layer::new(name, Mark::Dots, color, points(&times_s, &curves.measured_mps2)));
        layers.push(Layer::new("", Mark::Line, color, points(&times_s, &curves.fitted_mps2)));
        velocity_layers.push(Layer::new(name, Mark::Dots, color, points(&times_s, &curves.integral_mps)));
        velocity_layers.push(Layer::new("", Mark::Line, color, points(&times_s, &curves.fitted_mps)));
    }
    let (time, accel) = ("time from the start of the pulse (ms)", "acceleration (m/s²)");
    let (of_accels, of_velocities) = (
        "Accelerations without their mean, and the two harmonics fitted to them",
        "Velocities: accelerations integrated, and Eq. 13 (Fig. 7c)",
    );
    let chart = Chart::plot("waveform-fit", of_accels, [time, accel]).with(layers);
    let velocities =
        Chart::plot("waveform-fit-velocity", of_velocities, [time, "velocity (m/s)"]).with(velocity_layers);
    let (charts, recorded) = (vec![chart, velocities], Some(pulse.clone()));
    let mut outcome = ExperimentResult { figures: figures(&fit), charts, recorded, ..ExperimentResult::default() };
    let source = "rms, trapezoids against the fit's coefficients";
    outcome.figures.push(Figure::alone("velocity integral off Eq. 13, largest", "m/s", off_mps, source));
    match TraceSpectrum::of(pulse) {
        Ok(spectrum) => spectrum.add_to(&mut outcome, &fit),
        // the spectrum uses more of the trace than the fit does, and needs periods of whole samples
        Err(fault) => outcome.notes.push(format!("spectrum: {fault}")),
    }
    Ok(outcome)
}

/// Acceleration and velocity of one channel, as measured and as fitted.
struct Curves {
    measured_mps2: Vec<f64>,
    fitted_mps2: Vec<f64>,
    integral_mps: Vec<f64>,
    fitted_mps: Vec<f64>,
}

impl Curves {
    fn new(times_s: &[f64], shown_mps2: &[f64], gain: f64, fit_mps2: &[f64; 4], base_radps: f64) -> Self {
        let mean = shown_mps2.iter().sum::<f64>() / shown_mps2.len().max(1) as f64;
        let measured_mps2: Vec<f64> = shown_mps2.iter().map(|shown| (shown - mean) / gain).collect();
        let fitted = |of: &[f64; 4]| times_s.iter().map(|t_s| at(of, base_radps * t_s)).collect();
        Self {
            integral_mps: integral(times_s, &measured_mps2),
            measured_mps2,
            fitted_mps2: fitted(fit_mps2),
            fitted_mps: fitted(&velocity_mps(fit_mps2, base_radps)),
        }
    }

    /// Root mean square of the difference between the two velocities, m/s.
    fn integral_off_mps(&self) -> f64 {
        let squares = self.integral_mps.iter().zip(&self.fitted_mps).map(|(a, b)| (a - b).powi(2));
        (squares.sum::<f64>() / self.fitted_mps.len().max(1) as f64).sqrt()
    }
}

/// Integral of `values` over their times by trapezoids, less its mean.
fn integral(times_s: &[f64], values: &[f64]) -> Vec<f64> {
    let areas =
        times_s.windows(2).zip(values.windows(2)).map(|(t_s, value)| 0.5 * (value[0] + value[1]) * (t_s[1] - t_s[0]));
    let mut sum = 0.0;
    let sums = std::iter::once(0.0).chain(areas).map(|area| {
        sum += area;
        sum
    });
    let sums: Vec<f64> = sums.take(times_s.len()).collect();
    let mean = sums.iter().sum::<f64>() / sums.len().max(1) as f64;
    sums.into_iter().map(|sum| sum - mean).collect()
}

/// Coefficients of the velocity of a channel from those of its acceleration (Eq. 13), m/s.
fn velocity_mps([c1, s1, c2, s2]: &[f64; 4], base_radps: f64) -> [f64; 4] {
    [-s1, *c1, -0.5 * s2, 0.5 * c2].map(|accel_mps2| accel_mps2 / base_radps)
}

/// Values over milliseconds.
fn points(times_s: &[f64], values: &[f64]) -> Vec<[f64; 2]> {
    times_s.iter().zip(values).map(|(t, &value)| [t * 1e3, value]).collect()
}

fn figures(fit: &TwistFit) -> Vec<Figure> {
    let mut figures = Vec::new();
    if let Some(center_m) = fit.pump.center_of_rotation() {
        let source = "least squares, Eq. 12, 13 and 6";
        figures.push(Figure::alone("COR along x", "mm", mm_from_m(center_m.x), source));
        figures.push(Figure::alone("COR along y", "mm", mm_from_m(center_m.y), source));
    }
    let quality = &fit.quality;
    figures.push(Figure::alone("spin amplitude", "rad/s", fit.pump.spin_radps, "sign by the force test, Eq. 14"));
    figures.push(Figure::against("second over first harmonic", "1", quality.harmonic_ratio, 0.5, "UPM paper, Eq. 5"));
    let phase_deg = quality.harmonic_phase_rad.to_degrees();
    figures.push(Figure::against("phase of the second harmonic", "deg", phase_deg, 0.0, "UPM paper, Eq. 5"));
    figures.push(Figure::alone("residual rms", "m/s²", fit.residual_rms_mps2, "trace less harmonics and drift"));
    for (name, coefficients) in CHANNEL_NAMES.iter().zip(&fit.accel_mps2) {
        for (wave, value) in ["cos wt", "sin wt", "cos 2wt", "sin 2wt"].iter().zip(coefficients) {
            figures.push(Figure::alone(format!("{name}: {wave}"), "m/s²", *value, "least squares, Eq. 12"));
        }
    }
    figures
}

/// The fit with the channels' gains corrected.
pub(super) fn fit(pulse: &RecordedPulse) -> Result<TwistFit, FitFault> {
    let sensors = AccelerometerPair { position_m: pulse.accelerometer_in_plate_m, gain: pulse.channel_gain };
    fit_twist(&pulse.trace, &pulse.envelope, pulse.base_radps, &sensors)
}

/// Two harmonics at the phase `wt`.
fn at([c1, s1, c2, s2]: &[f64; 4], phase_rad: f64) -> f64 {
    let ((sin1, cos1), (sin2, cos2)) = (phase_rad.sin_cos(), (2.0 * phase_rad).sin_cos());
    c1 * cos1 + s1 * sin1 + c2 * cos2 + s2 * sin2
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::measured;
    use std::f64::consts::TAU;
    use upm_core::geometry::{Twist, Vec2};
    use upm_core::signal::{AccelTrace, CHANNELS, Envelope};

    /// Accelerations `w T(p) (sin 2wt - sin wt)` of a pump wave about `center_m`, through channels of these gains.
    fn pump_trace(center_m: Vec2, spin_radps: f64, channel_gain: [f64; CHANNELS]) -> RecordedPulse {
        let (place_m, base_radps) = (Vec2::new(-0.09, 0.08), TAU * 55.0);
        let twist = Twist::about(center_m, spin_radps);
        let (one, two) = (twist.velocity_at(place_m), twist.velocity_at(-place_m));
        let (sample_hz, mps2_per_count) = (4000.0, 0.002);
        let sample = |amplitude_mps: f64, gain: f64| {
            let count = move |i: i32| {
                let phase = base_radps * f64::from(i) / sample_hz;
                let accel = base_radps * amplitude_mps * ((2.0 * phase).sin() - phase.sin());
                (gain * accel / mps2_per_count).round() as i16
            };
            (0..600).map(count).collect::<Vec<i16>>()
        };
        let amplitudes = [one.x, one.y, two.x, two.y];
        let counts = std::array::from_fn(|channel| sample(amplitudes[channel], channel_gain[channel]));
        let trace = AccelTrace { sample_hz, first_sample_s: 0.0, mps2_per_count, count_limit: 32767, counts };
        let envelope = Envelope { attack_s: 0.02, sustain_s: 0.1, rest_s: 0.0 };
        RecordedPulse { trace, envelope, base_radps, accelerometer_in_plate_m: place_m, channel_gain }
    }

    #[test]
    fn pump_wave_is_recovered_despite_unequal_channel_gains() {
        for gain in [[1.0; CHANNELS], [1.04, 0.97, 1.0, 0.92]] {
            let outcome = waveform_fit_of(&pump_trace(Vec2::new(0.04, -0.03), -0.15, gain)).unwrap();
            let read = ["COR along x", "COR along y", "spin amplitude"].map(|name| measured(&outcome, name));
            for (read, expected) in read.into_iter().zip([40.0, -30.0, -0.15]) {
                assert!((read - expected).abs() < 1e-3 * expected.abs(), "{read} {expected}");
            }
            assert!((measured(&outcome, "second over first harmonic") - 0.5).abs() < 1e-3);
            assert!(measured(&outcome, "residual rms") < 0.002);
            let largest_mps = 0.15 * 0.2;
            assert!(measured(&outcome, "velocity integral off Eq. 13, largest") < 0.01 * largest_mps);
        }
    }
}
