use re_sdk_types::archetypes::{SeriesLines, SeriesPoints};

use super::paint;
use super::run_stream::{LogResult, RunStream, nanos};
use upm_control::PulseFacts;
use upm_core::signal::{AccelTrace, Drive, Envelope, Follows, MISSING_SAMPLE, MOTORS};
use upm_perception::estimation::PlateFit;
use upm_planning::planner::PlannedPulse;

/// Least number of samples of a motor's waveform per second, and per period of its highest harmonic.
const MOTOR_HZ: f64 = 1000.0;
const MOTOR_SAMPLES_A_PERIOD: f64 = 8.0;

/// Number of base periods of a trace that are recorded, in the middle of the sustain. Of a motion without a pause its
/// rise, which is all of it that is read: it fades from then on.
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

/// The drives as they are played. A pulse is held back until the next one comes, which may take over from it.
#[derive(Default)]
pub(super) struct Drives {
    fading: Option<PlayedDrive>,
    last: Option<PlayedDrive>,
}

/// Times on Rerun's timeline, ns, and whole counts, for each motor.
type MotorSamples = (Vec<i64>, Vec<f64>);

struct PlayedDrive {
    drive: Drive,
    start_ns: i64,
}

impl PlayedDrive {
    fn counts_at(&self, at_ns: i64) -> [f64; MOTORS] {
        self.drive.counts_at((at_ns - self.start_ns) as f64 * 1e-9)
    }
}

impl Drives {
    fn next(&mut self, start_ns: i64, drive: &Drive) -> MotorSamples {
        let played = self.last_until(start_ns);
        self.last = Some(PlayedDrive { drive: drive.clone(), start_ns });
        played
    }

    /// Logs the last pulse to its end.
    pub(super) fn end(&mut self, stream: &RunStream) {
        let (times_ns, counts) = self.last_until(i64::MAX);
        stream.log_scalars("motors", times_ns, counts);
    }

    /// The last pulse, with the one that decays while it rises, until one at `next_ns` takes over.
    fn last_until(&mut self, next_ns: i64) -> MotorSamples {
        let Some(mut last) = self.last.take() else { return MotorSamples::default() };
        let mut times_ns: Vec<i64> = times_ns(last.start_ns, &motor_times_s(&last.drive)).collect();
        let is_taken_over = times_ns.last().is_some_and(|end_ns| next_ns < *end_ns);
        if is_taken_over {
            let envelope = &mut last.drive.envelope;
            envelope.sustain_s = ((next_ns - last.start_ns) as f64 * 1e-9 - envelope.attack_s).max(0.0);
            times_ns.retain(|at_ns| *at_ns < next_ns);
        }
        let fading = self.fading.take();
        let played = |&at_ns: &i64| {
            let fading = fading.as_ref().map_or([0.0; MOTORS], |fading| fading.counts_at(at_ns));
            // the generator rounds their sum
            std::iter::zip(last.counts_at(at_ns), fading).map(|(rising, fading)| (rising + fading).round())
        };
        let counts = times_ns.iter().flat_map(played).collect();
        self.fading = is_taken_over.then_some(last);
        (times_ns, counts)
    }
}

/// Logs the signals of a pulse: the drive of the motors and the accelerometers' trace.
pub(super) fn pulse(stream: &RunStream, pulse: &PulseFacts, drives: &mut Drives) {
    let start_ns = nanos(pulse.started_at);
    let (motor_times_ns, counts) = drives.next(start_ns, &pulse.drive);
    stream.log_scalars("motors", motor_times_ns, counts);
    let is_segment = matches!(&pulse.planned, PlannedPulse::Field(field) if field.follows == Follows::Displacement);
    let window = trace_window(&pulse.drive, &pulse.trace, is_segment);
    let times_s: Vec<f64> = window.iter().map(|&i| pulse.trace.time_s(i)).collect();
    // a last sample that is not a number ends the line, so that it is not connected to the next pulse
    let ended_s = [&times_s[..], &[times_s.last().map_or(0.0, |last| last + 1.0 / pulse.trace.sample_hz)]].concat();
    let fitted = |fit| times_s.iter().map(|&t_s| fitted_mps2(fit, t_s)).chain([[f64::NAN; 4]]).collect::<Vec<_>>();
    let fitted = pulse.fit.as_ref().ok().map(fitted);
    for (entity, channels) in ACCELEROMETERS.into_iter().zip([[0, 1], [2, 3]]) {
        let measured = window.iter().flat_map(|&i| channels.map(|channel| measured_mps2(&pulse.trace, channel, i)));
        stream.log_scalars(&format!("{entity}/measured"), times_ns(start_ns, &times_s), measured);
        if let Some(fitted) = &fitted {
            let fitted = fitted.iter().flat_map(|sample| channels.map(|channel| sample[channel]));
            stream.log_scalars(&format!("{entity}/fitted"), times_ns(start_ns, &ended_s), fitted);
        }
    }
}

/// Times on Rerun's timeline, ns.
fn times_ns(start_ns: i64, times_s: &[f64]) -> impl ExactSizeIterator<Item = i64> {
    times_s.iter().map(move |t| start_ns + (t * 1e9).round() as i64)
}

