//! `upm run --seeds` as a subprocess: one job with many seeds.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;

use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};
use tempfile::TempDir;

use super::closed_loop::wait_for_cycle;
use super::{run, shipped, status, upm};

/// A job that moves one penny from a random place to the middle, with the planner that is ready soonest.
fn to_the_middle(folder: &Path, change: impl FnOnce(&mut Value)) -> PathBuf {
    shipped(folder, "plus-sign-upm-2", |job| {
        job["name"] = json!("to-the-middle");
        job["planner"] = json!("synthesized_field");
        job["task"] = json!({"type": "arrange", "targets_mm": [[0, 0]]});
        change(job);
    })
}

/// Runs a batch without pixels.
fn batch(file: &Path, out: &Path, more: &[&str], expected: i32) -> (String, String) {
    let args = ["run", file.to_str().unwrap(), "--camera", "positions", "--out", out.to_str().unwrap()];
    status(&[&args, more].concat(), expected)
}

fn json_of(text: &str) -> Value {
    serde_json::from_str(text).unwrap()
}

fn runs(summary: &Value) -> &[Value] {
    summary["runs"].as_array().unwrap()
}

#[test]
fn run_of_a_batch_is_the_single_run_of_its_seed() {
    let folder = TempDir::new().unwrap();
    let file = to_the_middle(folder.path(), |_| {});
    let [many, alone] = ["many", "alone"].map(|name| folder.path().join(name));
    let summary = json_of(&batch(&file, &many, &["--seeds", "31..32,7", "--json", "-q"], 0).0);
    assert_eq!(summary, json_of(&fs::read_to_string(many.join("summary.json")).unwrap()));
    let seeds: Vec<u64> = runs(&summary).iter().map(|run| run["seed"].as_u64().unwrap()).collect();
    assert_eq!((seeds, &summary["completed"], &summary["seeds"]), (vec![31, 32, 7], &json!(3), &json!(3)));
    let (of_single, single) = run(&file, &alone, &["--seed", "32", "--camera", "positions"], 0);
    let of_batch = &runs(&summary)[1];
    for key in ["seed", "outcome", "reason", "plate_time_s", "cycles", "pulses", "max_error_mm", "collisions"] {
        assert_eq!(of_batch[key], single[key], "{key}");
    }
    let journal = |folder: &Path| fs::read(folder.join("journal.jsonl")).unwrap();
    let of_batch = PathBuf::from(of_batch["folder"].as_str().unwrap());
    assert!(journal(&of_batch) == journal(&of_single), "the journals are equal byte for byte");
    assert!(!of_batch.join("run.rrd").exists(), "recordings are off unless asked for");
}

#[test]
fn failed_seeds_are_named_with_their_reason_and_give_the_exit_status() {
    let folder = TempDir::new().unwrap();
    let out = folder.path().join("out");
    let file = to_the_middle(folder.path(), |_| {});
    let all = json_of(&batch(&file, &out, &["--seeds", "1..6", "--json"], 0).0);
    // with the median time as the limit, half of the runs are too slow
    let limit_s = all["figures"]["plate_time_s"]["median"].as_f64().unwrap();
    let file = to_the_middle(folder.path(), |job| job["limits"]["plate_time_s"] = json!(limit_s));
    let (table, _) = batch(&file, &out, &["--seeds", "1..6"], 1);
    let summary = json_of(&fs::read_to_string(out.join("summary.json")).unwrap());
    assert_eq!([&summary["completed"], &summary["failed"]], [3, 3], "{table}");
    for (before, after) in runs(&all).iter().zip(runs(&summary)) {
        let failed = before["plate_time_s"].as_f64().unwrap() > limit_s;
        assert_eq!((after["status"] == 1, after["code"] == "time_limit"), (failed, failed), "{after}");
    }
}

#[test]
fn batch_that_cannot_be_run_is_refused_in_one_line_and_leaves_nothing() {
    let folder = TempDir::new().unwrap();
    let file = to_the_middle(folder.path(), |_| {});
    let out = folder.path().join("out");
    for (args, said) in [
        (&["--seeds", "20..1"][..], "upm: --seeds: expected FIRST..LAST or seeds by comma"),
        (
            &["--seeds", "0..10000"],
            "upm: --seeds: expected FIRST..LAST or seeds by comma, 10000 at most, found more than 10000 seeds",
        ),
        (&["--seeds", "4,4"], "upm: --seeds: expected each seed once, found 4 twice"),
        (&["--seeds", "1..2", "--rerun", "nowhere"], "upm: --rerun: "),
        (&["--seeds", "1..2", "--pace", "real-time"], "upm: --pace: expected max (with --seeds), found real-time"),
        (&["--seeds", "1..2", "--faults", "coil9:dead"], "upm: --faults"),
    ] {
        let (stdout, stderr) = batch(&file, &out, args, 2);
        assert!(stdout.is_empty() && stderr.starts_with(said), "{args:?}: {stderr}");
        assert_eq!(stderr.lines().count(), 1, "{stderr}");
    }
    batch(&file, &out, &["--seeds", "1..2", "--seed", "1"], 2);
    assert!(!out.exists());
}

#[test]
fn interrupted_batch_ends_with_a_summary_of_its_runs() {
    let folder = TempDir::new().unwrap();
    let file = to_the_middle(folder.path(), |job| job["task"] = json!({"type": "plus_sign", "laps": 0}));
    let out = folder.path().join("out");
    let mut command = upm();
    command.args(["run", "--seeds", "1..500", "--json", "--camera", "positions", "--out"]).arg(&out).arg(file);
    let child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    wait_for_cycle(&out);
    kill_process(Pid::from_child(&child), Signal::INT).unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130));
    let summary = json_of(std::str::from_utf8(&output.stdout).unwrap());
    let count = |key: &str| summary[key].as_u64().unwrap();
    assert!(count("cancelled") >= 1 && count("not_started") >= 400, "{summary}");
    let folders = fs::read_dir(&out).unwrap().filter(|entry| entry.as_ref().unwrap().path().is_dir()).count();
    assert_eq!(count("not_started") as usize + folders, 500);
    for run in runs(&summary) {
        let report = fs::read_to_string(Path::new(run["folder"].as_str().unwrap()).join("report.json")).unwrap();
        assert_eq!(json_of(&report)["outcome"], run["outcome"], "every run that began has its report");
    }
}
