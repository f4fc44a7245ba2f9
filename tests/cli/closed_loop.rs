//! The closed loop through the command line: run, report, journal, verification, endings.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::thread::sleep;
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};
use tempfile::TempDir;

use super::{file, read, root, run, status, upm};

/// A job on a shipped rig, written to `folder`; on `upm-2` with the planner that is ready soonest.
fn job(folder: &Path, rig: &str, change: impl FnOnce(&mut Value)) -> PathBuf {
    let planner = if rig == "upm-2" { "synthesized_field" } else { "cor_sequence" };
    let mut job = json!({
        "name": "test",
        "seed": 3,
        "planner": planner,
        "rig": root().join(format!("configs/rigs/{rig}.json")),
        "parts": [{"kind": "penny"}],
        "task": {"type": "plus_sign", "laps": 1, "edge_margin_mm": 80},
        "limits": {"plate_time_s": 200},
    });
    change(&mut job);
    file(folder, "job.json", &job)
}

/// Runs a job in a new folder.
fn outcome(rig: &str, change: impl FnOnce(&mut Value), expected: i32) -> (TempDir, PathBuf, Value) {
    let folder = TempDir::new().unwrap();
    let (run, report) = run(&job(folder.path(), rig, change), &folder.path().join("out"), &[], expected);
    (folder, run, report)
}

fn journal(run: &Path) -> Vec<u8> {
    fs::read(run.join("journal.jsonl")).unwrap()
}

#[test]
fn plus_sign_completes_on_the_weak_rig() {
    let (_folder, run, report) = outcome("upm-1", |_| (), 0);
    assert_eq!((&report["outcome"], &report["laps"]), (&json!("completed"), &json!(1)));
    let bars = [("cross_track_max_mm", 0.6), ("sensing_rms_error_mm", 0.1), ("max_error_mm", 0.6), ("lost_parts", 0.0)];
    for (key, bar) in bars {
        assert!(report[key].as_f64().is_some_and(|value| value <= bar), "{key}: at most {bar}: {report}");
    }
    let saved: Value = serde_json::from_str(&fs::read_to_string(run.join("report.json")).unwrap()).unwrap();
    assert_eq!(saved, report);
}

#[test]
fn run_is_repeated_byte_for_byte_from_its_folder_and_by_its_seed_alone() {
    let folder = TempDir::new().unwrap();
    let made = |rig: &str, seed: u64, out: &str, rerun: &str| {
        let file = job(folder.path(), rig, |job| {
            job["limits"]["plate_time_s"] = json!(1);
            job["seed"] = json!(seed);
        });
        let out = folder.path().join(out);
        upm().args(["run", "-q", "--rerun", rerun]).arg(file).arg("--out").arg(&out).output().unwrap();
        fs::read_dir(out).unwrap().next().unwrap().unwrap().path()
    };
    let recorded = if cfg!(feature = "rerun") { "save" } else { "off" };
    let weak = made("upm-1", 3, "weak", "off");
    let runs = [(3, "a", "off"), (3, "b", recorded), (4, "c", "off")]
        .map(|(seed, out, rerun)| made("upm-2", seed, out, rerun));
    let [a, b, other] = runs.each_ref().map(|run| journal(run));
    assert!(a.len() > 1000 && a == b && a != other, "equal seeds, equal journals; with a recording, too");
    fs::remove_file(folder.path().join("job.json")).unwrap();
    for run in [&weak, &runs[0]] {
        status(&["verify", run.to_str().unwrap()], 0);
    }
    let changed = String::from_utf8(a).unwrap().replacen("\"cycle\":1", "\"cycle\":9", 1);
    fs::write(runs[0].join("journal.jsonl"), changed).unwrap();
    status(&["verify", runs[0].to_str().unwrap()], 1);
}

/// The shipped library of `upm-1`, altered by `change`, beside the job that names it.
fn with_library(folder: &Path, change: impl FnOnce(&mut Value)) -> PathBuf {
    let mut library = read("assets/libraries/upm-1.json");
    change(&mut library);
    file(folder, "library.json", &library);
    job(folder, "upm-1", |job| job["library"] = json!("library.json"))
}

