//! The command line as a subprocess: exit status, one line per fault, results on stdout.
#![allow(clippy::disallowed_methods, clippy::unwrap_used, clippy::panic)] // a test that cannot go on shall say so

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use std::process::Command;
use tempfile::TempDir;

#[path = "cli/campaign.rs"]
mod campaign;
#[path = "cli/closed_loop.rs"]
mod closed_loop;
#[path = "cli/coin_pictures.rs"]
mod coin_pictures;
#[path = "cli/coin_scenes.rs"]
mod coin_scenes;
#[path = "cli/coverage.rs"]
mod coverage;
#[path = "cli/documents.rs"]
mod documents;
#[path = "cli/export.rs"]
mod export;
#[path = "cli/init.rs"]
mod init;
#[path = "cli/locate.rs"]
mod locate;
#[path = "cli/locate_doubts.rs"]
mod locate_doubts;
#[cfg(feature = "daemon")]
#[path = "cli/mistakes.rs"]
mod mistakes;
#[path = "cli/mixed_coins.rs"]
mod mixed_coins;
#[path = "cli/movie.rs"]
mod movie;
#[path = "figures/page.rs"]
#[allow(dead_code)] // cells of a row
mod page;
#[path = "cli/plan.rs"]
mod plan;
#[path = "cli/rigs.rs"]
mod rigs;
#[path = "cli/shapes.rs"]
mod shapes;
#[path = "cli/streams.rs"]
mod streams;

fn upm() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_upm"));
    command.current_dir(root());
    command
}

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// JSON of a file of the project.
fn read(path: &str) -> Value {
    serde_json::from_str(&fs::read_to_string(root().join(path)).unwrap()).unwrap()
}

/// `value` in a new file.
fn file(folder: &Path, name: &str, value: &Value) -> PathBuf {
    let path = folder.join(name);
    fs::write(&path, value.to_string()).unwrap();
    path
}

/// A shipped job with an absolute rig path, altered by `change`, in a new file.
fn shipped(folder: &Path, name: &str, change: impl FnOnce(&mut Value)) -> PathBuf {
    let mut job = read(&format!("configs/{name}.json"));
    job["rig"] = json!(root().join("configs").join(job["rig"].as_str().unwrap()));
    change(&mut job);
    file(folder, "job.json", &job)
}

/// Runs a job; returns its run folder and report.
fn run(job: &Path, out: &Path, more: &[&str], expected: i32) -> (PathBuf, Value) {
    let args = ["run", job.to_str().unwrap(), "--out", out.to_str().unwrap(), "--rerun", "off", "-q", "--json"];
    let (stdout, _) = status(&[&args, more].concat(), expected);
    let run = fs::read_dir(out).unwrap().next().unwrap().unwrap().path();
    (run, serde_json::from_str(&stdout).unwrap())
}

/// Runs `upm`, expects this exit status, returns stdout and stderr.
fn status(args: &[&str], expected: i32) -> (String, String) {
    let output = upm().args(args).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    let (stdout, stderr) = (text(output.stdout), text(output.stderr));
    assert_eq!(output.status.code(), Some(expected), "{args:?}\nstdout: {stdout}\nstderr: {stderr}");
    assert!(!stderr.contains("panicked"), "{stderr}");
    (stdout, stderr)
}

#[test]
#[cfg(unix)]
fn replayed_run_is_shown_by_a_viewer_that_listens_on_the_loopback() {
    use std::os::unix::fs::PermissionsExt;

    let folder = TempDir::new().unwrap();
    let (viewer, seen) = (folder.path().join("rerun"), folder.path().join("seen"));
    fs::write(&viewer, format!("#!/bin/sh\necho \"$@\" > {}\n", seen.display())).unwrap();
    fs::set_permissions(&viewer, fs::Permissions::from_mode(0o755)).unwrap();
    let recording = folder.path().join("run.rrd");
    fs::write(&recording, "RRF2").unwrap();
    assert!(upm().arg("replay").arg(folder.path()).env("PATH", folder.path()).output().unwrap().status.success());
    assert_eq!(fs::read_to_string(seen).unwrap(), format!("--bind 127.0.0.1 {}\n", recording.display()));
}

#[test]
fn simulate_prints_trajectories() {
    let folder = TempDir::new().unwrap();
    let text = json!({
        "rig": root().join("configs/rigs/upm-1.json"),
        "plate": "kinematic",
        "parts": [{"kind": "penny", "position_mm": [50, 0]}],
        "pulses": [{"cor_mm": [0, 0], "rotation": 1, "sustain_s": 0.1, "attack_s": 0.01, "rest_s": 0.05, "omega_rad_s": 8}],
        "sample_hz": 1000,
    });
    let experiment = file(folder.path(), "experiment.json", &text);
    let (stdout, _) = status(&["simulate", experiment.to_str().unwrap(), "--json"], 0);
    let result: Value = serde_json::from_str(&stdout).unwrap();
    let y = result["parts"][0]["y_mm"].as_array().unwrap();
    assert_eq!(y.len(), result["t_s"].as_array().unwrap().len());
    let moved = y.last().unwrap().as_f64().unwrap();
    // ½·0.2386·1.2386·μg·(S + 2A)² = 6.26 mm on a fast belt; at 5 cm and 8 rad/s a penny makes 0.79 of it
    assert!((moved - 0.79 * 6.26).abs() < 0.1 * 4.95, "a counter-clockwise pulse carries the coin up: {moved} mm");
}

#[test]
fn schemas_and_completions_are_printed() {
    let (stdout, _) = status(&["schema", "report"], 0);
    assert!(serde_json::from_str::<Value>(&stdout).unwrap()["properties"].is_object());
    let (stdout, _) = status(&["completions", "bash"], 0);
    assert!(stdout.contains("upm"));
    let (stdout, _) = status(&["--version"], 0);
    assert!(stdout.starts_with("upm "));
}

#[test]
#[cfg(target_os = "linux")]
fn full_disk_on_stdout_is_reported() {
    for args in [&["completions", "bash"][..], &["schema", "job"], &["check", "configs/plus-sign.json"]] {
        let full = fs::File::options().write(true).open("/dev/full").unwrap();
        let child = upm().args(args).stdout(full).stderr(std::process::Stdio::piped()).spawn().unwrap();
        let output = child.wait_with_output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{args:?}: {stderr}");
        assert!(stderr.contains("stdout"), "{args:?}: {stderr}");
    }
}
