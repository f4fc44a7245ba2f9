//! The closed loop through the command line: run, report, journal, verification, endings.
#![allow(clippy::unwrap_used, clippy::panic)] // a test that cannot go on shall say so

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use serde_json::{Value, json};
use tempfile::TempDir;

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// A job on a shipped rig, written to `folder`.
fn job(folder: &Path, rig: &str, change: impl FnOnce(&mut Value)) -> PathBuf {
    let mut job = json!({
        "name": "test",
        "seed": 3,
        "rig": root().join(format!("configs/rigs/{rig}.json")),
        "parts": [{"kind": "penny"}],
        "task": {"type": "plus_sign", "laps": 1, "edge_margin_mm": 50},
        "limits": {"plate_time_s": 200},
    });
    change(&mut job);
    let path = folder.join("job.json");
    fs::write(&path, job.to_string()).unwrap();
    path
}

struct Run {
    folder: PathBuf,
    report: Value,
    status: i32,
}

fn run(job: &Path, out: &Path, rerun: &str) -> Run {
    let output = Command::cargo_bin("upm")
        .unwrap()
        .args(["run", job.to_str().unwrap(), "--out", out.to_str().unwrap(), "--rerun", rerun, "--json"])
        .output()
        .unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!stderr.contains("panicked"), "{stderr}");
    let report: Value = serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{e}: {stderr}"));
    let mut folders: Vec<PathBuf> = fs::read_dir(out).unwrap().map(|entry| entry.unwrap().path()).collect();
    assert_eq!(folders.len(), 1);
    Run { folder: folders.remove(0), report, status: output.status.code().unwrap() }
}

fn number(report: &Value, key: &str) -> f64 {
    report[key].as_f64().unwrap_or_else(|| panic!("{key} in {report}"))
}

#[test]
fn plus_sign_completes_on_the_weak_rig() {
    let folder = TempDir::new().unwrap();
    let run = run(&job(folder.path(), "upm-1", |_| ()), &folder.path().join("out"), "off");
    assert_eq!(run.status, 0, "{}", run.report);
    assert_eq!(run.report["outcome"], "completed");
    assert_eq!(run.report["laps"], 1);
    assert_eq!(run.report["lost_parts"], 0);
    assert!(number(&run.report, "cross_track_max_mm") <= 0.6, "{}", run.report);
    assert!(number(&run.report, "sensing_rms_error_mm") <= 0.1, "{}", run.report);
    assert!(number(&run.report, "max_error_mm") <= 0.6, "{}", run.report);
    let saved: Value = serde_json::from_str(&fs::read_to_string(run.folder.join("report.json")).unwrap()).unwrap();
    assert_eq!(saved, run.report);
}

#[test]
fn two_coins_follow_their_own_paths_on_the_strong_rig() {
    let folder = TempDir::new().unwrap();
    let file = job(folder.path(), "upm-2", |job| {
        job["parts"] = json!([
            {"kind": "penny", "position_mm": [-70, 0]},
            {"kind": "quarter", "position_mm": [70, 0]},
        ]);
        job["task"] = json!({"type": "trajectories", "paths": [
            {"waypoints_mm": [[-70, 20], [-50, 20]], "speed_mm_s": 15, "repeat": 1},
            {"waypoints_mm": [[70, -20], [50, 0]], "speed_mm_s": 15, "repeat": 1},
        ]});
    });
    let run = run(&file, &folder.path().join("out"), "off");
    assert_eq!(run.status, 0, "{}", run.report);
    assert_eq!(run.report["collisions"], 0);
    assert!(number(&run.report, "max_error_mm") <= 1.0, "{}", run.report);
}

#[test]
fn equal_seeds_give_equal_journals_with_and_without_recording() {
    for rig in ["upm-1", "upm-2"] {
        let folder = TempDir::new().unwrap();
        let file = job(folder.path(), rig, |job| job["limits"]["plate_time_s"] = json!(6));
        let recorded = if cfg!(feature = "rerun") { "save" } else { "off" };
        let runs = [run(&file, &folder.path().join("a"), "off"), run(&file, &folder.path().join("b"), recorded)];
        let [a, b] = runs.map(|run| fs::read(run.folder.join("journal.jsonl")).unwrap());
        assert!(a.len() > 1000);
        assert!(a == b, "{rig}: journals differ");
    }
}

