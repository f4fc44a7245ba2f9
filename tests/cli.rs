//! The command line as a subprocess: exit status, one line per fault, results on stdout.
#![allow(clippy::unwrap_used, clippy::panic)] // a test that cannot go on shall say so

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use serde_json::{Value, json};
use tempfile::TempDir;

#[path = "cli/batch.rs"]
mod batch;
#[path = "cli/coin_pictures.rs"]
mod coin_pictures;
#[path = "cli/coin_scenes.rs"]
mod coin_scenes;
#[path = "cli/coverage.rs"]
mod coverage;
#[path = "cli/documents.rs"]
mod documents;
#[path = "cli/documents_runs.rs"]
mod documents_runs;
#[path = "cli/documents_series.rs"]
mod documents_series;
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
#[path = "figures/page.rs"]
mod page;
#[path = "cli/plan.rs"]
mod plan;
#[path = "cli/refusals.rs"]
mod refusals;
#[path = "cli/rigs.rs"]
mod rigs;
#[path = "cli/shapes.rs"]
mod shapes;
#[path = "cli/streams.rs"]
mod streams;

fn upm() -> Command {
    let mut command = Command::cargo_bin("upm").unwrap();
    command.current_dir(root());
    command
}

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// The shipped plus-sign job with an absolute rig path, altered by `change`, in a new file.
fn job(folder: &Path, change: impl FnOnce(&mut Value)) -> PathBuf {
    let text = fs::read_to_string(root().join("configs/plus-sign.json")).unwrap();
    let mut job: Value = serde_json::from_str(&text).unwrap();
    job["rig"] = json!(root().join("configs/rigs/upm-1.json"));
    change(&mut job);
    let path = folder.join("job.json");
    fs::write(&path, job.to_string()).unwrap();
    path
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
    upm().arg("replay").arg(folder.path()).env("PATH", folder.path()).assert().success();
    assert_eq!(fs::read_to_string(seen).unwrap(), format!("--bind 127.0.0.1 {}\n", recording.display()));
}

#[test]
fn every_bad_job_is_refused_in_one_line_with_its_path() {
    type Change = fn(&mut Value);
    let cases: [(&str, Change); 10] = [
        ("$.colour", |job| job["colour"] = json!("red")),
        ("$.seed", |job| job["seed"] = json!("seven")),
        ("$.parts[0].kind", |job| job["parts"][0]["kind"] = json!("pennyy")),
        ("$.parts[0].count", |job| job["parts"][0]["count"] = json!(500)),
        ("$.parts[0].position_mm", |job| job["parts"][0]["position_mm"] = json!([500, 0])),
        ("$.task", |job| job["task"] = json!({"type": "dance"})),
        ("$.task.edge_margin_mm", |job| job["task"]["edge_margin_mm"] = json!(-1)),
        ("$.tolerance_mm", |job| job["tolerance_mm"] = json!(0)),
        ("$.limits.plate_time_s", |job| job["limits"]["plate_time_s"] = json!(-5)),
        ("$.rig", |job| job["rig"] = json!("no/such/rig.json")),
    ];
    for (path, change) in cases {
        let folder = TempDir::new().unwrap();
        let file = job(folder.path(), change);
        for command in ["run", "check"] {
            let (stdout, stderr) = status(&[command, file.to_str().unwrap()], 2);
            assert!(stdout.is_empty(), "{path}: {stdout}");
            let fault = format!("job.json: {}", path.trim_start_matches("$."));
            let lines: Vec<&str> = stderr.lines().collect();
            assert!(lines.iter().any(|line| line.contains(&fault)), "{command} {path}: {stderr}");
            for line in lines {
                let is_told = line.contains(": expected ") && line.contains(", found ");
                assert!(is_told || line.contains(": cannot read "), "{command} {path}: {line}");
            }
        }
        assert!(!folder.path().join("runs").exists(), "{path}: a refused job leaves no run folder");
    }
}

#[test]
fn an_unknown_key_is_answered_with_the_likely_one() {
    let folder = TempDir::new().unwrap();
    let file = job(folder.path(), |job| job["tolerence_mm"] = json!(1));
    let (_, stderr) = status(&["check", file.to_str().unwrap()], 2);
    assert!(stderr.contains("tolerance_mm"), "{stderr}");
}

#[test]
fn unreadable_and_invalid_inputs_are_refused() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        path.to_str().unwrap().to_owned()
    };
    status(&["run", "no-such-job.json"], 2);
    status(&["run", &path("empty.json", b"")], 2);
    status(&["run", &path("half.json", b"{\"name\": \"x\"")], 2);
    status(&["run", &path("latin.json", b"{\"name\": \"\xe9\"}")], 2);
    status(&["check", &path("deep.json", "[".repeat(100_000).as_bytes())], 2);
    status(&["schema", "nonsense"], 2);
    status(&["verify", folder.path().to_str().unwrap()], 2);
    status(&["frobnicate"], 2);
}

#[test]
fn simulate_prints_trajectories() {
    let folder = TempDir::new().unwrap();
    let experiment = folder.path().join("experiment.json");
    let text = json!({
        "rig": root().join("configs/rigs/upm-1.json"),
        "plate": "kinematic",
        "parts": [{"kind": "penny", "position_mm": [50, 0]}],
        "pulses": [{"cor_mm": [0, 0], "rotation": 1, "sustain_s": 0.1, "attack_s": 0.01, "rest_s": 0.05, "omega_rad_s": 8}],
        "sample_hz": 1000,
    });
    fs::write(&experiment, text.to_string()).unwrap();
    let (stdout, _) = status(&["simulate", experiment.to_str().unwrap(), "--json"], 0);
    let result: Value = serde_json::from_str(&stdout).unwrap();
    let y = result["parts"][0]["y_mm"].as_array().unwrap();
    assert_eq!(y.len(), result["t_s"].as_array().unwrap().len());
    let moved = y.last().unwrap().as_f64().unwrap();
    // ½·0.2386·1.2386·μg·(S + 2A)² = 6.26 mm on a fast belt; at 5 cm and 8 rad/s a penny makes 0.79 of it
    assert!((moved - 0.79 * 6.26).abs() < 0.1 * 4.95, "a counter-clockwise pulse carries the coin up: {moved} mm");
}

