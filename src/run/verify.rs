use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use serde_json::Value;

use super::{Bench, NamedTruth, RunError, job_library, play};
use crate::config::{Fault, JobSpec, Origin};
use crate::control::{Sink, is_stop};
use crate::recording::{ENDED_EARLY, Fanout, Journal};
use crate::time::StoppedClock;

/// The event of a stop stands among the last lines of a journal; after it come its cause, what became of the recording,
/// and a cycle that never ended.
const TAIL_LINES: usize = 6;

/// What comparing a run with its repetition showed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Byte for byte the same journal.
    Equal {
        /// Lines compared.
        lines: usize,
        /// True when the run was stopped from outside, and compared up to there.
        stopped: bool,
    },
    /// The journals part ways.
    Differs {
        /// First line that differs, from 1.
        line: usize,
        /// What the run folder says there.
        recorded: String,
        /// What the repetition says there.
        repeated: String,
    },
}

/// Why a run could not be repeated.
#[derive(Debug, thiserror::Error)]
pub enum VerifyError {
    /// A file of the run folder is missing or unreadable.
    #[error("{path}: {reason}")]
    Read {
        /// Which.
        path: String,
        /// Why.
        reason: String,
    },
    /// The job in `effective.json` is not valid.
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))]
    Job(Vec<Fault>),
    /// It cannot be run.
    #[error(transparent)]
    Run(#[from] RunError),
}

/// Runs the job of the run folder `run` again, from that folder alone, and compares the journals.
/// A run that was stopped from outside is compared as far as it went.
pub fn verify(run: &Path, stop: &AtomicBool, watcher: &mut dyn Sink) -> Result<Verdict, VerifyError> {
    let effective = run.join("effective.json");
    let job = effective_job(&read(&effective)?, &effective)?;
    let recorded = read(&run.join("journal.jsonl"))?;
    let library = job_library(&job).map_err(RunError::Library)?;
    let mut bench = Bench::new(&job, &library).map_err(RunError::Job)?;
    let mut bytes = Vec::new();
    let mut journal = Journal::new(&mut bytes, Arc::clone(&library));
    let mut named = NamedTruth::new(bench.truth());
    let mut sinks = Fanout::new().with(&mut named).with(&mut journal).with(watcher);
    play(&mut bench, &library, None, &mut sinks, &StoppedClock, stop);
    let broken = |error: std::io::Error| VerifyError::Read { path: "journal".into(), reason: error.to_string() };
    journal.finish().map_err(broken)?;
    Ok(compare(&recorded, &String::from_utf8_lossy(&bytes)))
}

fn read(path: &Path) -> Result<String, VerifyError> {
    fs::read_to_string(path)
        .map_err(|error| VerifyError::Read { path: path.display().to_string(), reason: not_of_a_run(&error) })
}

fn not_of_a_run(found: &dyn std::fmt::Display) -> String {
    format!("$: found {found}, allowed: what `upm run` left in a run folder")
}

fn effective_job(text: &str, path: &Path) -> Result<JobSpec, VerifyError> {
    let file = path.display().to_string();
    let no_job = |reason: String| VerifyError::Read { path: file.clone(), reason };
    let effective: Value = serde_json::from_str(text).map_err(|error| no_job(not_of_a_run(&error)))?;
    let job = effective.get("job").ok_or_else(|| no_job("job: found nothing, allowed: the job".into()))?;
    JobSpec::from_json(&job.to_string(), &Origin::of_file(path), None).map_err(VerifyError::Job)
}

fn compare(recorded: &str, repeated: &str) -> Verdict {
    let recorded = &without_the_recording(recorded);
    let before_stop = before_stop(recorded);
    let (recorded, stopped) = (before_stop.unwrap_or(recorded), before_stop.is_some());
    if recorded == repeated || stopped && repeated.starts_with(recorded) {
        return Verdict::Equal { lines: recorded.lines().count(), stopped };
    }
    let (mut a, mut b) = (recorded.split_inclusive('\n'), repeated.split_inclusive('\n'));
    let mut line = 1;
    loop {
        match (a.next(), b.next()) {
            (Some(x), Some(y)) if x == y => line += 1,
            (x, y) => {
                let shown = |text: Option<&str>| text.map_or("(end)", |text| text.trim_end_matches('\n')).to_owned();
                return Verdict::Differs { line, recorded: shown(x), repeated: shown(y) };
            }
        }
    }
}

