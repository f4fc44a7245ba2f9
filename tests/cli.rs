//! The command line from the outside: exit status, one line a fault, results on stdout.
#![allow(clippy::unwrap_used, clippy::panic)] // a test that cannot go on shall say so

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use serde_json::{Value, json};
use tempfile::TempDir;

fn upm() -> Command {
    let mut command = Command::cargo_bin("upm").unwrap();
    command.current_dir(root());
    command
}

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// The shipped plus-sign job with its rig's path made absolute, changed, in a file of its own.
fn job(folder: &Path, change: impl FnOnce(&mut Value)) -> PathBuf {
    let text = fs::read_to_string(root().join("configs/plus-sign.json")).unwrap();
    let mut job: Value = serde_json::from_str(&text).unwrap();
    job["rig"] = json!(root().join("configs/rigs/upm-1.json"));
    change(&mut job);
    let path = folder.join("job.json");
    fs::write(&path, job.to_string()).unwrap();
    path
}

/// Runs `upm` with these arguments, expects this exit status, gives back stdout and stderr.
fn status(args: &[&str], expected: i32) -> (String, String) {
    let output = upm().args(args).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    let (stdout, stderr) = (text(output.stdout), text(output.stderr));
    assert_eq!(output.status.code(), Some(expected), "{args:?}\nstdout: {stdout}\nstderr: {stderr}");
    assert!(!stderr.contains("panicked"), "{stderr}");
    (stdout, stderr)
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
                assert!(line.contains(": found ") && line.contains(", allowed: "), "{command} {path}: {line}");
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
fn files_that_are_none_are_refused() {
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
    status(&["locate", &path("no.png", b"not a picture")], 2);
    status(&["locate", "no-such-picture.png"], 2);
    status(&["schema", "nonsense"], 2);
    status(&["verify", folder.path().to_str().unwrap()], 2);
    status(&["frobnicate"], 2);
}

#[test]
fn a_picture_without_a_table_says_so() {
    let folder = TempDir::new().unwrap();
    let picture = folder.path().join("black.png");
    image::GrayImage::new(640, 480).save(&picture).unwrap();
    let (_, stderr) = status(&["locate", picture.to_str().unwrap()], 1);
    assert_eq!(stderr.trim().lines().count(), 1, "{stderr}");
    let dot = folder.path().join("dot.png");
    image::GrayImage::new(1, 1).save(&dot).unwrap();
    status(&["locate", dot.to_str().unwrap()], 1);
}

#[test]
fn a_rendered_frame_is_located_again() {
    let folder = TempDir::new().unwrap();
    let (frame, truth) = (folder.path().join("frame.png"), folder.path().join("truth.json"));
    let (frame, truth) = (frame.to_str().unwrap(), truth.to_str().unwrap());
    status(&["render", "configs/plus-sign.json", "--out", frame, "--truth", truth], 0);
    let (stdout, _) = status(&["locate", frame, "--rig", "configs/rigs/upm-1.json", "--json"], 0);
    let found: Value = serde_json::from_str(&stdout).unwrap();
    let truth: Value = serde_json::from_str(&fs::read_to_string(truth).unwrap()).unwrap();
    assert_eq!(found["parts"].as_array().unwrap().len(), 1);
    let at = |value: &Value, i: usize| value["parts"][0]["position_mm"][i].as_f64().unwrap();
    for axis in 0..2 {
        let error = at(&found, axis) - at(&truth, axis);
        assert!(error.abs() < 0.1, "axis {axis} off by {error} mm");
    }
    assert_eq!(found["parts"][0]["kind"], "penny");
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
fn schemas_and_completions_are_printed() {
    for name in ["job", "rig", "simulate", "library", "trace"] {
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
#[cfg(target_os = "linux")]
fn a_reader_that_goes_away_is_no_panic_and_a_full_disk_is_told() {
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
    for folder in ["configs", "configs/rigs", "assets/libraries"] {
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

#[test]
fn the_experiments_are_listed() {
    let (stdout, _) = status(&["lab"], 0);
    let (json, _) = status(&["lab", "--json"], 0);
    let listed: Value = serde_json::from_str(&json).unwrap();
    let names: Vec<&str> = listed.as_array().unwrap().iter().map(|one| one["experiment"].as_str().unwrap()).collect();
    assert!(names.contains(&"waveform-fit"), "{names:?}");
    assert_eq!(stdout.lines().filter_map(|line| line.split_whitespace().next()).collect::<Vec<_>>(), names);
    let (stdout, stderr) = status(&["lab", "waveform-fir"], 2);
    assert!(stdout.is_empty());
    assert_eq!(stderr, format!("upm: lab: found \"waveform-fir\", allowed: {}\n", names.join(", ")));
}

#[test]
fn an_experiment_leaves_its_files_and_its_figures() {
    let folder = TempDir::new().unwrap();
    let out = folder.path().join("a/b");
    // from a folder without any files of the project
    let run = |args: &[&str]| {
        let mut command = Command::cargo_bin("upm").unwrap();
        let output = command.current_dir(folder.path()).arg("lab").args(args).output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
        assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let json = run(&["waveform-fit", "--json", "--seed", "3", "--out", out.to_str().unwrap()]);
    let result: Value = serde_json::from_str(&json).unwrap();
    let keys = |value: &Value| value.as_object().unwrap().keys().cloned().collect::<Vec<_>>();
    assert_eq!(keys(&result), ["experiment", "figures", "series"]);
    assert_eq!(result["experiment"], "waveform-fit");
    for figure in result["figures"].as_array().unwrap() {
        assert_eq!(keys(figure), ["measured", "name", "reference", "relative_error", "source", "unit"]);
        assert!(figure["measured"].is_f64() && figure["name"].is_string() && figure["unit"].is_string(), "{figure}");
        let compared = figure["reference"].as_f64().is_some_and(|reference| reference != 0.0);
        assert_eq!(figure["relative_error"].is_f64(), compared, "{figure}");
    }
    assert!(result["series"].as_object().unwrap().values().all(|values| values[0].is_number()));
    let files = || fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    assert!(files().any(|name| name.ends_with(".svg")), "{:?}", files().collect::<Vec<_>>());
    let trace = out.join("waveform-fit-trace.json");
    let (says, _) = status(&["check", trace.to_str().unwrap()], 0);
    assert!(says.contains(": ok, trace, 4 channels of "), "{says}");

    let text = run(&["waveform-fit", "--seed", "3"]);
    assert!(text.starts_with("waveform-fit, rig upm-1, seed 3\n  figure "), "{text}");
    assert!(!text.contains('\u{1b}'), "no colours in a file: {text}");
    for path in text.lines().filter_map(|line| line.trim().strip_prefix("written")) {
        assert!(folder.path().join(path.trim()).starts_with(folder.path().join("runs/lab")), "{path}");
        assert!(folder.path().join(path.trim()).is_file(), "{path}");
    }
    assert_eq!(run(&["waveform-fit", "--seed", "3"]), text, "equal seeds give equal figures");
}

/// A trace of a pump wave about (40, -30) mm: `a = w v (sin 2wt - sin wt)` in every channel.
fn trace(folder: &Path, change: impl FnOnce(&mut Value)) -> PathBuf {
    let (place, center, spin) = ([-0.092, 0.092], [0.04, -0.03], 0.15);
    let (base_hz, sample_hz, mps2_per_count) = (60.0, 5000.0, 0.002);
    let w = 2.0 * std::f64::consts::PI * base_hz;
    let channel = |amplitude_mps: f64| {
        let phase = |i: u32| w * f64::from(i) / sample_hz;
        let accel = move |phase: f64| w * amplitude_mps * ((2.0 * phase).sin() - phase.sin());
        (0..700).map(|i| (accel(phase(i)) / mps2_per_count).round() as i64).collect::<Vec<i64>>()
    };
    let velocity = |sign: f64| [-spin * (sign * place[1] - center[1]), spin * (sign * place[0] - center[0])];
    let ([x1, y1], [x2, y2]) = (velocity(1.0).map(channel), velocity(-1.0).map(channel));
    let mut trace = json!({
        "sample_hz": sample_hz, "mps2_per_count": mps2_per_count, "count_limit": 32767, "base_hz": base_hz,
        "attack_s": 0.02, "sustain_s": 0.1, "position_mm": place.map(|m| 1e3 * m),
        "counts": {"x1": x1, "y1": y1, "x2": x2, "y2": y2},
    });
    change(&mut trace);
    let path = folder.join("trace.json");
    fs::write(&path, trace.to_string()).unwrap();
    path
}

#[test]
fn a_recorded_trace_gives_the_centre_it_turned_about() {
    let folder = TempDir::new().unwrap();
    let out = folder.path().join("out");
    for gain in [1.0, 1.25] {
        // a channel that shows too much, and says so
        let file = trace(folder.path(), |trace| {
            let x2 = trace["counts"]["x2"].as_array().unwrap();
            let louder = x2.iter().map(|count| json!((gain * count.as_f64().unwrap()).round() as i64)).collect();
            trace["counts"]["x2"] = louder;
            trace["channel_gain"] = json!([1, 1, gain, 1]);
        });
        let (file, out) = (file.to_str().unwrap(), out.to_str().unwrap());
        let (stdout, _) = status(&["lab", "waveform-fit", "--trace", file, "--out", out, "--json"], 0);
        let result: Value = serde_json::from_str(&stdout).unwrap();
        let cor = |axis: &str| {
            let figures = result["figures"].as_array().unwrap();
            let figure = figures.iter().find(|figure| figure["name"] == format!("COR along {axis}"));
            figure.unwrap()["measured"].as_f64().unwrap()
        };
        assert!((cor("x") - 40.0).abs() < 0.05 && (cor("y") + 30.0).abs() < 0.05, "gain {gain}: {stdout}");
    }
}

#[test]
fn a_spoiled_trace_gives_the_reason_and_no_centre() {
    let folder = TempDir::new().unwrap();
    for (value, reason) in [(json!(null), "channel 1 lacks 1 samples"), (json!(32767), "channel 1 is clipped in 1 ")] {
        let file = trace(folder.path(), |trace| trace["counts"]["y1"][450] = value);
        let file = file.to_str().unwrap();
        status(&["check", file], 0);
        for json in [&[][..], &["--json"]] {
            let (stdout, stderr) = status(&[&["lab", "waveform-fit", "--trace", file], json].concat(), 1);
            assert!(stdout.is_empty(), "{stdout}");
            assert!(stderr.starts_with(&format!("upm: {file}: ")) && stderr.contains(reason), "{stderr}");
            assert_eq!(stderr.lines().count(), 1, "{stderr}");
        }
    }
}

#[test]
fn a_malformed_trace_and_a_misplaced_one_are_refused() {
    let folder = TempDir::new().unwrap();
    type Change = fn(&mut Value);
    let cases: [(&str, Change); 4] = [
        ("counts.y2: found ", |trace| trace["counts"]["y2"] = json!([1, 2, 3])),
        ("counts.x1[7]: found \"a\"", |trace| trace["counts"]["x1"][7] = json!("a")),
        ("sample_hz: found 100", |trace| trace["sample_hz"] = json!(100)),
        ("gains: found unknown key", |trace| trace["gains"] = json!([1, 1, 1, 1])),
    ];
    for (fault, change) in cases {
        let file = trace(folder.path(), change);
        for args in [&["check"][..], &["lab", "waveform-fit", "--trace"]] {
            let (_, stderr) = status(&[args, &[file.to_str().unwrap()]].concat(), 2);
            assert!(stderr.contains(&format!("trace.json: {fault}")) && stderr.contains(", allowed: "), "{stderr}");
            assert_eq!(stderr.lines().count(), 1, "{stderr}");
        }
    }
    let file = trace(folder.path(), |_| {});
    let file = file.to_str().unwrap();
    status(&["lab", "waveform-fit", "--trace", "no-such-trace.json"], 2);
    status(&["lab", "--trace", file], 2);
    status(&["lab", "waveform-fit", "--trace", file, "--rig", "configs/rigs/upm-2.json"], 2);
    status(&["lab", "waveform-fit", "--rig", file], 2);
    status(&["lab", "waveform-fit", "--rerun", "sideways"], 2);
}

#[test]
#[cfg(not(feature = "rerun"))]
fn an_experiment_is_not_recorded_without_rerun() {
    for mode in ["save", "spawn", "connect"] {
        let (stdout, stderr) = status(&["lab", "waveform-fit", "--rerun", mode], 2);
        assert!(stdout.is_empty());
        assert_eq!(stderr, format!("upm: --rerun: found {mode}, allowed: off, as this build has no Rerun\n"));
    }
}

#[test]
#[cfg(feature = "rerun")]
fn an_experiment_is_recorded_when_asked() {
    let folder = TempDir::new().unwrap();
    let out = folder.path().to_str().unwrap();
    let (stdout, _) = status(&["lab", "waveform-fit", "--out", out, "--rerun", "save"], 0);
    let recording = folder.path().join("waveform-fit.rrd");
    assert!(stdout.contains(recording.to_str().unwrap()), "{stdout}");
    assert!(fs::read(recording).unwrap().starts_with(b"RRF2"));
    status(&["lab", "waveform-fit", "--out", out, "--rerun", "connect=nowhere"], 2);
}