#[test]
fn rotation_moves_parts_like_its_free_wave() {
    let folder = TempDir::new().unwrap();
    let mut outputs = Vec::new();
    let rotation = json!({"cor_mm": [0, 0], "omega_rad_s": 8, "sustain_s": 0.1});
    let wave = json!({"harmonics": [{"cos": [0, 0, 8]}, {"cos": [0, 0, -4]}], "sustain_s": 0.1});
    for (plate, pulse) in [("kinematic", &rotation), ("kinematic", &wave), ("dynamic", &rotation), ("dynamic", &wave)] {
        let experiment = folder.path().join("experiment.json");
        let rig = root().join("configs/rigs/upm-2.json");
        let text = json!({
            "rig": rig, "plate": plate, "parts": [{"kind": "dime", "position_mm": [50, 10]}], "pulses": [pulse],
        });
        fs::write(&experiment, text.to_string()).unwrap();
        outputs.push(status(&["simulate", experiment.to_str().unwrap(), "--json"], 0).0);
    }
    assert!(outputs[0] == outputs[1] && outputs[2] == outputs[3] && outputs[0] != outputs[2]);
}

#[test]
fn tasks_without_end_are_done_at_their_plate_time_limit() {
    let folder = TempDir::new().unwrap();
    let circuit = json!({"waypoints_mm": [[0, 0], [20, 0], [0, 20]], "speed_mm_s": 10, "repeat": 0});
    for task in [json!({"type": "trajectories", "paths": [circuit]}), json!({"type": "hold"})] {
        let file = job(folder.path(), |job| {
            job["task"] = task.clone();
            job["limits"]["plate_time_s"] = json!(2);
        });
        let out = folder.path().join("out");
        let args = ["run", file.to_str().unwrap(), "--out", out.to_str().unwrap(), "--rerun", "off", "--json"];
        let report: Value = serde_json::from_str(&status(&args, 0).0).unwrap();
        assert_eq!((&report["outcome"], &report["laps"]), (&json!("completed"), &json!(0)), "{report}");
        fs::remove_dir_all(&out).unwrap();
    }
}

#[test]
fn schemas_and_completions_are_printed() {
    for name in ["job", "rig", "simulate", "library", "trace", "daemon", "report"] {
        let (stdout, _) = status(&["schema", name], 0);
        let schema: Value = serde_json::from_str(&stdout).unwrap();
        assert!(schema["properties"].is_object(), "{name}");
    }
    let (stdout, _) = status(&["completions", "bash"], 0);
    assert!(stdout.contains("upm"));
    let (stdout, _) = status(&["--version"], 0);
    assert!(stdout.starts_with("upm "));
}

#[test]
fn shells_offer_the_names_that_commands_take() {
    let names = ["journal", "daemon", "save", "spawn", "real-time"];
    for shell in ["bash", "zsh", "fish"] {
        let (script, _) = status(&["completions", shell], 0);
        let words: std::collections::BTreeSet<&str> =
            script.split(|c: char| !(c.is_alphanumeric() || c == '-')).collect();
        for name in names {
            assert!(words.contains(name), "{shell}: {name}");
        }
    }
    // completions do not list all valid values, and the command itself refuses a wrong name in its message
    for args in [&["schema", "jobs"][..], &["run", "configs/arrange-2.json", "--rerun", "saved"]] {
        let (_, stderr) = status(args, 2);
        assert!(stderr.lines().count() == 1 && stderr.starts_with("upm: "), "{stderr}");
    }
}

#[test]
fn lab_is_named_as_a_program_of_its_own() {
    let (_, stderr) = status(&["lab", "feeder", "--set", "duty=0.55", "--json"], 2);
    let line = "upm: the lab is a program of its own: cargo run -p upm-lab -- feeder --set duty=0.55 --json\n";
    assert_eq!(stderr, line);
}

#[test]
#[cfg(target_os = "linux")]
fn full_disk_on_stdout_is_reported() {
    for args in [&["completions", "bash"][..], &["schema", "job"], &["check", "configs/plus-sign.json"]] {
        let full = fs::File::options().write(true).open("/dev/full").unwrap();
        let child = std::process::Command::new(env!("CARGO_BIN_EXE_upm"))
            .args(args)
            .current_dir(root())
            .stdout(full)
            .stderr(std::process::Stdio::piped())
            .spawn()
            .unwrap();
        let output = child.wait_with_output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{args:?}: {stderr}");
        assert!(stderr.contains("stdout"), "{args:?}: {stderr}");
    }
}

#[test]
fn the_shipped_files_are_valid() {
    let mut files: Vec<String> = Vec::new();
    for folder in ["configs", "configs/rigs", "configs/simulate", "configs/traces", "assets/libraries"] {
        for entry in fs::read_dir(root().join(folder)).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|extension| extension == "json") {
                files.push(path.to_str().unwrap().to_owned());
            }
        }
    }
    assert!(files.len() >= 6, "{files:?}");
    let args: Vec<&str> = std::iter::once("check").chain(files.iter().map(String::as_str)).collect();
    status(&args, 0);
}
