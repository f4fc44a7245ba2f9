//! Wrong commands and wrong files: each is answered on one line with a remedy, as recorded in
//! `tests/golden/mistakes.txt`.

use std::fs;
use std::path::Path;

use serde_json::{Value, json};
use tempfile::TempDir;

use super::{root, upm};

/// Wrong command lines, run in a folder that `upm init` made.
const COMMANDS: [&str; 34] = [
    "rnu configs/plus-sign.json",
    "lab mchip",
    "configs/plus-sign.json",
    "run plus-sign.json",
    "run configs/plus_sign.json",
    "run configs/plus-sign.json --sed 3",
    "run configs/plus-sign.json --seed three",
    "run configs/plus-sign.json --pace fast",
    "run configs/plus-sign.json --rerun sometimes",
    "run configs/plus-sign.json --faults coil9:dead",
    "run configs/plus-sign.json --faults camera:frozen",
    "run configs/plus-sign.json configs/hold-4.json",
    "run configs",
    "run configs/plus-sign.json -v -q",
    "run configs/plus-sign.json --movie movie.png",
    "run configs/plus-sign.json --movie movie.gif --camera positions",
    "run configs/plus-sign.json --movie movie.gif --seeds 1..2",
    "calibrate --rig configs/rigs/upm-1.json",
    "calibrate --rig configs/plus-sign.json --out library.json",
    "check",
    "check configs/plus-sign.json --rig configs/rigs/upm-3.json",
    "check configs/rigs/upm-1.json --plan",
    "check configs/plus-sign.json --seeds 1..5",
    "check configs/plus-sign.json --plan --seeds 1..200",
    "schema jbo",
    "locate picture.png",
    "locate configs/plus-sign.json",
    "render configs/plus-sign.json --out frame.bmp",
    "simulate configs/plus-sign.json",
    "verify configs",
    "serve --config configs/deamon.json",
    "serve --listen localhost",
    "plates --url http://127.0.0.1:9",
    "export configs --csv",
];

/// Wrong values: a shipped file, the JSON pointer of a value in it, and the value to be put there.
fn wrong_values() -> Vec<(&'static str, &'static str, Value)> {
    let (plus, rig) = ("plus-sign.json", "rigs/upm-1.json");
    vec![
        (plus, "/seed", json!("seven")),
        (plus, "/tolerance_mm", json!(0)),
        (plus, "/tolerence_mm", json!(0.5)),
        (plus, "/rig", json!("rigs/upm-3.json")),
        (plus, "/rig", json!("daemon.json")),
        (plus, "/parts/0/kind", json!("peny")),
        (plus, "/parts/0/count", json!(2)),
        (plus, "/parts/0/position_mm", json!([95, 0])),
        (plus, "/planner", json!("synthesised_field")),
        (plus, "/planner", json!("synthesized_field")),
        (plus, "/limits/plate_time_s", json!(-5)),
        (plus, "/name", json!("my job")),
        (plus, "/task/type", json!("plus-sign")),
        (plus, "/library", json!("none.json")),
        (plus, "/library", json!("../assets/libraries/upm-2.json")),
        ("arrange-4.json", "/task/targets_mm/0", json!([200, 0])),
        ("arrange-4.json", "/parts/0/count", json!(3)),
        ("arrange-4.json", "/parts/0/count", json!(5)),
        ("arrange-4.json", "/task/targets_mm/0", json!([-142.5, 0])),
        ("arrange-4.json", "/task/targets_mm/2", json!([50, 69])),
        ("sort-8.json", "/task/bins/1/region_mm/max", json!([90, 0])),
        ("sort-8.json", "/task/bins/1/region_mm/min", json!([-50, -60])),
        ("sort-8.json", "/task/bins/1/kinds", json!(["dime"])),
        ("bowtie-3.json", "/task/paths/1/waypoints_mm/0", json!([3, 4])),
        ("bowtie-3.json", "/task/paths/2/speed_mm_s", json!(9)),
        ("hold-4.json", "/task/duration_s", json!("long")),
        (rig, "/motors/newtons_per_count", json!(0.0001)),
        (rig, "/motors/low_pass_hz", json!(100)),
        (rig, "/plate/resonance_hz/x", json!(80)),
        (rig, "/plate/mass_kg", json!(0.4)),
        (rig, "/kinds", json!({"tray": {"diameter_mm": 300, "mass_g": 50, "thickness_mm": 2}})),
        (rig, "/camera/position_mm/2", json!(600)),
        (rig, "/camera/tilt_deg/1", json!(40)),
        (rig, "/camera/levels/part", json!(220)),
        (rig, "/library", json!("../../assets/libraries/upm-3.json")),
        (rig, "/drive", Value::Null),
        ("daemon.json", "/listen", json!("localhost:8750")),
        ("daemon.json", "/default_plate", json!("upm-3")),
        ("daemon.json", "/plates/0/standing_job/job", json!("plus-sign-endles.json")),
        ("simulate/rotation.json", "/pulses/0/rotation", json!(2)),
        ("simulate/rotation.json", "/pulses/0/omega_rad_s", json!(400)),
        ("simulate/rotation.json", "/parts/1/position_mm", json!([60, 5])),
        ("traces/upm-1.json", "/counts/x2", json!([1, 2])),
        ("traces/upm-1.json", "/sample_hz", json!(400)),
    ]
}

