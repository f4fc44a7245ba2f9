use std::path::{Path, PathBuf};

use serde_json::json;
use tempfile::TempDir;

use super::testing::{job_in_configs, options};
use super::*;
use upm_control::FrameFacts;
use upm_core::job::Outcome;
use upm_core::time::MonotonicClock;

/// Blocks the temporary name of the report in every folder of `out`.
struct InTheWay<'a>(&'a Path);

impl Sink for InTheWay<'_> {
    fn frame(&mut self, _: &FrameFacts<'_>) {
        for folder in folders(self.0) {
            std::fs::create_dir_all(folder.join("report.json.part")).unwrap();
        }
    }
}

fn folders(out: &Path) -> Vec<PathBuf> {
    std::fs::read_dir(out).unwrap().map(|entry| entry.unwrap().path()).collect()
}

/// A second of a job that reaches its goal.
fn job() -> JobSpec {
    let text = json!({
        "name": "still",
        "rig": "rigs/upm-2.json",
        "planner": "synthesized_field",
        "parts": [{"kind": "penny"}],
        "task": {"type": "hold", "duration_s": 1},
    });
    job_in_configs(&text)
}

#[test]
fn a_run_keeps_its_outcome_when_its_report_cannot_be_written() {
    let (job, out) = (job(), TempDir::new().unwrap());
    let options = options(&out);
    let folder = RunFolder::create(&options.out, &job, &options.started_utc).unwrap();
    let (stop, give_way) = (AtomicBool::new(false), AtomicBool::new(false));
    let (interlock, pacing) = (Interlock::default(), PacingStats::default());
    let controls =
        RunControls { stop: &stop, give_way: &give_way, interlock: &interlock, pacing: &pacing, cause: &|| None };
    let library = job_library(&job).unwrap();
    let clock = MonotonicClock::new();
    let done = run_linked(&job, library, folder, &options, &clock, controls, &mut InTheWay(out.path())).unwrap();
    assert_eq!(done.report.outcome, Outcome::Completed, "{}", done.report.reason);
    assert!(
        matches!(done.report.incidents.warnings.as_slice(), [text] if text.starts_with("cannot write ") && text.contains("report.json"))
    );
    assert!(!done.folder.join("report.json").exists());
}

#[test]
fn run_by_hand_fails_when_its_report_cannot_be_written() {
    let (job, out) = (job(), TempDir::new().unwrap());
    let (options, clock) = (options(&out), MonotonicClock::new());
    let (stop, pacing) = (AtomicBool::new(false), PacingStats::default());
    let (library, how) = (job_library(&job).unwrap(), (&options, OwnParts::default()));
    let done = run(&job, library, how, &clock, &stop, &pacing, &mut InTheWay(out.path()));
    assert!(matches!(done, Err(RunError::Write { path, .. }) if path.ends_with("report.json")));
}
