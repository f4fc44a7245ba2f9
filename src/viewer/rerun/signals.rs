use re_sdk_types::archetypes::{SeriesLines, SeriesPoints};

use super::paint;
use super::run_stream::{LogResult, RunStream, nanos};
use upm_control::PulseFacts;
use upm_core::signal::{AccelTrace, Drive, MISSING_SAMPLE, MOTORS};
use upm_perception::estimation::PlateFit;

/// Least number of samples of a motor's waveform per second, and per period of its highest harmonic.
const MOTOR_HZ: f64 = 1000.0;
const MOTOR_SAMPLES_A_PERIOD: f64 = 8.0;

/// Number of base periods of a trace that are recorded, in the middle of the sustain.
const TRACE_PERIODS: f64 = 4.0;
/// Largest number of samples of a trace per second.
const TRACE_HZ: f64 = 2500.0;

/// Entities of the two accelerometers; each has x and y.
const ACCELEROMETERS: [&str; 2] = ["accelerometers/1", "accelerometers/2"];

/// Logs names and colours of the series.
pub(super) fn start(stream: &RunStream) -> LogResult {
    let names = ["X1", "X2", "Y1", "Y2"];
    let lines = SeriesLines::new().with_names(names).with_colors(paint::series(MOTORS)).with_widths([1.0]);
    stream.log_static("motors", &lines)?;
    for entity in ACCELEROMETERS {
        let dots = SeriesPoints::new().with_names(["x measured", "y measured"]).with_marker_sizes([2.0]);
        stream.log_static(&format!("{entity}/measured"), &dots.with_colors(paint::series(2)))?;
        let lines = SeriesLines::new().with_names(["x fitted", "y fitted"]).with_widths([1.0]);
        stream.log_static(&format!("{entity}/fitted"), &lines.with_colors(paint::series(2)))?;
    }
    Ok(())
}

/// Logs the signals of a pulse: the drive of the motors and the accelerometers' trace.
pub(super) fn pulse(stream: &RunStream, pulse: &PulseFacts) -> LogResult {
    let start_ns = nanos(pulse.started_at);
    let (times_s, counts) = motor_samples(&pulse.drive);
    stream.log_scalars("motors", times_ns(start_ns, &times_s), counts, MOTORS)?;
    let window = trace_window(&pulse.drive, &pulse.trace);
    let times_s: Vec<f64> = window.iter().map(|&i| pulse.trace.time_s(i)).collect();
    // a last sample that is not a number ends the line, so that it is not connected to the next pulse
    let end_s = times_s.last().map_or(0.0, |last| last + 1.0 / pulse.trace.sample_hz);
    let ended_s = [&times_s[..], &[end_s]].concat();
    for (entity, channels) in ACCELEROMETERS.into_iter().zip([[0, 1], [2, 3]]) {
        let measured = |channel| window.iter().map(|&i| measured_mps2(&pulse.trace, channel, i)).collect();
        let values = interleaved(channels.map(measured));
        stream.log_scalars(&format!("{entity}/measured"), times_ns(start_ns, &times_s), values, 2)?;
        if let Ok(fit) = &pulse.fit {
            let fitted = |channel| times_s.iter().map(|&t| fitted_mps2(fit, channel, t)).chain([f64::NAN]).collect();
            let values = interleaved(channels.map(fitted));
            stream.log_scalars(&format!("{entity}/fitted"), times_ns(start_ns, &ended_s), values, 2)?;
        }
    }
    Ok(())
}

/// Times on Rerun's timeline, ns.
fn times_ns(start_ns: i64, times_s: &[f64]) -> impl ExactSizeIterator<Item = i64> {
    times_s.iter().map(move |t| start_ns + (t * 1e9).round() as i64)
}

fn interleaved(pair: [Vec<f64>; 2]) -> impl Iterator<Item = f64> {
    let [first, second] = pair;
    first.into_iter().zip(second).flat_map(|(a, b)| [a, b])
}

/// Times after the start, s, and whole counts, for each motor, from silence to silence.
fn motor_samples(drive: &Drive) -> (Vec<f64>, Vec<f64>) {
    let harmonics = drive.motors.iter().map(Vec::len).max().unwrap_or(0) as f64;
    let top_hz = harmonics * drive.base_radps / std::f64::consts::TAU;
    let sample_hz = MOTOR_HZ.max(MOTOR_SAMPLES_A_PERIOD * top_hz);
    let driven_s = drive.envelope.driven_s();
    let steps = (driven_s * sample_hz).ceil() as usize;
    let times_s: Vec<f64> = (0..=steps).map(|i| (i as f64 / sample_hz).min(driven_s)).collect();
    let counts = times_s.iter().flat_map(|&t_s| drive.counts_at(t_s).map(f64::round));
    let counts = counts.collect();
    (times_s, counts)
}

/// Indices of the samples in the middle of the sustain, thinned out.
fn trace_window(drive: &Drive, trace: &AccelTrace) -> Vec<usize> {
    let half_s = (0.5 * TRACE_PERIODS * std::f64::consts::TAU / drive.base_radps).min(0.5 * drive.envelope.sustain_s);
    let middle_s = drive.envelope.attack_s + 0.5 * drive.envelope.sustain_s;
    let stride = ((trace.sample_hz / TRACE_HZ) as usize).max(1);
    let inside = |&i: &usize| (trace.time_s(i) - middle_s).abs() <= half_s;
    (0..trace.len()).step_by(stride).filter(inside).collect()
}

fn measured_mps2(trace: &AccelTrace, channel: usize, i: usize) -> f64 {
    match trace.counts[channel].get(i) {
        Some(&count) if count != MISSING_SAMPLE => f64::from(count) * trace.mps2_per_count,
        _ => f64::NAN,
    }
}

/// `c1 cos wt + s1 sin wt + c2 cos 2wt + s2 sin 2wt` (Eq. 12), continued for as many harmonics as were fitted.
fn fitted_mps2(fit: &PlateFit, channel: usize, t_s: f64) -> f64 {
    let motion = fit.motion();
    let harmonic = |(k, [c, s]): (u32, &[f64; 2])| {
        let (sin, cos) = libm::sincos(f64::from(k) * motion.wave.base_radps * t_s);
        c * cos + s * sin
    };
    (1..).zip(&motion.accel_mps2[channel]).map(harmonic).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use upm_core::signal::{Envelope, Harmonic};

    #[test]
    fn motor_samples_start_and_end_at_zero() {
        let wave = vec![Harmonic { cos: 100.0, sin: 0.0 }; 2];
        let drive = Drive {
            base_radps: 377.0,
            motors: [wave.clone(), wave.clone(), wave.clone(), wave],
            shaping: Default::default(),
            envelope: Envelope { attack_s: 0.01, sustain_s: 0.0305, rest_s: 0.1 },
        };
        let (times_s, counts) = motor_samples(&drive);
        assert_eq!(counts.len(), MOTORS * times_s.len());
        assert_eq!((times_s.first(), times_s.last()), (Some(&0.0), Some(&drive.envelope.driven_s())));
        assert!(counts[..MOTORS].iter().chain(&counts[counts.len() - MOTORS..]).all(|&count| count == 0.0));
        assert!(counts.iter().all(|count| count.fract() == 0.0));
    }
}
