use std::fs;
use std::io::{self, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use serde_json::Value;

use super::{RunError, RunSetup, TruthInJobOrder, job_library};
use crate::config::{Diagnostic, JobSpec, Origin, reason};
use upm_control::Sink;
use upm_core::job::StopCause;
use upm_core::time::StoppedClock;
use upm_recording::{Fanout, Journal, RECORDING_FAILED};

/// Number of lines at the end of a journal among which the event of a stop is found; it is followed by its cause, the
/// events of the recording, and a cycle that never ended.
const TAIL_LINES: usize = 6;

/// Result of the comparison of a run with its repetition.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Verification {
    /// The journals are byte for byte equal.
    Equal {
        /// Number of lines compared.
        lines: usize,
        /// True if the run was stopped from outside and compared up to there.
        stopped: bool,
    },
    /// The journals differ.
    Differs {
        /// First line that differs, from 1.
        line: usize,
        /// Text of that line in the run folder.
        recorded: String,
        /// Text of that line in the repetition.
        repeated: String,
    },
}

/// Runs the job of the run folder `run` again, from that folder alone, and compares the journals; ends when the result
/// is known or `stop` is set. A run that was stopped from outside is compared up to the stop.
pub fn verify(run: &Path, stop: &AtomicBool, watcher: &mut dyn Sink) -> Result<Verification, RunError> {
    let effective = run.join("effective.json");
    let job = effective_job(&read(&effective)?, &effective)?;
    let recorded = read(&run.join("journal.jsonl"))?;
    let library = job_library(&job)?;
    let mut setup = RunSetup::new(&job, &library)?;
    let enough = AtomicBool::new(false);
    let mut repetition = Repetition::of(&recorded, &enough);
    let mut journal = Journal::new(&mut repetition, Arc::clone(&library));
    let mut named = TruthInJobOrder(setup.truth.clone());
    let mut end_if_stopped = |_: &mut dyn Sink, _| {
        enough.fetch_or(stop.load(Ordering::Relaxed), Ordering::Relaxed);
    };
    let mut sinks = Fanout { sinks: vec![&mut named, &mut journal, watcher], after_frame: Some(&mut end_if_stopped) };
    setup.play(&library, None, &mut sinks, &StoppedClock, &enough, &AtomicBool::new(false));
    let broken = |error: io::Error| RunError::Write { path: "journal".into(), reason: error.to_string() };
    journal.finish().map_err(broken)?;
    Ok(repetition.verdict())
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
    stopped: bool,
    /// Number of equal lines so far.
    equal: usize,
    differs: Option<Verification>,
    /// Set when no further line can change the verdict.
    enough: &'a AtomicBool,
}

impl<'a> Repetition<'a> {
    fn of(recorded: &'a str, enough: &'a AtomicBool) -> Self {
        let recorded: Vec<&str> = recorded
            .split_inclusive('\n')
            // how a recording ends depends on the disk and not on the run
            .filter(|line| !event_of(line).is_some_and(|event| event["code"] == RECORDING_FAILED))
            .collect();
        let stop = lines_before_stop(&recorded);
        let stopped = stop.is_some();
        let recorded = recorded[..stop.unwrap_or(recorded.len())].to_vec();
        let this = Self { recorded, stopped, equal: 0, differs: None, enough };
        this.report_progress();
        this
    }

    /// True if all of a stopped run has been repeated; the repetition has no counterpart to the lines after that.
    fn is_through(&self) -> bool {
        self.stopped && self.equal == self.recorded.len()
    }

    fn report_progress(&self) {
        if self.differs.is_some() || self.is_through() {
            self.enough.store(true, Ordering::Relaxed);
        }
    }

    fn differs_in(&self, recorded: Option<&str>, repeated: Option<&str>) -> Verification {
        let shown = |text: Option<&str>| text.map_or("(end)", |text| text.trim_end_matches('\n')).to_owned();
        Verification::Differs { line: self.equal + 1, recorded: shown(recorded), repeated: shown(repeated) }
    }

