use std::fs;
use std::io::{self, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use serde_json::Value;

use super::folder::REPORT_FILE;
use super::{RunError, RunSetup, TruthInJobOrder, job_library};
use crate::config::{Diagnostic, JobSpec, Origin, reason};
use upm_control::Sink;
use upm_core::job::StopCause;
use upm_core::time::StoppedClock;
use upm_recording::{Fanout, Journal, RECORDING_FAILED};

/// Number of lines at the end of a journal among which the event of a stop is found; it is followed by its cause, the
/// events of the recording, and a cycle that never ended.
const TAIL_LINES: usize = 6;

/// How far a run went.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extent {
    /// To its own end.
    Whole,
    /// To a stop from outside.
    Stopped,
    /// To its last whole line: it has no report, since its program was killed or still runs.
    Killed,
}

/// Result of the comparison of a run with its repetition.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Verification {
    /// The journals are byte for byte equal.
    Equal {
        /// Number of lines compared.
        lines: usize,
        /// How far the run went, up to where it was compared.
        extent: Extent,
    },
    /// The journals differ in the ends of their lines alone, as after a conversion of text.
    LineEnds,
    /// The journals differ.
    Differs {
        /// First line that differs, from 1.
        line: usize,
        /// Path of the first key that differs, with both values; `None` where a line is missing or is not JSON.
        key: Option<(String, [Value; 2])>,
        /// Text of that line in the run folder.
        recorded: String,
        /// Text of that line in the repetition.
        repeated: String,
    },
}

/// Runs the job of the run folder `run` again, from that folder alone, and compares the journals; ends when the result
/// is known or `stop` is set. A run that was stopped from outside or killed is compared up to there.
pub fn verify(run: &Path, stop: &AtomicBool, watcher: &mut dyn Sink) -> Result<Verification, RunError> {
    let effective = run.join("effective.json");
    let job = effective_job(&read(&effective)?, &effective)?;
    let recorded = read(&run.join("journal.jsonl"))?;
    let library = job_library(&job)?;
    let mut setup = RunSetup::new(&job, &library)?;
    let enough = AtomicBool::new(false);
    let was_killed = !run.join(REPORT_FILE).exists();
    let text = recorded.replace("\r\n", "\n");
    let mut repetition = Repetition::of(&text, was_killed, &enough);
    let mut journal = Journal::new(&mut repetition, Arc::clone(&library));
    let mut named = TruthInJobOrder(setup.truth.clone());
    let mut end_if_stopped = |_: &mut dyn Sink, _| {
        enough.fetch_or(stop.load(Ordering::Relaxed), Ordering::Relaxed);
    };
    let mut sinks = Fanout { sinks: vec![&mut named, &mut journal, watcher], after_frame: Some(&mut end_if_stopped) };
    setup.play(&library, None, None, &mut sinks, &StoppedClock, (&enough, &AtomicBool::new(false)));
    let broken = |error: io::Error| RunError::Write { path: "journal".into(), reason: error.to_string() };
    journal.finish().map_err(broken)?;
    Ok(match repetition.verdict() {
        Verification::Equal { .. } if text != recorded => Verification::LineEnds,
        verdict => verdict,
    })
}

fn read(path: &Path) -> Result<String, Diagnostic> {
    fs::read_to_string(path).map_err(|error| {
        let reason = format!("{} (expected a run folder, as `upm run` leaves it)", reason(&error));
        Diagnostic::unreadable(&path.display().to_string(), reason)
    })
}

fn effective_job(text: &str, path: &Path) -> Result<JobSpec, RunError> {
    let file = path.display().to_string();
    let no_run = |error| Diagnostic::new(&file, "$", error, "what `upm run` left in a run folder");
    let effective: Value = serde_json::from_str(text).map_err(no_run)?;
    let job = effective.get("job").ok_or_else(|| Diagnostic::missing(&file, "job", "the job that ran"))?;
    let camera = serde_json::from_value(effective.get("camera").cloned().unwrap_or_default());
    let camera = camera.map_err(|error| Diagnostic::new(&file, "camera", error, "the camera of the run"))?;
    Ok(JobSpec::from_json(&job.to_string(), &Origin::of_file(path), None)?.with_camera(camera))
}

/// Writer of the repetition's journal, one line per write, which compares it with the recorded one.
struct Repetition<'a> {
    recorded: Vec<&'a str>,
    extent: Extent,
    /// Number of equal lines so far.
    equal: usize,
    differs: Option<Verification>,
    /// Set when no further line can change the verdict.
    enough: &'a AtomicBool,
}

