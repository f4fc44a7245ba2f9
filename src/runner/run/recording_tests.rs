use std::path::Path;

use serde_json::{Value, json};
use tempfile::TempDir;

use super::testing::{job_in_configs, options};
use super::*;
use upm_control::FrameFacts;
use upm_core::time::MonotonicClock;
use upm_recording::{RecordingHandle, RecordingState};

/// Fails the recording at a frame.
struct FailsAt(u64, RecordingHandle);

impl Sink for FailsAt {
    fn frame(&mut self, facts: &FrameFacts<'_>) {
        if facts.frame.index == self.0 {
            self.1.fail("the disk is full");
        }
    }
}

/// Runs two seconds of a job whose recording fails at a frame.
fn run_until(out: &TempDir, frame: u64) -> (RunResult, RecordingState) {
    let job = job_in_configs(&json!({
        "name": "short", "rig": "rigs/upm-2.json", "planner": "synthesized_field", "parts": [{"kind": "penny"}],
        "task": {"type": "plus_sign", "laps": 1, "edge_margin_mm": 50}, "limits": {"plate_time_s": 2},
    }));
    let options = RunOptions { rerun: RerunMode::Save, ..options(out) };
    let recording = options.recording_options.recording.clone();
    let (library, clock, stop) = (job_library(&job).unwrap(), MonotonicClock::new(), AtomicBool::new(false));
    let (pacing, mut watcher) = (PacingStats::default(), FailsAt(frame, recording.clone()));
    let done = run(&job, library, (&options, OwnParts::default()), &clock, &stop, &pacing, &mut watcher).unwrap();
    (done, recording.state())
}

/// Events about the recording in the journal of a run folder.
fn warnings(folder: &Path) -> Vec<Value> {
    let journal = std::fs::read_to_string(folder.join("journal.jsonl")).unwrap();
    let events = journal.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    events.filter(|line| line["code"].as_str().is_some_and(|code| code.starts_with("recording_"))).collect()
}

#[test]
fn run_continues_without_its_recording_and_warns() {
    let out = TempDir::new().unwrap();
    let (done, state) = run_until(&out, 30);
    assert_eq!(state, RecordingState::Failed("the disk is full".into()));
    assert!(done.report.work.frames > 100, "{}", done.report.work.frames);
    let text = "the recording ends early: the disk is full";
    assert_eq!(done.report.incidents.warnings, [text]);
    let warnings = warnings(&done.folder);
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    assert_eq!((&warnings[0]["level"], &warnings[0]["text"]), (&json!("warning"), &json!(text)));
    assert!(done.folder.join("run.rrd").exists());
    // the disk decided that, so a repetition has no such event
    let verdict = verify(&done.folder, &AtomicBool::new(false), &mut FailsAt(0, RecordingHandle::default())).unwrap();
    assert!(matches!(verdict, Verification::Equal { .. }), "{verdict:?}");
}
