//! `upm-lab` as a subprocess.
#![allow(clippy::disallowed_methods, clippy::unwrap_used)] // a test that cannot go on shall say so

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use std::process::Command;
use tempfile::TempDir;

/// Runs `upm-lab` in the repository's folder, expects this exit status, returns stdout and stderr.
fn status(args: &[&str], expected: i32) -> (String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_upm-lab"));
    let output = command.current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).args(args).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    let (stdout, stderr) = (text(output.stdout), text(output.stderr));
    assert_eq!(output.status.code(), Some(expected), "{args:?}\nstdout: {stdout}\nstderr: {stderr}");
    (stdout, stderr)
}

#[test]
fn the_experiments_are_listed() {
    let (stdout, _) = status(&[], 0);
    let (json, _) = status(&["--json"], 0);
    let listed: Value = serde_json::from_str(&json).unwrap();
    let names: Vec<&str> = listed.as_array().unwrap().iter().map(|one| one["experiment"].as_str().unwrap()).collect();
    assert!(names.contains(&"waveform-fit"), "{names:?}");
    let names = [&names[..], &["all"]].concat();
    assert_eq!(stdout.lines().filter_map(|line| line.split_whitespace().next()).collect::<Vec<_>>(), names);
    let (stdout, stderr) = status(&["waveform-fir"], 2);
    assert!(stdout.is_empty());
    assert_eq!(
        stderr,
        format!("upm-lab: expected one of {} (did you mean waveform-fit?), found \"waveform-fir\"\n", names.join(", "))
    );
}

#[test]
fn an_experiment_leaves_its_files_and_its_figures() {
    let folder = TempDir::new().unwrap();
    let out = folder.path().join("a/b");
    // in a folder without files of the project
    let run = |args: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_upm-lab"));
        let output = command.current_dir(folder.path()).args(["-q"]).args(args).output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
        assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let json = run(&["waveform-fit", "--json", "--seed", "3", "--out", out.to_str().unwrap()]);
    let result: Value = serde_json::from_str(&json).unwrap();
    let keys = |value: &Value| value.as_object().unwrap().keys().cloned().collect::<Vec<_>>();
    assert_eq!(keys(&result), ["charts", "experiment", "figures", "notes", "on", "table"]);
    assert_eq!(result["experiment"], "waveform-fit");
    for figure in result["figures"].as_array().unwrap() {
        assert_eq!(keys(figure), ["measured", "name", "reference", "relative_error", "source", "unit"]);
        assert!(figure["measured"].is_f64() && figure["name"].is_string() && figure["unit"].is_string(), "{figure}");
        let compared = figure["reference"].as_f64().is_some_and(|reference| reference != 0.0);
        assert_eq!(figure["relative_error"].is_f64(), compared, "{figure}");
    }
    assert!(result["charts"].as_array().unwrap().iter().all(|chart| chart["layers"][0]["points"][0][0].is_number()));
    let files = || fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    assert!(files().any(|name| name.ends_with(".svg")), "{:?}", files().collect::<Vec<_>>());
    let trace = out.join("waveform-fit-trace.json");
    status(&["waveform-fit", "--trace", trace.to_str().unwrap(), "--out", out.to_str().unwrap()], 0);

    let text = run(&["cor-steering", "--seed", "3"]);
    assert!(text.starts_with("cor-steering, rig upm-1, seed 3\n  figure "), "{text}");
    assert!(!text.contains('\u{1b}'), "no colours in a file: {text}");
    for path in text.lines().filter_map(|line| line.trim().strip_prefix("written")) {
        assert!(folder.path().join(path.trim()).starts_with(folder.path().join("runs/lab")), "{path}");
        assert!(folder.path().join(path.trim()).is_file(), "{path}");
    }
    assert_eq!(run(&["cor-steering", "--seed", "3"]), text, "equal seeds give equal figures");
    assert_ne!(run(&["cor-steering", "--seed", "4"]).replace("seed 4", "seed 3"), text, "and others, others");
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
        // a channel whose gain is too high, and is declared so
        let file = trace(folder.path(), |trace| {
            let x2 = trace["counts"]["x2"].as_array().unwrap();
            let louder = x2.iter().map(|count| json!((gain * count.as_f64().unwrap()).round() as i64)).collect();
            trace["counts"]["x2"] = louder;
            trace["channel_gain"] = json!([1, 1, gain, 1]);
        });
        let (file, out) = (file.to_str().unwrap(), out.to_str().unwrap());
        let (stdout, _) = status(&["waveform-fit", "--trace", file, "--out", out, "--json"], 0);
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
    for (value, reason) in [
        (json!(null), "counts.y1: expected no missing sample among those read, found 1"),
        (json!(32767), "counts.y1: expected no clipped sample among those read, found 1 at 32767"),
    ] {
        let file = trace(folder.path(), |trace| trace["counts"]["y1"][450] = value);
        let file = file.to_str().unwrap();
        for json in [&[][..], &["--json"]] {
            let (stdout, stderr) = status(&[&["waveform-fit", "--trace", file], json].concat(), 1);
            assert!(stdout.is_empty(), "{stdout}");
            assert!(stderr.starts_with(&format!("upm-lab: {file}: ")) && stderr.contains(reason), "{stderr}");
            assert_eq!(stderr.lines().count(), 1, "{stderr}");
        }
    }
}