    fn verdict(self) -> Verification {
        let rest = self.recorded.get(self.equal).map(|&recorded| self.differs_in(Some(recorded), None));
        let equal = Verification::Equal { lines: self.equal, stopped: self.stopped };
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

/// The event in a line of a journal, if it is one.
fn event_of(line: &str) -> Option<Value> {
    serde_json::from_str(line).ok().filter(|line: &Value| line["type"] == "event")
}

/// True for an event of a stop from outside the run.
fn is_external_stop(event: &Value) -> bool {
    event["outcome"].is_string()
        && event["code"].as_str().and_then(StopCause::of_code).is_some_and(StopCause::is_external)
}

/// Number of lines before the stop from outside; `None` for a run that was not stopped. The lines after it, the event
/// and a cycle that never ended, have no counterpart in the repetition.
fn lines_before_stop(journal: &[&str]) -> Option<usize> {
    let is_stop = |&at: &usize| event_of(journal[at]).is_some_and(|event| is_external_stop(&event));
    (journal.len().saturating_sub(TAIL_LINES)..journal.len()).find(is_stop)
}

#[cfg(test)]
mod tests {
    use upm_core::job::{Finding, StopRequest};

    use super::*;
    fn compare(recorded: &str, repeated: &str) -> Verification {
        let enough = AtomicBool::new(false);
        let mut repetition = Repetition::of(recorded, &enough);
        for line in repeated.split_inclusive('\n') {
            repetition.write_all(line.as_bytes()).unwrap();
        }
        repetition.verdict()
    }

    fn differs_at(recorded: &str, repeated: &str) -> usize {
        match compare(recorded, repeated) {
            Verification::Differs { line, .. } => line,
            Verification::Equal { .. } => 0,
        }
    }

    #[test]
    fn the_first_difference_is_named() {
        assert_eq!(compare("a\nb\n", "a\nb\n"), Verification::Equal { lines: 2, stopped: false });
        assert_eq!(differs_at("a\nb\n", "a\nc\n"), 2);
        assert_eq!(differs_at("a\nb\n", "a\n"), 2);
        assert_eq!(differs_at("a\nb", "a\nb\n"), 2);
    }

    fn event(text: &str, details: &str) -> String {
        format!("{{\"type\":\"event\",\"at_s\":1.5,\"level\":\"info\",\"text\":\"{text}\"{details}}}\n")
    }

    #[test]
    fn events_about_the_recording_are_not_compared() {
        let ended = event("whatever it says", r#","code":"recording_failed""#);
        assert_eq!(compare(&format!("a\n{ended}b\n"), "a\nb\n"), Verification::Equal { lines: 2, stopped: false });
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
            assert_eq!(compare(&recorded, "a\nb\nc\n"), Verification::Equal { lines: 2, stopped: true }, "{stop}");
            assert_eq!(differs_at(&recorded, "a\nx\nc\n"), 2);
            assert_eq!(differs_at(&recorded, "a\n"), 2);
        }
        for ended in [event("no step is feasible", ""), event("no way", r#","outcome":"failed","code":"time_limit""#)] {
            assert_eq!(differs_at(&format!("a\nb\n{ended}"), "a\nb\nc\n"), 3);
        }
    }

    #[test]
    fn repetition_stops_once_verdict_is_decided() {
        let stopped = format!("a\nb\n{}", event("in words", r#","outcome":"cancelled","code":"interrupted""#));
        for (recorded, repeated, lines) in [(stopped.as_str(), ["a\n", "b\n"], 2), ("a\nb\n", ["x\n", "b\n"], 1)] {
            let enough = AtomicBool::new(false);
            let mut repetition = Repetition::of(recorded, &enough);
            let taken = repeated.iter().take_while(|line| {
                repetition.write_all(line.as_bytes()).unwrap();
                !enough.load(Ordering::Relaxed)
            });
            assert_eq!(taken.count() + 1, lines, "{recorded}");
            assert!(enough.load(Ordering::Relaxed));
        }
    }
}