/// Times after the start at which the motors' waveforms are recorded, s, from silence to silence.
fn motor_times_s(drive: &Drive) -> Vec<f64> {
    let harmonics = drive.motors.iter().map(Vec::len).max().unwrap_or(0) as f64;
    let top_hz = harmonics * drive.base_radps / std::f64::consts::TAU;
    let sample_hz = MOTOR_HZ.max(MOTOR_SAMPLES_A_PERIOD * top_hz);
    let driven_s = drive.envelope.driven_s();
    let steps = (driven_s * sample_hz).ceil() as usize;
    (0..=steps).map(|i| (i as f64 / sample_hz).min(driven_s)).collect()
}

/// Indices of the samples in the middle of the sustain, or of the attack, thinned out.
fn trace_window(drive: &Drive, trace: &AccelTrace, in_attack: bool) -> Vec<usize> {
    let Envelope { attack_s, sustain_s, .. } = drive.envelope;
    let (from_s, length_s) = if in_attack { (0.0, attack_s) } else { (attack_s, sustain_s) };
    let half_s = 0.5 * (TRACE_PERIODS * std::f64::consts::TAU / drive.base_radps).min(length_s);
    let stride = ((trace.sample_hz / TRACE_HZ) as usize).max(1);
    let inside = |&i: &usize| (trace.time_s(i) - from_s - 0.5 * length_s).abs() <= half_s;
    (0..trace.len()).step_by(stride).filter(inside).collect()
}

fn measured_mps2(trace: &AccelTrace, channel: usize, i: usize) -> f64 {
    match trace.counts[channel].get(i) {
        Some(&count) if count != MISSING_SAMPLE => f64::from(count) * trace.mps2_per_count,
        _ => f64::NAN,
    }
}

/// `c1 cos wt + s1 sin wt + c2 cos 2wt + s2 sin 2wt` (Eq. 12) in each channel, continued for as many harmonics as were
/// fitted.
fn fitted_mps2(fit: &PlateFit, t_s: f64) -> [f64; 4] {
    let motion = fit.motion();
    let (sin, cos) = libm::sincos(motion.wave.base_radps * t_s);
    let next = |&(sin_k, cos_k): &(f64, f64)| Some((sin_k * cos + cos_k * sin, cos_k * cos - sin_k * sin));
    let multiples = std::iter::successors(Some((sin, cos)), next);
    let sum = |channel: &Vec<[f64; 2]>| {
        channel.iter().zip(multiples.clone()).map(|([c, s], (sin, cos))| c * cos + s * sin).sum()
    };
    motion.accel_mps2.each_ref().map(sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use upm_core::signal::Harmonic;

    fn drive() -> Drive {
        let wave = vec![Harmonic { cos: 100.0, sin: 0.0 }; 2];
        Drive {
            base_radps: 377.0,
            motors: [wave.clone(), wave.clone(), wave.clone(), wave],
            shaping: Default::default(),
            envelope: Envelope { attack_s: 0.01, sustain_s: 0.0305, rest_s: 0.1 },
        }
    }

    #[test]
    fn motor_samples_start_and_end_at_zero() {
        let mut drives = Drives::default();
        assert!(drives.next(5, &drive()).0.is_empty(), "held back");
        let (times_ns, counts) = drives.last_until(i64::MAX);
        assert_eq!(counts.len(), MOTORS * times_ns.len());
        let end_ns = 5 + (drive().envelope.driven_s() * 1e9).round() as i64;
        assert_eq!((times_ns.first(), times_ns.last()), (Some(&5), Some(&end_ns)));
        assert!(counts[..MOTORS].iter().chain(&counts[counts.len() - MOTORS..]).all(|&count| count == 0.0));
        assert!(counts.iter().all(|count| count.fract() == 0.0) && counts.iter().any(|count| *count > 90.0));
    }

    #[test]
    fn of_a_trace_the_middle_of_the_sustain_is_shown_or_the_rise_of_a_motion_without_pauses() {
        let counts = [(); 4].map(|()| vec![1; 26]);
        let trace =
            AccelTrace { sample_hz: 1000.0, mps2_per_count: 0.01, count_limit: 99, counts, first_sample_s: 0.0 };
        let window = |in_attack| trace_window(&drive(), &trace, in_attack);
        assert_eq!((window(false).first(), window(false).last()), (Some(&10), Some(&25)), "as far as it goes");
        assert_eq!((window(true).first(), window(true).last()), (Some(&0), Some(&10)));
    }

    #[test]
    fn a_pulse_that_takes_over_is_shown_as_their_sum() {
        let still = Drive { motors: Default::default(), ..drive() };
        let (mut drives, start_ns) = (Drives::default(), 20_000_000);
        drives.next(0, &drive());
        let (before_ns, _) = drives.next(start_ns, &still);
        assert!(before_ns.last().is_some_and(|last_ns| *last_ns < start_ns), "one value at a time");
        let (after_ns, counts) = drives.last_until(i64::MAX);
        assert_eq!(after_ns[0], start_ns);
        let mut decaying = drive();
        decaying.envelope.sustain_s = 0.01;
        let wanted = after_ns.iter().flat_map(|&at_ns| decaying.counts_at(at_ns as f64 * 1e-9).map(f64::round));
        assert_eq!(counts, wanted.collect::<Vec<_>>());
        assert!(counts.iter().any(|count| count.abs() > 10.0));
    }
}