/// The journal but for what it says of the recording, which the disk decides and not the run.
fn without_the_recording(journal: &str) -> String {
    let is_of_recording = |line: &str| {
        let event = || serde_json::from_str::<Value>(line).ok();
        line.contains(ENDED_EARLY)
            && event().is_some_and(|event| event["type"] == "event" && starts_so(&event["text"], ENDED_EARLY))
    };
    journal.split_inclusive('\n').filter(|line| !is_of_recording(line)).collect()
}

fn starts_so(text: &Value, start: &str) -> bool {
    text.as_str().is_some_and(|text| text.starts_with(start))
}

/// The journal up to the moment somebody stopped the run; `None` when nobody did. What follows, the event and a
/// cycle that never ended, the repetition cannot know of.
fn before_stop(journal: &str) -> Option<&str> {
    let is_stop = |line: &str| {
        let event: Option<Value> = serde_json::from_str(line).ok();
        event.is_some_and(|event| event["type"] == "event" && event["text"].as_str().is_some_and(is_stop))
    };
    let mut end = journal.len();
    for line in journal.split_inclusive('\n').rev().take(TAIL_LINES) {
        end -= line.len();
        if is_stop(line) {
            return journal.get(..end);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::{Ending, STOPPED};
    use crate::rig::{RigFault, Trip};

    fn differs_at(recorded: &str, repeated: &str) -> usize {
        match compare(recorded, repeated) {
            Verdict::Differs { line, .. } => line,
            Verdict::Equal { .. } => 0,
        }
    }

    #[test]
    fn the_first_difference_is_named() {
        assert_eq!(compare("a\nb\n", "a\nb\n"), Verdict::Equal { lines: 2, stopped: false });
        assert_eq!(differs_at("a\nb\n", "a\nc\n"), 2);
        assert_eq!(differs_at("a\nb\n", "a\n"), 2);
        assert_eq!(differs_at("a\nb", "a\nb\n"), 2);
    }

    #[test]
    fn what_became_of_the_recording_is_not_compared() {
        let told = format!("{{\"type\":\"event\",\"text\":\"{ENDED_EARLY}no space\"}}\n");
        assert_eq!(compare(&format!("a\n{told}b\n"), "a\nb\n"), Verdict::Equal { lines: 2, stopped: false });
        assert_eq!(differs_at(&format!("a\n{told}b\n"), "a\nc\n"), 2);
        let other = told.replace("event", "cycle");
        assert_eq!(differs_at(&format!("a\n{other}b\n"), "a\nb\n"), 2);
    }

    #[test]
    fn a_stopped_run_is_compared_as_far_as_it_went() {
        let event = |text: &str| format!("{{\"type\":\"event\",\"text\":\"{text}\"}}\n");
        let after = event("emergency stop by the page") + "{\"type\":\"unfinished_cycle\"}\n";
        let by_rig = Trip::ALL.map(|trip| Ending::from(RigFault::Stopped(trip)).reason);
        for text in by_rig.iter().map(String::as_str).chain([STOPPED]) {
            let recorded = format!("a\nb\n{}{after}", event(text));
            assert_eq!(compare(&recorded, "a\nb\nc\n"), Verdict::Equal { lines: 2, stopped: true });
            assert_eq!(differs_at(&recorded, "a\nx\nc\n"), 2);
            assert_eq!(differs_at(&recorded, "a\n"), 2);
        }
        let ended_by_itself = format!("a\nb\n{}{after}", event("no step is feasible"));
        assert_eq!(differs_at(&ended_by_itself, "a\nb\nc\n"), 3);
    }
}
