use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use serde_json::Value;
use tempfile::TempDir;

use super::controls::TOO_BUSY;
use super::testing::{job_in_configs, options};
use super::*;
use upm_control::{FrameFacts, PulseFacts};
use upm_core::job::{Finding, Outcome, StopCause, StopRequest};
use upm_core::rig::{RigError, Trip};
use upm_core::time::PlateTime;
use upm_recording::PacingReport;

const STEP_S: f64 = 5e-5;

fn job() -> JobSpec {
    JobSpec::load(&config_file("plus-sign.json")).unwrap()
}

/// A penny that is moved by some millimetres, with these deadlines.
fn short_job(deadlines: &str) -> JobSpec {
    job_in_configs(&serde_json::json!({
        "name": "short", "rig": "rigs/upm-1.json", "deadlines": deadlines,
        "parts": [{"kind": "penny", "position_mm": [0, 0]}],
        "task": {"type": "arrange", "targets_mm": [[12, 0]]},
    }))
}

/// Calls a function once, in a frame of a pulse.
struct InPulse<F: FnMut()> {
    number: u64,
    act: F,
    pulses: u64,
    frames: u64,
    clock: Arc<PlateClock>,
}

/// Clock that shows plate time plus an offset.
#[derive(Debug, Default)]
struct PlateClock {
    shown_ns: AtomicU64,
    ahead_ns: AtomicU64,
}

impl Clock for PlateClock {
    fn elapsed(&self) -> Duration {
        Duration::from_nanos(self.shown_ns.load(Ordering::Relaxed) + self.ahead_ns.load(Ordering::Relaxed))
    }
}

impl<F: FnMut()> Sink for InPulse<F> {
    fn frame(&mut self, facts: &FrameFacts<'_>) {
        self.clock.shown_ns.store(facts.frame.exposed_at.nanos(), Ordering::Relaxed);
        self.frames = if facts.driving { self.frames + 1 } else { 0 };
        if self.pulses + 1 == self.number && self.frames == 3 {
            (self.act)();
        }
    }

    fn pulse(&mut self, _: &PulseFacts) {
        self.pulses += 1;
        self.frames = 0;
    }
}

struct StopRecord {
    out: TempDir,
    report: Report,
    events: Vec<String>,
    pulses: usize,
}

impl StopRecord {
    /// Runs the plus sign and calls `act` in the third frame of pulse `number`, from 1.
    fn run(plate: &StoppedPlate, real_time: bool, number: u64, act: impl FnMut(), cause: Option<&str>) -> Self {
        Self::run_job(&job(), plate, real_time, number, act, cause)
    }

    /// As [`run`], with another job.
    fn run_job(
        job: &JobSpec,
        plate: &StoppedPlate,
        real_time: bool,
        number: u64,
        act: impl FnMut(),
        cause: Option<&str>,
    ) -> Self {
        let out = TempDir::new().unwrap();
        let library = job_library(job).unwrap();
        let options = RunOptions { real_time, ..options(&out) };
        let folder = RunFolder::create(&options.out, job, &options.started_utc).unwrap();
        let mut watcher = InPulse { number, act, pulses: 0, frames: 0, clock: Arc::clone(&plate.clock) };
        let cause = || cause.map(|reason| ExternalStop::of(StopRequest::Cancelled, reason));
        let controls = plate.controls(&cause);
        let run = run_linked(job, library, folder, &options, &*plate.clock, controls, &mut watcher).unwrap();
        let journal = std::fs::read_to_string(run.folder.join("journal.jsonl")).unwrap();
        let lines: Vec<Value> = journal.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        let text = |line: &Value| line["text"].as_str().map(str::to_owned);
        let sent = |line: &Value| line["sent"].as_array().map_or(0, Vec::len);
        Self {
            events: lines.iter().filter_map(text).collect(),
            pulses: lines.iter().map(sent).sum(),
            report: run.report,
            out,
        }
    }

    fn folder(&self) -> PathBuf {
        std::fs::read_dir(self.out.path()).unwrap().next().unwrap().unwrap().path()
    }

    fn holds(&self) -> Verification {
        // the repetition would continue to the end of the job; equality up to the stop is enough
        let stop = AtomicBool::new(false);
        let mut watcher = InPulse {
            number: self.pulses as u64 + 3,
            act: || stop.store(true, Ordering::Relaxed),
            pulses: 0,
            frames: 0,
            clock: Arc::default(),
        };
        verify(&self.folder(), &stop, &mut watcher).unwrap()
    }
}

