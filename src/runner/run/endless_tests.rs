use std::sync::atomic::Ordering;

use serde_json::{Value, json};
use tempfile::TempDir;

use super::testing::{job_in_configs, options, played};
use super::*;
use upm_control::FrameFacts;
use upm_core::job::{Finding, Outcome, StopCause, StopRequest};
use upm_core::time::MonotonicClock;

fn job(task: &Value, plate_time_s: f64) -> JobSpec {
    let text = json!({
        "name": "endless",
        "rig": "rigs/upm-2.json",
        "parts": [{"kind": "penny", "position_mm": [20, 10]}, {"kind": "penny", "position_mm": [-40, 10]}],
        "task": task,
        "limits": {"plate_time_s": plate_time_s},
    });
    job_in_configs(&text)
}

fn report_of(task: &Value, plate_time_s: f64) -> Report {
    played(&job(task, plate_time_s)).1.report
}

/// Requests a run to give way in the first frame of a pulse after `after_s`.
struct InAPulse<'a> {
    after_s: f64,
    give_way: &'a AtomicBool,
    asked_s: Option<f64>,
}

impl Sink for InAPulse<'_> {
    fn frame(&mut self, facts: &FrameFacts<'_>) {
        let at_s = facts.frame.exposed_at.secs();
        if facts.driving && at_s > self.after_s && self.asked_s.is_none() {
            self.give_way.store(true, Ordering::Relaxed);
            self.asked_s = Some(at_s);
        }
    }
}

/// Requests a run to give way in a pulse; returns its folder, its report, the lines of its journal, and the plate time
/// from the request to the end, s.
fn gives_way(task: &Value) -> (TempDir, Report, Vec<Value>, f64) {
    let (out, job) = (TempDir::new().unwrap(), job(task, 60.0));
    let options = options(&out);
    let folder = RunFolder::create(&options.out, &job, &options.started_utc).unwrap();
    let (stop, give_way) = (AtomicBool::new(false), AtomicBool::new(false));
    let (interlock, pacing) = (Interlock::default(), PacingStats::default());
    let controls =
        RunControls { stop: &stop, give_way: &give_way, interlock: &interlock, pacing: &pacing, cause: &|| None };
    let mut watcher = InAPulse { after_s: 2.0, give_way: &give_way, asked_s: None };
    let (library, clock) = (job_library(&job).unwrap(), MonotonicClock::new());
    let done = run_linked(&job, library, folder, &options, &clock, controls, &mut watcher).unwrap();
    let journal = std::fs::read_to_string(done.folder.join("journal.jsonl")).unwrap();
    let took_s = done.report.plate_time_s - watcher.asked_s.unwrap();
    (out, done.report, journal.lines().map(|line| serde_json::from_str(line).unwrap()).collect(), took_s)
}

/// A square path for each part, the second one offset to the left.
fn squares(repeat: u32, in_phase: bool) -> Value {
    let path = |x: f64| {
        let waypoints_mm = [[x, 0.0], [x + 20.0, 0.0], [x + 20.0, 20.0], [x, 20.0]];
        json!({"waypoints_mm": waypoints_mm, "speed_mm_s": 20, "repeat": repeat})
    };
    json!({"type": "trajectories", "paths": [path(20.0), path(-60.0)], "in_phase": in_phase})
}

#[test]
fn task_without_end_completes_at_its_plate_time_limit() {
    let place = |x: f64| json!({"waypoints_mm": [[x, 10]], "speed_mm_s": 8, "repeat": 0});
    // two are longer than the ten seconds after which another run without a pulse would count as stalled
    for (task, plate_time_s) in [
        (json!({"type": "trajectories", "paths": [place(20.0), place(-40.0)]}), 11.0),
        (squares(0, false), 2.0),
        (squares(0, true), 2.0),
        (json!({"type": "hold"}), 11.0),
        (json!({"type": "hold", "duration_s": 0}), 1.0),
        (json!({"type": "hold", "duration_s": 1e6}), 1.0),
    ] {
        let report = report_of(&task, plate_time_s);
        let reason = format!("plate time limit of {plate_time_s} s reached");
        assert_eq!((report.outcome, &report.reason), (Outcome::Completed, &reason), "{task}");
        assert!(report.plate_time_s >= plate_time_s, "{task}: {}", report.plate_time_s);
    }
}

#[test]
fn task_with_an_end_fails_at_its_plate_time_limit() {
    let report = report_of(&squares(5, false), 2.0);
    assert_eq!((report.outcome, report.stop.unwrap().code), (Outcome::Failed, StopCause::Found(Finding::TimeLimit)));
    assert!(report.reason.starts_with("plate time limit of 2 s reached; check "), "{}", report.reason);
    let done = report_of(&json!({"type": "hold", "duration_s": 0.5}), 2.0);
    assert_eq!((done.outcome, done.reason.as_str()), (Outcome::Completed, "every part held for 0.5 s"));
}

#[test]
fn run_asked_to_give_way_ends_its_cycle_first_and_is_completed_when_endless() {
    for (task, outcome) in [(squares(0, false), Outcome::Completed), (squares(9, false), Outcome::Cancelled)] {
        let (out, report, journal, took_s) = gives_way(&task);
        let stop = report.stop.unwrap();
        assert_eq!(
            (report.outcome, stop.code, &stop.text),
            (outcome, StopCause::Asked(StopRequest::GaveWay), &report.reason)
        );
        let kinds: Vec<&str> = journal.iter().map(|line| line["type"].as_str().unwrap()).collect();
        assert_eq!(kinds[kinds.len() - 2..], ["cycle", "event"], "the cycle was not cut short");
        let sent: usize = journal.iter().map(|line| line["sent"].as_array().map_or(0, Vec::len)).sum();
        assert_eq!(report.work.pulses, sent as u64);
        let cycles: Vec<f64> = journal.iter().filter_map(|line| line["ended_at_s"].as_f64()).collect();
        let longest_s = cycles.windows(2).map(|two| two[1] - two[0]).fold(0.0, f64::max);
        assert!(took_s <= longest_s, "{took_s} s, a cycle takes up to {longest_s} s");
        let folder = std::fs::read_dir(out.path()).unwrap().next().unwrap().unwrap().path();
        let verdict = verify(&folder, &AtomicBool::new(false), &mut Fanout::default()).unwrap();
        assert_eq!(verdict, Verification::Equal { lines: journal.len() - 1, extent: Extent::Stopped });
    }
}
