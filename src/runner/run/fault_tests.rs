use std::sync::LazyLock;

use serde_json::{Value, json};
use tempfile::TempDir;

use super::testing::{job_in_configs, played, with_small_pictures};
use super::*;
use crate::config::PlannerChoice;
use upm_core::job::{CameraMode, Finding, Outcome, StopCause};
use upm_recording::Verdict as Truth;

/// Two pennies that are moved by 40 mm each, with `faults`.
fn job(faults: &Value) -> JobSpec {
    let task = json!({"type": "arrange", "targets_mm": [[30, -10], [-30, -10]], "assignment": "fixed"});
    job_of(&task, faults)
}

fn job_of(task: &Value, faults: &Value) -> JobSpec {
    let mut text = json!({
        "name": "faulty",
        "rig": "rigs/upm-2.json",
        "planner": "synthesized_field",
        "parts": [{"kind": "penny", "position_mm": [60, 20]}, {"kind": "penny", "position_mm": [-60, 20]}],
        "task": task,
        "limits": {"plate_time_s": 20},
    });
    if !faults.is_null() {
        text["faults"] = faults.clone();
    }
    job_in_configs(&text)
}

/// The parts of [`job`], moved without a pause.
fn moving(faults: &Value) -> Report {
    let mut job = job(faults).with_camera(CameraMode::Positions);
    job.document.planner = PlannerChoice::MovingField;
    played(&job).1.report
}

#[test]
fn parts_arrive_without_a_pause_and_the_senses_watch_them() {
    let report = moving(&Value::Null);
    assert_eq!((report.outcome, report.verdict), (Outcome::Completed, Some(Truth::True)), "{report:?}");
    assert!(report.plate_time_s < PLAIN.0.plate_time_s, "{} s", report.plate_time_s);
    let fault = |component, kind, from_s| json!({"component": component, "kind": kind, "from_s": from_s});
    let mut late = fault("camera", "late", 0.0);
    late["value"] = json!(6);
    for (fault, finding) in [
        // when a segment ends: the next one shows it from its beginning
        (fault("coil1", "dead", 0.434), Finding::CoilFault),
        (late, Finding::CameraLate),
        (fault("camera", "freeze", 0.3), Finding::CameraFrozen),
        (fault("part0", "glued", 0.0), Finding::PartStuck),
    ] {
        let stop = moving(&json!([fault])).stop.map(|stop| stop.code);
        assert_eq!(stop, Some(StopCause::Found(finding)), "{fault}");
    }
}

fn run_of(faults: &Value) -> (TempDir, RunResult) {
    played(&job(faults))
}

fn bytes(done: &RunResult, name: &str) -> String {
    std::fs::read_to_string(done.folder.join(name)).unwrap_or_default()
}

/// A run of the job without faults: its report, its journal, and whether it wrote the truth.
static PLAIN: LazyLock<(Report, String, bool)> = LazyLock::new(|| {
    let (_folder, done) = run_of(&Value::Null);
    let (journal, has_truth) = (bytes(&done, "journal.jsonl"), done.folder.join(folder::TRUTH_FILE).exists());
    (done.report, journal, has_truth)
});

#[test]
fn run_without_faults_keeps_its_bytes_and_writes_no_truth() {
    let ((plain, journal, has_truth), (_b, none)) = (&*PLAIN, run_of(&json!([])));
    assert_eq!(plain.outcome, Outcome::Completed, "{}", plain.reason);
    assert_eq!(*journal, bytes(&none, "journal.jsonl"));
    assert!(!has_truth);
    assert_eq!((plain.verdict, plain.incidents.faults.len()), (Some(Truth::True), 0));
    // a fault that never begins changes only the record of it
    let (_c, later) = run_of(&json!([{"component": "coil0", "kind": "dead", "from_s": 1000.0}]));
    assert_eq!(*journal, bytes(&later, "journal.jsonl"));
    assert_eq!(bytes(&later, folder::TRUTH_FILE).lines().count() as u64, later.report.work.frames);
}

#[test]
fn faulty_run_is_reported_and_repeats_from_its_folder() {
    let faults = json!([
        {"component": "camera", "kind": "drop", "value": 0.3, "from_s": 0.2},
        {"component": "accel1", "kind": "garbage", "from_s": 0.1, "to_s": 0.9},
        {"component": "coils", "kind": "chatter", "value": 0.1, "from_s": 0.3, "to_s": 0.8},
        {"component": "part0", "kind": "moved", "value": [3, 0], "from_s": 0.5},
    ]);
    let (_out, done) = run_of(&faults);
    assert_eq!(done.report.incidents.faults.len(), 4);
    let effective: Value = serde_json::from_str(&bytes(&done, "effective.json")).unwrap();
    assert_eq!(effective["job"]["faults"][3]["kind"], "moved");
    let verified = || verify(&done.folder, &AtomicBool::new(false), &mut Fanout::default()).unwrap();
    let verdict = verified();
    assert!(matches!(verdict, Verification::Equal { extent: Extent::Whole, .. }), "{verdict:?}");

    let journal = bytes(&done, "journal.jsonl");
    std::fs::write(done.folder.join("journal.jsonl"), journal.replace('\n', "\r\n")).unwrap();
    assert_eq!(verified(), Verification::LineEnds);
    // as a program leaves it that is killed while it writes a line
    std::fs::write(done.folder.join("journal.jsonl"), &journal[..journal.len() / 2]).unwrap();
    std::fs::remove_file(done.folder.join(folder::REPORT_FILE)).unwrap();
    let verdict = verified();
    assert!(matches!(verdict, Verification::Equal { extent: Extent::Killed, lines } if lines > 2), "{verdict:?}");
}