impl<'a> Repetition<'a> {
    fn of(recorded: &'a str, was_killed: bool, enough: &'a AtomicBool) -> Self {
        let recorded: Vec<&str> = recorded
            .split_inclusive('\n')
            // how a recording ends depends on the disk and not on the run
            .filter(|line| !event_of(line).is_some_and(|event| event["code"] == RECORDING_FAILED))
            .filter(|line| !was_killed || line.ends_with('\n'))
            .collect();
        let is_stop = |&at: &usize| event_of(recorded[at]).is_some_and(|event| is_external_stop(&event));
        // the event of a stop from outside and a cycle that never ended have no counterpart in the repetition
        let before_stop = (recorded.len().saturating_sub(TAIL_LINES)..recorded.len()).find(is_stop);
        let (extent, lines) = match before_stop {
            Some(lines) => (Extent::Stopped, lines),
            None if was_killed => (Extent::Killed, recorded.len()),
            None => (Extent::Whole, recorded.len()),
        };
        let this = Self { recorded: recorded[..lines].to_vec(), extent, equal: 0, differs: None, enough };
        this.report_progress();
        this
    }

    /// True if all of a run that did not end by itself has been repeated; the repetition has more.
    fn is_through(&self) -> bool {
        self.extent != Extent::Whole && self.equal == self.recorded.len()
    }

    fn report_progress(&self) {
        if self.differs.is_some() || self.is_through() {
            self.enough.store(true, Ordering::Relaxed);
        }
    }

    fn differs_in(&self, recorded: Option<&str>, repeated: Option<&str>) -> Verification {
        let shown = |text: Option<&str>| text.map_or("(end)", |text| text.trim_end_matches('\n')).to_owned();
        let [recorded, repeated] = [recorded, repeated].map(shown);
        let value_of = |text: &str| serde_json::from_str(text).ok();
        let key = value_of(&recorded).zip(value_of(&repeated)).and_then(|(a, b)| first_difference("", &a, &b));
        Verification::Differs { line: self.equal + 1, key, recorded, repeated }
    }

    fn verdict(self) -> Verification {
        let rest = self.recorded.get(self.equal).map(|&recorded| self.differs_in(Some(recorded), None));
        let equal = Verification::Equal { lines: self.equal, extent: self.extent };
        self.differs.or(rest).unwrap_or(equal)
    }
}

impl Write for Repetition<'_> {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        let text = String::from_utf8_lossy(line);
        if self.differs.is_none() && !self.is_through() {
            match self.recorded.get(self.equal) {
                Some(&recorded) if recorded == text => self.equal += 1,
                recorded => self.differs = Some(self.differs_in(recorded.copied(), Some(&text))),
            }
            self.report_progress();
        }
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Path of the first value that differs, and both; `null` for one that is missing.
fn first_difference(at: &str, recorded: &Value, repeated: &Value) -> Option<(String, [Value; 2])> {
    let below = |at: String, pair: [Option<&Value>; 2]| {
        let [recorded, repeated] = pair.map(|value| value.unwrap_or(&Value::Null));
        first_difference(&at, recorded, repeated)
    };
    match (recorded, repeated) {
        (Value::Object(a), Value::Object(b)) => {
            a.keys().chain(b.keys()).find_map(|key| below(format!("{at}.{key}"), [a.get(key), b.get(key)]))
        }
        (Value::Array(a), Value::Array(b)) => {
            (0..a.len().max(b.len())).find_map(|i| below(format!("{at}[{i}]"), [a.get(i), b.get(i)]))
        }
        _ if recorded == repeated => None,
        _ => Some((at.trim_start_matches('.').to_owned(), [recorded.clone(), repeated.clone()])),
    }
}

/// The event in a line of a journal, if it is one.
fn event_of(line: &str) -> Option<Value> {
    serde_json::from_str(line).ok().filter(|line: &Value| line["type"] == "event")
}

/// True for an event of a stop from outside the run.
fn is_external_stop(event: &Value) -> bool {
    event["outcome"].is_string()
        && event["code"].as_str().and_then(StopCause::of_code).is_some_and(StopCause::is_external)
}

#[cfg(test)]
mod tests {
    use upm_core::job::{Finding, StopRequest};