/// Files that hold no document.
const TEXTS: [(&str, &[u8]); 8] = [
    ("an empty file", b""),
    ("a file that is cut off", b"{\n  \"name\": \"a\",\n  \"seed\": "),
    ("a missing comma", b"{\n  \"name\": \"a\"\n  \"seed\": 3\n}"),
    ("a byte that is not UTF-8", b"{\"name\": \"\xff\"}"),
    ("plain text", b"hello"),
    ("a list", b"[]"),
    ("two documents", b"{} {}"),
    ("lists in lists", &[b'['; 100_000]),
];

/// Message on stderr of a command that must be refused and print nothing else.
fn refusal(folder: &Path, args: &[&str]) -> String {
    let output = upm().args(args).current_dir(folder).env("COLUMNS", "80").output().unwrap();
    let (stdout, stderr) = (String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap());
    assert!(matches!(output.status.code(), Some(1 | 2)) && stdout.is_empty(), "{args:?}: {stdout}{stderr}");
    assert!(!stderr.contains("os error") && !stderr.contains("panicked"), "{args:?}: {stderr}");
    stderr
}

/// Replaces one value in the shipped file `name` below `folder` while `ask` runs.
fn with_value(folder: &Path, name: &str, pointer: &str, value: &Value, ask: impl FnOnce(&str) -> String) -> String {
    let path = folder.join("configs").join(name);
    let text = fs::read_to_string(&path).unwrap();
    let mut document: Value = serde_json::from_str(&text).unwrap();
    let (parent, key) = pointer.rsplit_once('/').unwrap();
    match document.pointer_mut(parent).unwrap() {
        Value::Array(items) => items[key.parse::<usize>().unwrap()] = value.clone(),
        object => drop(object.as_object_mut().unwrap().insert(key.to_owned(), value.clone())),
    }
    fs::write(&path, document.to_string()).unwrap();
    let answer = ask(&format!("configs/{name}"));
    fs::write(&path, text).unwrap();
    answer
}

/// `UPM_REMAKE_GOLDEN=1` writes the file anew.
#[test]
fn each_mistake_is_answered_in_one_line_with_a_remedy() {
    let folder = TempDir::new().unwrap();
    assert!(upm().args(["init", "."]).current_dir(folder.path()).output().unwrap().status.success());
    let mut text = String::new();
    for command in COMMANDS {
        let args: Vec<&str> = command.split(' ').collect();
        text += &format!("$ upm {command}\n{}\n", refusal(folder.path(), &args));
    }
    for (name, pointer, value) in wrong_values() {
        let line = with_value(folder.path(), name, pointer, &value, |file| {
            let line = refusal(folder.path(), &["check", file]);
            // a run says the same before it makes its folder
            let is_job = !name.contains('/') && name != "daemon.json";
            assert!(!is_job || refusal(folder.path(), &["run", file]) == line, "{name} {pointer}: {line}");
            line
        });
        text += &format!("{name} {pointer} = {value}\n{line}\n");
    }
    for (what, bytes) in TEXTS {
        fs::write(folder.path().join("wrong.json"), bytes).unwrap();
        text += &format!("wrong.json: {what}\n{}\n", refusal(folder.path(), &["check", "wrong.json"]));
    }
    assert!(!folder.path().join("runs").exists());
    let golden = root().join("tests/golden/mistakes.txt");
    if std::env::var_os("UPM_REMAKE_GOLDEN").is_some() {
        fs::write(&golden, &text).unwrap();
    }
    for answer in text.trim_end().split("\n\n") {
        let lines: Vec<&str> = answer.lines().collect();
        assert!(lines.len() == 2 && lines[1].starts_with("upm: "), "one line of answer: {answer}");
        let has_remedy = ["expected ", "did you mean", "`"].iter().any(|remedy| lines[1].contains(remedy));
        assert!(has_remedy, "nothing to do about it: {answer}");
    }
    assert_eq!(text, fs::read_to_string(&golden).unwrap());
}
