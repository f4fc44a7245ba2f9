//! Refusals of infeasible jobs for many parts by `upm` as a subprocess.

use std::fs;
use std::path::{Path, PathBuf};

use proptest::prelude::*;
use serde_json::{Value, json};
use tempfile::TempDir;

use super::{root, status, upm};

/// A shipped job with an absolute rig path, altered by `change`, in a new file.
fn changed(folder: &Path, name: &str, change: impl FnOnce(&mut Value)) -> PathBuf {
    let text = fs::read_to_string(root().join("configs").join(format!("{name}.json"))).unwrap();
    let mut job: Value = serde_json::from_str(&text).unwrap();
    job["rig"] = json!(root().join("configs/rigs/upm-2.json"));
    change(&mut job);
    let path = folder.join("job.json");
    fs::write(&path, job.to_string()).unwrap();
    path
}

#[test]
fn contradictory_jobs_are_reported_before_anything_runs() {
    type Change = fn(&mut Value);
    let cases: [(&str, Change, &str, &[&str]); 10] = [
        (
            "arrange-4",
            |job| job["parts"][0]["count"] = json!(3),
            "task.targets_mm",
            &["found 4 targets", "3, one for each"],
        ),
        (
            "arrange-4",
            |job| job["parts"][0]["count"] = json!(5),
            "task.targets_mm",
            &["found 4 targets", "5, one for each"],
        ),
        (
            "arrange-4",
            |job| job["task"]["targets_mm"][2] = json!([50, 69]),
            "task.targets_mm[2]",
            &["19.000 mm from task.targets_mm[1]", "21.050 mm or more"],
        ),
        (
            "arrange-4",
            |job| job["task"]["targets_mm"][0] = json!([-142.5, 0]),
            "task.targets_mm[0][0]",
            &["-142.500", "from -141.875", "1.000 mm inside"],
        ),
        (
            "sort-8",
            |job| job["task"]["bins"][1]["region_mm"]["max"] = json!([90, 0]),
            "task.bins[1].region_mm",
            &["50.000 x 60.000 mm with room for 2 of 24.260 mm", "room for 4"],
        ),
        (
            "sort-8",
            |job| job["task"]["bins"][1]["region_mm"]["min"] = json!([-50, -60]),
            "task.bins[1].region_mm",
            &["[-50.000, -60.000]", "[-40.000, 60.000]", "do not overlap"],
        ),
        (
            "sort-12",
            |job| drop(job["task"]["bins"].as_array_mut().unwrap().pop()),
            "task.bins",
            &["no bin for quarter, 4 of them"],
        ),
        (
            "bowtie-3",
            |job| job["task"]["paths"][1]["waypoints_mm"][0] = json!([3, 4]),
            "task.paths[1].waypoints_mm[0]",
            &["5.000 mm from task.paths[0].waypoints_mm[0]", "21.050 mm or more"],
        ),
        (
            "bowtie-3",
            |job| job["task"]["paths"][2]["speed_mm_s"] = json!(9),
            "task.paths[2].speed_mm_s",
            &["expected 8", "found 9", "in_phase"],
        ),
        (
            "bowtie-3",
            |job| drop(job["task"]["paths"][2]["waypoints_mm"].as_array_mut().unwrap().drain(10..30)),
            "task.paths[2].waypoints_mm",
            &["a lap of ", "within 1 %"],
        ),
    ];
    for (name, change, path, said) in cases {
        let folder = TempDir::new().unwrap();
        let file = changed(folder.path(), name, change);
        let runs = folder.path().join("runs");
        for args in [&["check"][..], &["run", "--out", runs.to_str().unwrap()]] {
            let (stdout, stderr) = status(&[args, &[file.to_str().unwrap()]].concat(), 2);
            assert!(stdout.is_empty(), "{path}: {stdout}");
            assert_eq!(stderr.trim_end().lines().count(), 1, "{path}: {stderr}");
            assert!(stderr.contains(&format!("job.json: {path}: expected ")), "{path}: {stderr}");
            assert!(said.iter().all(|words| stderr.contains(words)), "{path}: {stderr}");
        }
        assert!(!runs.exists(), "{path}: a refused job leaves no run folder");
    }
}

/// JSON pointers of all numbers in a document.
fn numbers(document: &Value, at: &str, out: &mut Vec<String>) {
    match document {
        Value::Number(_) => out.push(at.to_owned()),
        Value::Array(items) => items.iter().enumerate().for_each(|(i, item)| numbers(item, &format!("{at}/{i}"), out)),
        Value::Object(members) => members.iter().for_each(|(key, member)| numbers(member, &format!("{at}/{key}"), out)),
        _ => {}
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    /// A job whose numbers are changed at random is valid or has faults of one line each.
    #[test]
    fn other_numbers_are_taken_or_refused_in_words(
        which in 0..5_usize,
        changes in proptest::collection::vec((any::<prop::sample::Index>(), prop_oneof![-200.0..200.0f64, -3.0..9.0f64, any::<f64>()]), 1..4),
    ) {
        let folder = TempDir::new().unwrap();
        let name = ["arrange-8", "sort-8", "sort-12", "ring-6", "bowtie-3"][which];
        let file = changed(folder.path(), name, |job| {
            let mut all = Vec::new();
            numbers(job, "", &mut all);
            for (index, value) in changes {
                let whole = value.fract() == 0.0 && value.abs() < 1e9;
                *job.pointer_mut(index.get(&all[..]).as_str()).unwrap() = if whole { json!(value as i64) } else { json!(value) };
            }
        });
        let output = upm().args(["check", file.to_str().unwrap()]).output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        prop_assert!(matches!(output.status.code(), Some(0 | 2)), "{stderr}");
        // a warning about a tolerance finer than the rig can hold is not a refusal
        let is_refused = stderr.lines().any(|line| !line.starts_with("upm: warning: "));
        prop_assert_eq!(output.status.code() == Some(2), is_refused, "{}", stderr);
        prop_assert!(stderr.lines().all(|line| line.contains(": expected ") && line.contains(", found ")), "{stderr}");
    }
}