#[test]
fn a_malformed_trace_and_a_misplaced_one_are_refused() {
    let folder = TempDir::new().unwrap();
    type Change = fn(&mut Value);
    let cases: [(&str, Change); 4] = [
        ("counts.y2: expected ", |trace| trace["counts"]["y2"] = json!([1, 2, 3])),
        ("counts.x1[7]: expected ", |trace| trace["counts"]["x1"][7] = json!("a")),
        ("sample_hz: expected ", |trace| trace["sample_hz"] = json!(100)),
        ("gains: expected one of ", |trace| trace["gains"] = json!([1, 1, 1, 1])),
    ];
    for (fault, change) in cases {
        let file = trace(folder.path(), change);
        let (_, stderr) = status(&["waveform-fit", "--trace", file.to_str().unwrap()], 2);
        assert!(stderr.contains(&format!("trace.json: {fault}")) && stderr.contains(", found "), "{stderr}");
        assert_eq!(stderr.lines().count(), 1, "{stderr}");
    }
    let file = trace(folder.path(), |_| {});
    let file = file.to_str().unwrap();
    status(&["waveform-fit", "--trace", "no-such-trace.json"], 2);
    status(&["--trace", file], 2);
    status(&["waveform-fit", "--trace", file, "--rig", "configs/rigs/upm-2.json"], 2);
    status(&["waveform-fit", "--rig", file], 2);
}

#[test]
fn drawn_scene_is_located_by_the_reference_with_its_rig_file() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (picture, truth, rig) = (path("f.png"), path("t.json"), path("r.json"));
    status(&["scene", "clean", "--seed", "3", "--out", &picture, "--truth", &truth, "--rig-out", &rig], 0);
    let truth: Value = serde_json::from_str(&fs::read_to_string(truth).unwrap()).unwrap();
    let found: Value = serde_json::from_str(&status(&["locate", &picture, "--rig", &rig, "--json"], 0).0).unwrap();
    let distance = |a: &Value, b: &Value| {
        (a[0].as_f64().unwrap() - b[0].as_f64().unwrap()).hypot(a[1].as_f64().unwrap() - b[1].as_f64().unwrap())
    };
    for i in 0..4 {
        assert!(distance(&found["table"]["corners_px"][i], &truth["table"]["corners_px"][i]) < 1.0, "{found}");
    }
    let (found, truth) = (found["parts"].as_array().unwrap(), truth["parts"].as_array().unwrap());
    assert_eq!(found.len(), truth.len());
    for part in truth {
        let near = |one: &&Value| {
            one["kind"] == part["kind"]
                && distance(&one["center_px"], &part["center_px"]) < 1.0
                && distance(&one["position_mm"], &part["position_mm"]) < 0.5
        };
        assert!(found.iter().any(|one| near(&one)), "{part}");
    }
    let (text, _) = status(&["locate", &picture, "--rig", &rig, "--kinds", "penny"], 0);
    assert!(text.starts_with("corner (") && text.contains("\npenny "), "{text}");
    let (_, stderr) = status(&["scene", "dirty", "--out", &picture], 2);
    assert_eq!(stderr, "upm-lab: expected one of clean, rough, hard, papers, found \"dirty\"\n");
    let (_, stderr) = status(&["locate", &picture, "--kinds", "peny"], 2);
    assert!(stderr.contains("(did you mean penny?), found \"peny\""), "{stderr}");
    status(&["locate", &rig], 2);
}

#[test]
fn shipped_trace_gives_the_centre_of_the_lab_pulse() {
    let result = lab(&["waveform-fit", "--trace", "configs/traces/upm-1.json"]);
    let [x_mm, y_mm] = ["COR along x", "COR along y"].map(|name| measured(&result, name));
    // the lab's pulse has its centre at about (136.8, 68.1) mm
    assert!((x_mm - 136.8).abs() < 0.5 && (y_mm - 68.1).abs() < 0.5, "{x_mm} {y_mm}");
}