#[test]
fn small_pulse_names_a_coil_before_a_part_has_moved() {
    let faults =
        [("coil1", "dead", Value::Null), ("coil2", "reversed", Value::Null), ("coils", "swapped", json!([0, 2]))];
    for (component, kind, value) in faults {
        let mut fault = json!({"component": component, "kind": kind});
        if !value.is_null() {
            fault["value"] = value;
        }
        let (_folder, done) = played(&with_small_pictures(job(&json!([fault]))));
        assert_eq!(
            done.report.stop.map(|stop| stop.code),
            Some(StopCause::Found(Finding::CoilFault)),
            "{}",
            done.report.reason
        );
        for part in &done.report.parts {
            let [x, y] = part.true_mm.unwrap();
            let moved_mm = (x.abs() - 60.0).hypot(y - 20.0);
            assert!(moved_mm < 0.6, "{kind}: {moved_mm} mm");
        }
    }
}

/// Cause of the end, or code of the last guard that fired in a run that completed; whether it completed; its verdict.
fn noticed(fault: &str) -> (Option<String>, bool, Option<Truth>) {
    let job = with_small_pictures(job(&Value::Null));
    let (_folder, done) = played(&job.with_faults(&[fault.to_owned()]).unwrap());
    let Report { outcome, stop, incidents, verdict, reason, .. } = done.report;
    if let Some(stop) = &stop {
        assert!(stop.code.pauses_plate(), "{fault}: {reason}");
        assert!(reason.contains("; "), "{fault}: without a remedy: {reason}");
    }
    let code = stop.map(|stop| serde_json::to_value(stop.code).unwrap().as_str().unwrap().to_owned());
    (code.or_else(|| incidents.guards.last().map(|guard| guard.code.clone())), outcome == Outcome::Completed, verdict)
}

#[test]
fn frames_with_an_old_stamp_end_the_run_only_after_two_seconds() {
    assert_eq!(noticed("clock:skew=-3@0.5-0.53"), (None, true, Some(Truth::True)));
    let lasting = with_small_pictures(job(&Value::Null)).with_faults(&["clock:skew=-1.9@0.5".to_owned()]).unwrap();
    let (_folder, done) = played(&lasting);
    assert_eq!(
        done.report.stop.map(|stop| stop.code),
        Some(StopCause::Found(Finding::CameraStale)),
        "{}",
        done.report.reason
    );
    assert!((2.4..2.7).contains(&done.report.plate_time_s), "{} s", done.report.plate_time_s);
}

/// One of a kind: the schedules of `tools/faults.py` have them all.
#[test]
fn each_fault_of_camera_and_parts_ends_the_run_by_its_code() {
    for (fault, code) in [
        ("camera:freeze@0.5", "camera_frozen"),
        ("view:ghost=30;-60@0.5", "foreign_part"),
        // taken for the part that goes once both were seen
        ("view:ghost=60;55@0.021,part0:removed@0.034", "foreign_part"),
        ("part0:glued@0", "part_stuck"),
    ] {
        assert_eq!(noticed(fault), (Some(code.to_owned()), false, Some(Truth::True)), "{fault}");
    }
}

#[test]
fn faults_that_pass_are_waited_for_and_the_run_completes_truly() {
    for (fault, code) in [
        ("camera:shift=20;10@0.5", "camera_moved"),
        ("view:hand=0.33@0.5-1.5", "view_hidden"),
        ("accel0:dead@0", "accelerometer_fault"),
        ("coil0:gain=0.85@0", "coil_fault"),
    ] {
        assert_eq!(noticed(fault), (Some(code.to_owned()), true, Some(Truth::True)), "{fault}");
    }
}

#[test]
fn completed_run_whose_parts_truly_are_elsewhere_is_a_false_success() {
    let report = &PLAIN.0;
    let displaced = |by_mm: f64| {
        let mut report = report.clone();
        let part = &mut report.parts[1];
        part.true_mm = part.true_mm.map(|[x, y]| [x + by_mm, y]);
        part.error_mm = part.error_mm.map(|error_mm| error_mm + by_mm);
        report
    };
    let arrange = job(&Value::Null);
    let path = |x: f64, y: f64| json!({"waypoints_mm": [[x, y], [x, y + 20.0]], "speed_mm_s": 20, "repeat": 0});
    let endless = json!({"type": "trajectories", "paths": [path(30.0, -10.0), path(-30.0, -10.0)]});
    for job in [arrange, job_of(&endless, &Value::Null)] {
        assert_eq!(verdict(&job, report), Some(Truth::True));
        assert_eq!(verdict(&job, &displaced(5.0)), Some(Truth::FalseSuccess));
        let failed = Report { outcome: Outcome::Failed, ..displaced(5.0) };
        assert_eq!(verdict(&job, &failed), Some(Truth::True), "it does not say that it is done");
    }
}

/// Four coins that are moved by one rotation after the other.
#[test]
fn camera_that_shows_no_plate_is_waited_for_and_then_ends_the_run_in_the_middle_of_a_cycle() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/arrange-4-cor.json");
    let job = with_small_pictures(JobSpec::load(std::path::Path::new(file)).unwrap());
    let (_folder, done) = played(&job.with_faults(&["camera:dark@1".to_owned()]).unwrap());
    let Report { outcome, stop, plate_time_s, reason, .. } = &done.report;
    assert_eq!(stop.as_ref().map(|stop| stop.code), Some(StopCause::Found(Finding::CameraDark)), "{reason}");
    assert!(*outcome == Outcome::Failed && reason.contains("check the light"), "{reason}");
    assert!((6.0..7.0).contains(plate_time_s), "{plate_time_s}");
    assert!(bytes(&done, "journal.jsonl").contains("unfinished_cycle"));
}
