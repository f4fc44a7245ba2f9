//! Every shipped job completes on its rig without a guard firing.
#![allow(clippy::unwrap_used, clippy::panic)] // a test that cannot go on shall say so

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::thread;

use assert_cmd::Command;
use serde_json::{Value, json};

/// All jobs among the shipped configurations.
fn jobs() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs");
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let is_job = |file: &PathBuf| {
        file.extension().is_some_and(|extension| extension == "json")
            && serde_json::from_str::<Value>(&std::fs::read_to_string(file).unwrap()).unwrap()["task"].is_object()
    };
    files.filter(is_job).collect()
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn shipped_jobs_complete_and_no_guard_fires() {
    let waiting = Mutex::new(jobs());
    assert!(waiting.lock().unwrap().len() >= 18, "jobs are where they are looked for");
    let run = || {
        while let Some(file) = { waiting.lock().unwrap().pop() } {
            let out = tempfile::tempdir().unwrap();
            let args = ["run", file.to_str().unwrap(), "--rerun", "off", "--json", "--quiet", "--out"];
            let output = Command::cargo_bin("upm").unwrap().args(args).arg(out.path()).output().unwrap();
            let report: Value = serde_json::from_slice(&output.stdout).unwrap();
            assert_eq!(report["outcome"], "completed", "{}: {}", file.display(), report["reason"]);
            // a hold whose plate is not knocked would complete without any pulse
            assert!(!file.ends_with("hold-4.json") || report["pulses"].as_u64() > Some(20), "{}", report["pulses"]);
            assert!(
                [&Value::Null, &json!([])].contains(&&report["guards"]),
                "{}: {}",
                file.display(),
                report["guards"]
            );
        }
    };
    thread::scope(|scope| {
        let threads = [(); 2].map(|()| scope.spawn(run));
        threads.into_iter().for_each(|thread| thread.join().unwrap());
    });
}
