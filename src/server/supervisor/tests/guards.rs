//! Ends by a guard: the plate is paused and reports the cause and the remedy.

use super::*;

const REST: &str = r#"{ "name": "rest", "parts": [{ "kind": "penny" }], "planner": "synthesized_field",
    "task": { "type": "hold", "duration_s": 0.2 } }"#;

/// Runs a job with one fault on a plate with a watchdog; returns its report and the plate's pause.
fn ended_with(component: &str, kind: &str, from_s: f64, to_s: Option<f64>) -> (serde_json::Value, Option<PauseCause>) {
    let test_plates = TestPlates { allow_faults: true, ..TestPlates::new() };
    let plates = test_plates.open(None);
    let plate = plates.get("one").unwrap();
    let fault = serde_json::json!([{"component": component, "kind": kind, "from_s": from_s, "to_s": to_s}]);
    let text = TWO_COINS.replace("\"seed\"", &format!("\"faults\": {fault}, \"seed\""));
    let [job, behind] = [&text, REST].map(|text| test_plates.submit(plate, text, Pace::Max));
    let report = test_plates.ended(&job).job.report.unwrap().into();
    let pause = plate.paused();
    if pause.is_some() {
        assert_eq!(test_plates.row(&behind).state, JobState::Queued);
        assert!(plate.resume(caller("ann")));
    }
    assert_eq!(test_plates.ended(&behind).state, JobState::Completed);
    (report, pause)
}

#[test]
fn guards_bound_the_wait_for_pictures_beyond_watchdog_limits() {
    const { assert!(WATCHDOG.no_part_s < 1.0, "the watchdog would be first") };
    let (report, pause) = ended_with("camera", "freeze", 0.3, Some(1.3));
    assert_eq!((report["outcome"].as_str(), pause), (Some("completed"), None), "{}", report["reason"]);
    for (kind, code) in [("freeze", "camera_frozen"), ("dark", "camera_dark")] {
        let (report, pause) = ended_with("camera", kind, 0.3, None);
        let pause = pause.unwrap();
        assert_eq!((report["stop"]["code"].as_str(), pause.code.as_str()), (Some(code), code), "{}", report["reason"]);
        assert_eq!(report["stop"]["remedy"], pause.remedy);
    }
}

#[test]
fn lost_part_pauses_the_plate_for_an_operator() {
    let (report, pause) = ended_with("part0", "removed", 0.2, None);
    let (reason, pause) = (report["reason"].as_str().unwrap(), pause.unwrap());
    assert_eq!((&report["outcome"], &report["stop"]["code"]), (&"failed".into(), &pause.code.as_str().into()));
    assert!(reason.contains("is lost, last seen at"), "{reason}");
    assert_eq!(pause.why, format!("the last job was stopped: {reason}"));
    assert!(pause.remedy_in_why && reason.ends_with(&format!("; {}", pause.remedy)), "{reason}: {pause:?}");
}

#[test]
fn job_with_faults_is_refused_unless_the_file_allows_them() {
    let test_plates = TestPlates::new();
    let plates = test_plates.open(None);
    let text = TWO_COINS.replace("\"seed\"", r#""faults": [{"component": "camera", "kind": "freeze"}], "seed""#);
    let refused = plates.get("one").unwrap().rules.validated(&text, Pace::Max).unwrap_err();
    let line = "job: faults: expected none (unless the daemon's file says \"allow_faults\": true), found 1 fault";
    assert_eq!(refused.iter().map(ToString::to_string).collect::<Vec<_>>(), [line]);
}

#[test]
fn job_with_a_library_is_refused() {
    let plates = TestPlates::new().open(None);
    let refusal = |value: &str| {
        let text = TWO_COINS.replace("\"seed\"", &format!(r#""library": {value}, "seed""#));
        let refused = plates.get("one").unwrap().rules.validated(&text, Pace::Max).unwrap_err();
        refused.iter().map(ToString::to_string).collect::<Vec<_>>()
    };
    let line = "job: library: expected nothing (plate one has its library), found a library";
    assert_eq!(refusal(&library().to_json()), [line]);
    let line = "job: library: expected nothing (files cannot be named here), found \"upm-2.json\"";
    assert_eq!(refusal("\"upm-2.json\""), [line]);
}

#[test]
fn finding_of_the_run_is_shown_while_it_holds_with_a_remedy() {
    let test_plates = TestPlates { allow_faults: true, ..TestPlates::new() };
    let plates = test_plates.open(None);
    let plate = plates.get("one").unwrap();
    let fault = r#""faults": [{"component": "camera", "kind": "dark", "from_s": 0.5, "to_s": 2.0}], "seed""#;
    let id = test_plates.submit(plate, &HOLD.replace("\"seed\"", fault), Pace::RealTime);
    until_seen(plate, &id);
    let shown = || plate.snapshot().observation.findings;
    assert_eq!(shown(), [], "all is well at first");
    let held = eventually("a finding", || shown().pop());
    assert_eq!(held.code, "camera_dark");
    assert!(!held.reason.is_empty() && !held.remedy.is_empty(), "{held:?}");
    eventually_true("it ends", || shown().is_empty());
    plates.shutdown(LONG);
}
