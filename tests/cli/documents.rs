//! Checks sample output and figures in README.md and docs against the output of the program. Commands whose figures
//! depend on the computer (times, speeds) are left out.

use std::fs;

use serde_json::Value;
use tempfile::TempDir;

use super::{root, status};

fn text_of(document: &str) -> String {
    fs::read_to_string(root().join(document)).unwrap()
}

/// Asserts that the document contains each of these passages; reports all that are missing.
fn assert_says(document: &str, passages: &[String]) {
    let text = text_of(document);
    let lacking: Vec<&String> = passages.iter().filter(|passage| !text.contains(passage.as_str())).collect();
    assert!(lacking.is_empty(), "{document} does not say what the program measures:\n{lacking:#?}");
}

/// `line` without the wall times.
fn timeless(line: &str) -> &str {
    line.split_once(", run in ").map_or(line, |(before, _)| before)
}

#[test]
fn readme_sample_equals_the_printed_run() {
    let readme = text_of("README.md");
    let sample = readme.split_once("```text\n").unwrap().1.split_once("```").unwrap().0;
    let out = TempDir::new().unwrap();
    let args = ["run", "configs/plus-sign.json", "--quiet", "--rerun", "off", "--out", out.path().to_str().unwrap()];
    let (stdout, _) = status(&args, 0);
    // the name of the run folder contains the time
    let printed = stdout.lines().filter(|line| !line.trim_start().starts_with("run folder "));
    let (printed, sample): (Vec<&str>, Vec<&str>) =
        (printed.map(timeless).collect(), sample.lines().map(timeless).collect());
    assert_eq!(sample, printed);
}

#[test]
fn run_of_the_strong_rig_has_the_figures_of_the_documents() {
    let out = TempDir::new().unwrap();
    let out = out.path().to_str().unwrap();
    let args = ["run", "configs/plus-sign-upm-2.json", "--quiet", "--json", "--rerun", "off", "--out", out];
    let report: Value = serde_json::from_str(&status(&args, 0).0).unwrap();
    let [track_mm, time_s] = ["cross_track_rms_mm", "plate_time_s"].map(|key| report[key].as_f64().unwrap());
    let row =
        format!("| `upm-2`, plus-sign, one lap | {track_mm:.2} mm rms cross-track in {time_s:.0} s of plate time |");
    assert_says("docs/results.md", &[row]);
}