/// Runs `upm-lab` in a new folder; returns its JSON.
fn lab(args: &[&str]) -> Value {
    let folder = TempDir::new().unwrap();
    let out = folder.path().to_str().unwrap();
    let (stdout, _) = status(&[args, &["--json", "--out", out]].concat(), 0);
    serde_json::from_str(&stdout).unwrap()
}

fn measured(result: &Value, figure: &str) -> f64 {
    let figures = result["figures"].as_array().unwrap();
    figures.iter().find(|one| one["name"] == figure).unwrap()["measured"].as_f64().unwrap()
}

#[test]
fn machine_is_measured_as_it_is_set() {
    let result = lab(&["feeder", "--set", "duty=0.55", "--set", "accel_mps2=200"]);
    let closed_form_mm_s = 0.25 * 200e3 * 0.02 * (2.0 * 0.55 - 1.0);
    assert!((measured(&result, "feed rate") / closed_form_mm_s - 1.0).abs() < 1e-4, "{result}");
    let (listed, _) = status(&["feeder", "--settings"], 0);
    assert!(listed.contains("period_ms") && listed.contains("(0.5 to 1); usually 0.586"), "{listed}");
    let json: Value = serde_json::from_str(&status(&["feeder", "--settings", "--json"], 0).0).unwrap();
    assert_eq!(json[1]["key"], "period_ms");
    assert_eq!((json[1]["usual"].as_f64(), json[1]["range"][0].as_f64()), (Some(20.0), Some(0.001)));
}

#[test]
fn sweep_has_a_row_a_point_and_a_plot_a_figure() {
    let folder = TempDir::new().unwrap();
    let out = folder.path().join("out");
    let args = ["feeder", "--sweep", "duty=0.5:1:6", "--out", out.to_str().unwrap()];
    let (text, _) = status(&args, 0);
    assert!(text.starts_with("feeder, seed 1, duty=0.5:1:6\n"), "{text}");
    let numbers = text.lines().filter(|line| line.trim_start().starts_with(|c: char| c.is_ascii_digit()));
    assert_eq!(numbers.count(), 6, "{text}");
    let result = lab(&["feeder", "--sweep", "duty=0.5:1:6"]);
    let plots = result["charts"].as_array().unwrap().len();
    assert!(plots > 2 && fs::read_dir(&out).unwrap().count() == plots, "{plots} plots");
    assert_eq!(result["table"]["rows"].as_array().unwrap().len(), 6);
    let again = lab(&["feeder", "--sweep", "duty=0.5:1:6"]);
    assert_eq!(result, again, "whatever the number of cores");
}

#[test]
fn settings_that_are_not_allowed_are_refused_in_one_line() {
    for (args, fault) in [
        (&["feeder", "--set", "duty=0.4"][..], "feeder: duty: expected 0.5 to 1, found 0.4"),
        (&["feeder", "--set", "duty"], "--set: expected KEY=NUMBER, found \"duty\""),
        (&["feeder", "--set", "speed=1"], "feeder: expected one of accel_mps2, "),
        (&["feeder", "--set", "accel_mps2=5"], "feeder: accel_mps2: expected more than 9.807 "),
        (&["feeder", "--sweep", "duty=0:1"], "--sweep: expected KEY=FROM:TO:POINTS with 2 to 10000 points, found "),
        (&["feeder", "--sweep", "speed=0:1:3"], "feeder: expected one of accel_mps2, "),
        (&["all", "--set", "friction=1"], "--set: expected the name of one experiment, found \"all\""),
        (&["feeder", "--set", "force_dyn=99"], "feeder: force_dyn: expected less than 98.066 "),
        (&["mchip", "--set", "starts=2.5"], "mchip: starts: expected a whole number from "),
        (&["mchip", "--set", "ridge_height_um=2", "--set", "rim_um=1.5"], "mchip: rim_um: expected at most 1.000 "),
        (&["rock", "--set", "from=0.1"], "rock: from, to: expected tilts between which"),
        (&["rock", "--set", "from=0.5", "--set", "to=-0.4"], "rock: from, to: expected tilts between which"),
        (&["rock", "--set", "peak_rad=0.5"], "rock: peak_rad: expected less than 0.4636 "),
        (&["rock", "--set", "start=3"], "rock: start: expected less than 2.8978 "),
        (&["topple", "--set", "ledge_mm=7"], "topple: ledge_mm: expected less than 6.35 "),
        (&["vision", "--set", "friction=1"], "vision: this experiment has no settings, found \"friction\""),
    ] {
        let (stdout, stderr) = status(args, 2);
        assert!(stdout.is_empty() && stderr.starts_with(&format!("upm-lab: {fault}")), "{stderr}");
        assert_eq!(stderr.lines().count(), 1, "{stderr}");
    }
}