#[derive(Default)]
struct StoppedPlate {
    stop: AtomicBool,
    give_way: AtomicBool,
    interlock: Interlock,
    pacing: PacingStats,
    clock: Arc<PlateClock>,
}

impl StoppedPlate {
    fn controls<'a>(&'a self, cause: &'a dyn Fn() -> Option<ExternalStop>) -> RunControls<'a> {
        let Self { stop, give_way, interlock, pacing, .. } = self;
        RunControls { stop, give_way, interlock, pacing, cause }
    }
}

#[test]
fn an_emergency_stop_in_a_pulse_ends_the_run_and_nothing_is_played_after_it() {
    let plate = StoppedPlate::default();
    let press = || {
        plate.interlock.trip(Trip::EStop);
        plate.stop.store(true, Ordering::Relaxed);
    };
    let stopped = StopRecord::run(&plate, false, 2, press, Some("emergency stop by the page"));
    assert_eq!((stopped.report.outcome, stopped.report.work.pulses), (Outcome::Cancelled, 1));
    assert_eq!(stopped.report.reason, "emergency stop by the page");
    assert_eq!(stopped.pulses, 1, "the pulse that was cut is not written down as one that was played");
    let tail = stopped.events.iter().rev().take(2).map(String::as_str);
    assert_eq!(tail.collect::<Vec<_>>(), ["emergency stop by the page", control::RunEnd::stopped().reason.as_str()]);
    let answer = plate.interlock.stop_times().unwrap();
    assert!(answer.motors_off_at - answer.requested_at <= STEP_S + 1e-12, "{answer:?}");
    assert!(matches!(stopped.holds(), Verification::Equal { extent: Extent::Stopped, .. }));
    assert_eq!(stopped.report.pacing, None);
    assert!(plate.interlock.release(Trip::EStop), "the rig is gone");
}

#[test]
fn a_watchdog_needs_no_flag_and_fails_the_run() {
    let plate = StoppedPlate::default();
    let trip_watchdog = || assert!(plate.interlock.trip(Trip::Watchdog));
    let stopped = StopRecord::run(&plate, false, 1, trip_watchdog, Some("no frame for 0.5 s"));
    assert_eq!((stopped.report.outcome, stopped.pulses), (Outcome::Failed, 0));
    assert_eq!(stopped.report.reason, "no frame for 0.5 s");
    let by_rig = RunEnd::from(RigError::Stopped(Trip::Watchdog)).reason;
    let tail = stopped.events.iter().rev().take(2).map(String::as_str);
    assert_eq!(tail.collect::<Vec<_>>(), ["no frame for 0.5 s", &by_rig]);
    assert!(matches!(stopped.holds(), Verification::Equal { extent: Extent::Stopped, .. }));
}

#[test]
fn process_stopped_in_a_pulse_loses_the_lease_under_strict_deadlines() {
    let plate = StoppedPlate::default();
    let stand_still = || plate.clock.ahead_ns.store(3_000_000_000, Ordering::Relaxed);
    let stopped = StopRecord::run_job(&short_job("strict"), &plate, true, 1, stand_still, None);
    assert_eq!((stopped.report.outcome, stopped.pulses), (Outcome::Failed, 0));
    let by_rig = RunEnd::from(RigError::Stopped(Trip::Lease)).reason;
    let reason = format!("{by_rig}; {TOO_BUSY}");
    assert_eq!(stopped.report.reason, reason);
    assert_eq!(stopped.report.stop.as_ref().map(|stop| stop.code), Some(StopCause::Found(Finding::DeadlineMissed)));
    assert_eq!(stopped.events.iter().rev().take(2).collect::<Vec<_>>(), [&reason, &by_rig]);
    let answer = plate.interlock.stop_times().unwrap();
    assert!(stopped.report.plate_time_s > answer.motors_off_at.secs() + 2.0, "time went on without force");
    let pacing = stopped.report.pacing.unwrap();
    assert!(pacing.deadline_misses == 1 && pacing.worst_late_frames > 10, "{pacing:?}");
    assert!(matches!(stopped.holds(), Verification::Equal { extent: Extent::Stopped, .. }));
}