    use super::*;
    fn compare(recorded: &str, repeated: &str) -> Verification {
        let enough = AtomicBool::new(false);
        let mut repetition = Repetition::of(recorded, false, &enough);
        for line in repeated.split_inclusive('\n') {
            repetition.write_all(line.as_bytes()).unwrap();
        }
        repetition.verdict()
    }

    fn differs_at(recorded: &str, repeated: &str) -> usize {
        match compare(recorded, repeated) {
            Verification::Differs { line, .. } => line,
            Verification::Equal { .. } | Verification::LineEnds => 0,
        }
    }

    #[test]
    fn the_first_difference_is_named() {
        assert_eq!(compare("a\nb\n", "a\nb\n"), Verification::Equal { lines: 2, extent: Extent::Whole });
        assert_eq!(differs_at("a\nb\n", "a\nc\n"), 2);
        assert_eq!(differs_at("a\nb\n", "a\n"), 2);
        assert_eq!(differs_at("a\nb", "a\nb\n"), 2);
    }

    #[test]
    fn a_killed_run_is_compared_up_to_its_last_whole_line() {
        let enough = AtomicBool::new(false);
        let mut repetition = Repetition::of("a\nb\nc", true, &enough);
        repetition.write_all(b"a\n").unwrap();
        repetition.write_all(b"b\n").unwrap();
        assert!(enough.load(Ordering::Relaxed));
        assert_eq!(repetition.verdict(), Verification::Equal { lines: 2, extent: Extent::Killed });
    }

    #[test]
    fn the_first_key_that_differs_is_named_with_both_values() {
        let key = |recorded: &str, repeated: &str| match compare(recorded, repeated) {
            Verification::Differs { key, .. } => key.map(|(path, [a, b])| format!("{path}: {a}, {b}")),
            verdict => panic!("{verdict:?}"),
        };
        let line = |x: &str| format!("{{\"cycle\":1,\"plan\":{{\"pulses\":[{{\"x_mm\":{x}}}]}}}}\n");
        assert_eq!(key(&line("1.5"), &line("1.25")).unwrap(), "plan.pulses[0].x_mm: 1.5, 1.25");
        assert_eq!(key("{\"a\":[1]}\n", "{\"a\":[1,2]}\n").unwrap(), "a[1]: null, 2");
        assert_eq!(key("{\"a\":1}\n", "no JSON\n"), None);
    }

    fn event(text: &str, details: &str) -> String {
        format!("{{\"type\":\"event\",\"at_s\":1.5,\"level\":\"info\",\"text\":\"{text}\"{details}}}\n")
    }

    #[test]
    fn events_about_the_recording_are_not_compared() {
        let ended = event("whatever it says", r#","code":"recording_failed""#);
        assert_eq!(
            compare(&format!("a\n{ended}b\n"), "a\nb\n"),
            Verification::Equal { lines: 2, extent: Extent::Whole }
        );
        assert_eq!(differs_at(&format!("a\n{ended}b\n"), "a\nc\n"), 2);
        let other = ended.replace("event", "cycle");
        assert_eq!(differs_at(&format!("a\n{other}b\n"), "a\nb\n"), 2);
    }

    #[test]
    fn a_stopped_run_is_compared_as_far_as_it_went() {
        let explained = event("emergency stop by the page", r#","outcome":"cancelled","code":"estop""#);
        let after = explained + "{\"type\":\"unfinished_cycle\"}\n";
        let coded = StopRequest::ALL
            .map(StopCause::from)
            .into_iter()
            .chain(Finding::ALL.map(StopCause::from))
            .filter(|cause| cause.is_external());
        let coded =
            coded.map(|cause| event("in words", &format!(r#","outcome":"cancelled","code":"{}""#, cause.code())));
        for stop in coded {
            let recorded = format!("a\nb\n{stop}{after}");
            assert_eq!(
                compare(&recorded, "a\nb\nc\n"),
                Verification::Equal { lines: 2, extent: Extent::Stopped },
                "{stop}"
            );
            assert_eq!(differs_at(&recorded, "a\nx\nc\n"), 2);
            assert_eq!(differs_at(&recorded, "a\n"), 2);
        }
        for ended in [event("no step is feasible", ""), event("no way", r#","outcome":"failed","code":"time_limit""#)] {
            assert_eq!(differs_at(&format!("a\nb\n{ended}"), "a\nb\nc\n"), 3);
        }
    }
}