#[test]
fn library_with_reversed_signs_ends_the_run_before_a_coin_is_lost() {
    let folder = TempDir::new().unwrap();
    // a library with all directions reversed drives the coin away from its target
    let file = with_library(folder.path(), |library| {
        let entries = library["entries"].as_array_mut().unwrap().iter_mut();
        for amplitude in entries.flat_map(|entry| entry["amplitudes"].as_array_mut().unwrap()) {
            *amplitude = json!(-amplitude.as_i64().unwrap());
        }
    });
    let (_, report) = run(&file, &folder.path().join("out"), &[], 1);
    assert_eq!((&report["outcome"], &report["lost_parts"]), (&json!("failed"), &json!(0)));
    let code = report["stop"]["code"].as_str().unwrap();
    assert!(["motion_off", "coil_fault"].contains(&code), "{report}");
}

#[test]
fn an_interrupt_closes_the_run_in_good_order() {
    let folder = TempDir::new().unwrap();
    let file = job(folder.path(), "upm-2", |job| {
        job["task"]["laps"] = json!(0);
        job["limits"]["plate_time_s"] = json!(3600);
    });
    let out = folder.path().join("out");
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_upm"));
    command.args(["run", "--json"]).arg(file).arg("--out").arg(&out).stdout(Stdio::piped()).stderr(Stdio::null());
    let child = command.spawn().unwrap();
    wait_for_cycle(&out);
    kill_process(Pid::from_child(&child), Signal::INT).unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&report["outcome"], &report["stop"]["code"]), (&json!("cancelled"), &json!("interrupted")));
    let folder = fs::read_dir(&out).unwrap().next().unwrap().unwrap().path();
    let journal = String::from_utf8(journal(&folder)).unwrap();
    assert!(journal.lines().all(|line| serde_json::from_str::<Value>(line).is_ok()), "no half line");
    assert!(folder.join("report.json").exists());
    let verdict: Value = serde_json::from_str(&status(&["verify", folder.to_str().unwrap(), "--json"], 0).0).unwrap();
    assert_eq!((&verdict["equal"], &verdict["stopped"]), (&json!(true), &json!(true)), "{verdict}");
}

/// Waits until a run in `out` has a cycle in its journal.
pub(super) fn wait_for_cycle(out: &Path) {
    let has_cycle = |run: fs::DirEntry| {
        fs::read_to_string(run.path().join("journal.jsonl")).is_ok_and(|text| text.contains(r#""type":"cycle""#))
    };
    for _ in 0..6000 {
        if fs::read_dir(out).is_ok_and(|mut runs| runs.any(|run| run.is_ok_and(has_cycle))) {
            return;
        }
        sleep(Duration::from_millis(10));
    }
    panic!("no cycle is written");
}

#[test]
fn a_run_in_real_time_counts_its_deadlines() {
    let folder = TempDir::new().unwrap();
    // at rest, so that a computer that stalls only misses deadlines
    let file = job(folder.path(), "upm-2", |job| job["task"] = json!({"type": "hold", "duration_s": 0.5}));
    let (_, report) = run(&file, &folder.path().join("out"), &["--pace", "real-time"], 0);
    assert!(report["deadline_misses"].is_u64() && report["worst_late_frames"].is_u64(), "{report}");
    assert!(report["behind_s"].is_f64(), "{report}");
}

#[test]
#[cfg(feature = "rerun")]
fn a_run_that_cannot_begin_leaves_its_reason() {
    let folder = TempDir::new().unwrap();
    let file = job(folder.path(), "upm-2", |_| ());
    let out = folder.path().join("out");
    let args = ["run", file.to_str().unwrap(), "--out", out.to_str().unwrap(), "--rerun"];
    status(&[&args[..], &["connect=nonsense"]].concat(), 2);
    assert!(!out.exists(), "bad usage leaves nothing");
    // with `CI` set, Rerun warns about a viewer that no one would see
    let no_viewer = upm().args(args).arg("spawn").env("PATH", "").env_remove("CI").output().unwrap();
    assert_eq!(no_viewer.status.code(), Some(1));
    assert_eq!(String::from_utf8(no_viewer.stderr).unwrap().lines().count(), 1);
    let folder = fs::read_dir(&out).unwrap().next().unwrap().unwrap().path();
    let report: Value = serde_json::from_str(&fs::read_to_string(folder.join("report.json")).unwrap()).unwrap();
    assert_eq!(report["outcome"], "failed");
    assert!(report["reason"].as_str().unwrap().contains("Rerun viewer"), "{report}");
}