#[test]
fn another_seed_gives_another_journal() {
    let folder = TempDir::new().unwrap();
    let journal = |seed: u64| {
        let file = job(folder.path(), "upm-1", |job| {
            job["seed"] = json!(seed);
            job["limits"]["plate_time_s"] = json!(2);
        });
        fs::read(run(&file, &folder.path().join(seed.to_string()), "off").folder.join("journal.jsonl")).unwrap()
    };
    assert_ne!(journal(1), journal(2));
}

#[test]
fn a_run_folder_alone_is_enough_to_verify_it() {
    for rig in ["upm-1", "upm-2"] {
        let folder = TempDir::new().unwrap();
        let file = job(folder.path(), rig, |job| job["limits"]["plate_time_s"] = json!(5));
        let done = run(&file, &folder.path().join("out"), "off");
        fs::remove_file(file).unwrap();
        let verify = || {
            let run = done.folder.to_str().unwrap();
            Command::cargo_bin("upm").unwrap().args(["verify", run]).output().unwrap().status.code()
        };
        assert_eq!(verify(), Some(0));
        let journal = done.folder.join("journal.jsonl");
        let text = fs::read_to_string(&journal).unwrap();
        fs::write(&journal, text.replacen("\"cycle\":1", "\"cycle\":9", 1)).unwrap();
        assert_eq!(verify(), Some(1), "a changed journal must not pass");
    }
}

#[test]
fn running_out_of_time_is_a_failure_with_its_reason() {
    let folder = TempDir::new().unwrap();
    let file = job(folder.path(), "upm-1", |job| job["limits"]["plate_time_s"] = json!(1.5));
    let run = run(&file, &folder.path().join("out"), "off");
    assert_eq!(run.status, 1);
    assert_eq!(run.report["outcome"], "failed");
    assert!(run.report["reason"].as_str().unwrap().contains("1.5 s"), "{}", run.report);
}

/// The shipped library of `upm-1`, altered by `change`, beside the job that names it.
fn with_library(folder: &Path, change: impl FnOnce(&mut Value)) -> PathBuf {
    let text = fs::read_to_string(root().join("assets/libraries/upm-1.json")).unwrap();
    let mut library: Value = serde_json::from_str(&text).unwrap();
    change(&mut library);
    fs::write(folder.join("library.json"), library.to_string()).unwrap();
    job(folder, "upm-1", |job| job["library"] = json!("library.json"))
}

#[test]
fn library_with_reversed_signs_ends_the_run_before_a_coin_is_lost() {
    let folder = TempDir::new().unwrap();
    // a library with all directions reversed drives the coin away from its target
    let file = with_library(folder.path(), |library| {
        for entry in library["entries"].as_array_mut().unwrap() {
            for amplitude in entry["amplitudes"].as_array_mut().unwrap() {
                *amplitude = json!(-amplitude.as_i64().unwrap());
            }
        }
    });
    let run = run(&file, &folder.path().join("out"), "off");
    assert_eq!(run.status, 1, "{}", run.report);
    assert_eq!((&run.report["outcome"], &run.report["lost_parts"]), (&json!("failed"), &json!(0)));
    let code = run.report["stop"]["code"].as_str().unwrap();
    assert!(["motion_off", "coil_fault", "part_astray"].contains(&code), "{}", run.report);
}

#[test]
fn coin_that_is_taken_off_the_plate_ends_the_run_as_failed() {
    let folder = TempDir::new().unwrap();
    let faults = json!([{"component": "part0", "kind": "removed", "from_s": 1.0}]);
    let file = job(folder.path(), "upm-1", |job| job["faults"] = faults);
    let run = run(&file, &folder.path().join("out"), "off");
    assert_eq!(run.status, 1, "{}", run.report);
    assert_eq!((&run.report["outcome"], &run.report["lost_parts"]), (&json!("failed"), &json!(1)));
    assert_eq!(run.report["stop"]["code"], "part_lost");
    assert!(run.report["reason"].as_str().unwrap().contains("penny-1 is lost"), "{}", run.report);
    assert!(fs::metadata(run.folder.join("journal.jsonl")).unwrap().len() > 0);
}

#[test]
fn motions_out_of_the_motors_reach_are_refused() {
    let folder = TempDir::new().unwrap();
    let file = with_library(folder.path(), |library| library["entries"][3]["amplitudes"] = json!([900, -900, 0, 0]));
    let output = Command::cargo_bin("upm").unwrap().args(["run", file.to_str().unwrap()]).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(stderr.contains("library.json: entries[3].amplitudes: expected amplitudes"), "{stderr}");
}