#[test]
fn process_stopped_in_a_pulse_falls_behind_and_completes_under_relaxed_deadlines() {
    let plate = StoppedPlate::default();
    let stand_still = || plate.clock.ahead_ns.store(8_000_000_000, Ordering::Relaxed);
    let stalled = StopRecord::run_job(&short_job("relaxed"), &plate, true, 1, stand_still, None);
    let report = &stalled.report;
    let PacingReport { deadline_misses, behind_s, .. } = report.pacing.unwrap();
    assert_eq!((report.outcome, deadline_misses, &report.stop), (Outcome::Completed, 1, &None));
    assert!((behind_s - 8.0).abs() < 0.04, "{behind_s}");
    assert!(report.plate_time_s < 8.0, "plate time did not pass meanwhile: {}", report.plate_time_s);
    assert_eq!(plate.interlock.tripped(), None);
    assert!(matches!(stalled.holds(), Verification::Equal { extent: Extent::Whole, .. }));

    let fast = StopRecord::run_job(&short_job("strict"), &StoppedPlate::default(), false, 1, || (), None);
    let journal = |run: &StopRecord| std::fs::read(run.folder().join("journal.jsonl")).unwrap();
    assert!(journal(&stalled) == journal(&fast), "neither deadlines nor the computer's speed change a journal");
    let effective = std::fs::read_to_string(fast.folder().join("effective.json")).unwrap();
    let effective: Value = serde_json::from_str(&effective).unwrap();
    assert_eq!(effective["job"]["deadlines"], "strict");
    assert_eq!(fast.report.pacing, None, "there was no clock to keep to");
}

#[test]
fn run_on_a_tripped_plate_plays_nothing_and_reports_the_reason() {
    let plate = StoppedPlate::default();
    plate.interlock.trip(Trip::EStop);
    let stopped = StopRecord::run(&plate, false, 0, || (), None);
    let reason = RunEnd::from(RigError::Stopped(Trip::EStop)).reason;
    assert_eq!((stopped.report.outcome, &stopped.report.reason), (Outcome::Cancelled, &reason));
    assert_eq!((stopped.events.as_slice(), stopped.pulses, stopped.report.work.frames), ([reason].as_slice(), 0, 0));
    let files = RunFolder::reopen(&stopped.folder()).unwrap().files();
    assert_eq!(files, ["effective.json", "journal.jsonl", "report.json"]);
}

#[test]
fn a_cause_that_comes_too_late_changes_nothing() {
    let plate = StoppedPlate::default();
    let mut finish = FinalState { ending: RunEnd::completed("all in place"), ..FinalState::default() };
    let cause = || Some(ExternalStop::of(StopRequest::Cancelled, "late"));
    let controls = plate.controls(&cause);
    let mut heard = upm_recording::Fanout::default();
    controls.explain(&mut finish, &mut heard, PlateTime::ZERO);
    assert_eq!(finish.ending, RunEnd::completed("all in place"));
    finish.ending = RunEnd::stopped();
    controls.explain(&mut finish, &mut heard, PlateTime::ZERO);
    assert_eq!(finish.ending, RunEnd::cancelled(StopRequest::Cancelled, "late"));
}

#[test]
fn impossible_job_is_reported_beforehand_and_leaves_its_reason() {
    let job = crowded();
    let library = job_library(&job).unwrap();
    let fault = check_places(&job).unwrap_err();
    assert!(fault.to_string().contains("not all placed"), "{fault}");
    assert_eq!(check_places(&self::job()), Ok(()));

    let (plate, out) = (StoppedPlate::default(), TempDir::new().unwrap());
    let folder = RunFolder::create(out.path(), &job, "20260101T000000Z").unwrap();
    let path = folder.path().join("report.json");
    let mut watcher = upm_recording::Fanout::default();
    let done = run_linked(&job, library, folder, &options(&out), &*plate.clock, plate.controls(&|| None), &mut watcher);
    assert!(done.is_err_and(|error| error.is_bad_input()));
    let report: Report = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    assert!(report.reason.contains("not all placed") && report.outcome == Outcome::Failed, "{report:?}");
}

/// A job whose parts find no places.
fn crowded() -> JobSpec {
    let text = std::fs::read_to_string(config_file("plus-sign.json")).unwrap();
    let mut job: Value = serde_json::from_str(&text).unwrap();
    job["parts"] = serde_json::json!([{"kind": "quarter", "count": 42}]);
    job["task"] = serde_json::json!({"type": "hold", "duration_s": 1});
    job_in_configs(&job)
}

fn config_file(name: &str) -> PathBuf {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("configs").join(name)
}
