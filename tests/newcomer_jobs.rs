//! Jobs as newcomers write them: short, without coordinates computed by hand; all of them must complete.
#![allow(clippy::unwrap_used, clippy::panic)] // a test that cannot go on shall say so

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use serde_json::Value;

const MOST_LINES: usize = 12;

fn configs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("configs")
}

/// Length of the longest list of numbers in `value`, and whether a list contains lists, which would be computed
/// coordinates.
fn coordinates(value: &Value) -> (usize, bool) {
    let longer = |(a, b): (usize, bool), (c, d): (usize, bool)| (a.max(c), b || d);
    match value {
        Value::Array(items) => {
            let numbers = items.iter().filter(|item| item.is_number()).count();
            let nested = items.iter().any(Value::is_array);
            items.iter().map(coordinates).fold((numbers, nested), longer)
        }
        Value::Object(members) => members.values().map(coordinates).fold((0, false), longer),
        _ => (0, false),
    }
}

fn is_short_and_completes(name: &str) {
    let file = configs().join(name);
    let text = fs::read_to_string(&file).unwrap();
    assert!(text.lines().count() <= MOST_LINES, "{name}: {} lines", text.lines().count());
    let job: Value = serde_json::from_str(&text).unwrap();
    let (longest, nested) = coordinates(&job);
    assert!(longest <= 2 && !nested, "{name}: nothing longer than a centre or the corner of a region");
    for seed in ["7", "41"] {
        let out = tempfile::tempdir().unwrap();
        let args = ["run", file.to_str().unwrap(), "--seed", seed, "--rerun", "off", "--json", "--quiet", "--out"];
        let output = Command::cargo_bin("upm").unwrap().args(args).arg(out.path()).output().unwrap();
        let report: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(report["outcome"], "completed", "{name}, seed {seed}: {}", report["reason"]);
        assert_eq!(report["verdict"], "true", "{name}, seed {seed}: where the parts truly are");
    }
}

#[test]
fn line_of_ten_coins_completes() {
    is_short_and_completes("line-10.json");
}

#[test]
fn letters_complete() {
    is_short_and_completes("letters-16.json");
}

#[test]
fn two_bins_complete() {
    is_short_and_completes("sort-8.json");
}

#[test]
fn circle_that_turns_completes() {
    is_short_and_completes("circle-turns.json");
}

#[test]
fn lists_of_coordinates_are_noticed() {
    let typed: Value = serde_json::from_str(&fs::read_to_string(configs().join("arrange-2.json")).unwrap()).unwrap();
    assert_eq!(coordinates(&typed), (2, true));
    assert_eq!(coordinates(&serde_json::json!({"a": [1, 2, 3]})), (3, false));
}