#[test]
fn an_interrupt_closes_the_run_in_good_order() {
    let folder = TempDir::new().unwrap();
    let file = job(folder.path(), "upm-1", |job| {
        job["task"]["laps"] = json!(0);
        job["limits"]["plate_time_s"] = json!(3600);
    });
    let out = folder.path().join("out");
    let child = std::process::Command::new(env!("CARGO_BIN_EXE_upm"))
        .args(["run", file.to_str().unwrap(), "--out", out.to_str().unwrap(), "--json"])
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    wait_for_journal(&out);
    assert!(std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", String::from_utf8_lossy(&output.stderr));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["outcome"], "cancelled");
    assert_eq!(report["stop"]["code"], "interrupted");
    let folder = fs::read_dir(&out).unwrap().next().unwrap().unwrap().path();
    let journal = fs::read_to_string(folder.join("journal.jsonl")).unwrap();
    assert!(journal.lines().all(|line| serde_json::from_str::<Value>(line).is_ok()), "no half line");
    assert!(folder.join("report.json").exists());
    let verify =
        Command::cargo_bin("upm").unwrap().args(["verify", folder.to_str().unwrap(), "--json"]).output().unwrap();
    let verdict: Value = serde_json::from_slice(&verify.stdout).unwrap();
    assert_eq!((&verdict["equal"], &verdict["stopped"]), (&json!(true), &json!(true)), "{verdict}");
}

#[test]
fn a_run_in_real_time_counts_its_deadlines() {
    let folder = TempDir::new().unwrap();
    // at rest, so that a computer that stalls only misses deadlines
    let file = job(folder.path(), "upm-1", |job| job["task"] = json!({"type": "hold", "duration_s": 0.5}));
    let out = folder.path().join("out");
    let args = ["run", file.to_str().unwrap(), "--out", out.to_str().unwrap(), "--pace", "real-time", "--json"];
    let output = Command::cargo_bin("upm").unwrap().args(args).output().unwrap();
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((output.status.code(), &report["outcome"]), (Some(0), &json!("completed")), "{report}");
    assert!(report["deadline_misses"].is_u64() && report["worst_late_frames"].is_u64(), "{report}");
    assert!(report["behind_s"].is_f64(), "{report}");
}

/// Waits until a run in `out` has a cycle in its journal.
fn wait_for_journal(out: &Path) {
    let has_cycle = |run: fs::DirEntry| {
        fs::read_to_string(run.path().join("journal.jsonl")).is_ok_and(|text| text.contains(r#""type":"cycle""#))
    };
    for _ in 0..2000 {
        if fs::read_dir(out).is_ok_and(|mut runs| runs.any(|run| run.is_ok_and(has_cycle))) {
            return;
        }
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    panic!("no cycle is written");
}

#[test]
#[cfg(feature = "rerun")]
fn a_run_that_cannot_begin_leaves_its_reason() {
    let folder = TempDir::new().unwrap();
    let file = job(folder.path(), "upm-1", |_| ());
    let out = folder.path().join("out");
    let args = ["run", file.to_str().unwrap(), "--out", out.to_str().unwrap(), "--rerun"];
    let bad_address = Command::cargo_bin("upm").unwrap().args(args).arg("connect=nonsense").output().unwrap();
    assert_eq!(bad_address.status.code(), Some(2));
    assert!(!out.exists(), "bad usage leaves nothing");
    // with `CI` set, Rerun warns about a viewer that no one would see
    let spawn = |upm: &mut Command| upm.args(args).arg("spawn").env("PATH", "").env_remove("CI").output().unwrap();
    let no_viewer = spawn(&mut Command::cargo_bin("upm").unwrap());
    assert_eq!(no_viewer.status.code(), Some(1));
    assert_eq!(String::from_utf8(no_viewer.stderr).unwrap().lines().count(), 1);
    let folder = fs::read_dir(&out).unwrap().next().unwrap().unwrap().path();
    let report: Value = serde_json::from_str(&fs::read_to_string(folder.join("report.json")).unwrap()).unwrap();
    assert_eq!(report["outcome"], "failed");
    assert!(report["reason"].as_str().unwrap().contains("Rerun viewer"), "{report}");
}
