//! `upm check --plan` as a subprocess: the forecast of a job, and a full run to compare it with.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use tempfile::TempDir;

use super::{root, shipped, status};

/// Runs `upm check --plan --json` for one job and expects this exit status; returns the job's row.
fn planned(file: &Path, expected: i32) -> Value {
    let (stdout, _) = status(&["check", file.to_str().unwrap(), "--plan", "--json"], expected);
    let rows: Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(rows.as_array().unwrap().len(), 1);
    rows[0].clone()
}

/// Runs a job without pixels; returns its report and stderr.
fn run(file: &Path, out: &Path, expected: i32) -> (Value, String) {
    let args = ["run", file.to_str().unwrap(), "--camera", "positions", "--rerun", "off", "--json", "--out"];
    let (report, stderr) = status(&[&args[..], &[out.to_str().unwrap()]].concat(), expected);
    (serde_json::from_str(&report).unwrap(), stderr)
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value}"))
}

/// A job on `upm-1` with a library that moves coins along x, but along y too slowly for them to slip.
fn hardly_along_y(folder: &Path) -> PathBuf {
    let text = fs::read_to_string(root().join("assets/libraries/upm-1.json")).unwrap();
    let mut library: Value = serde_json::from_str(&text).unwrap();
    let motion =
        |velocity: [f64; 2]| json!({"amplitudes": [-270, 68, 267, -65], "velocity_mm_s": velocity, "spin_rad_s": 0.0});
    library["entries"] = json!([motion([40.0, 0.0]), motion([30.0, 0.0]), motion([0.0, 8.5])]);
    fs::write(folder.join("library.json"), library.to_string()).unwrap();
    shipped(folder, "plus-sign", |job| job["library"] = json!("library.json"))
}

#[test]
fn feasible_job_is_reported_with_its_figures_and_drawn() {
    let folder = TempDir::new().unwrap();
    let file = shipped(folder.path(), "trajectories", |job| {
        (0..2_usize).for_each(|path| job["task"]["paths"][path]["repeat"] = json!(1));
    });
    let (file, picture) = (file.to_str().unwrap(), folder.path().join("plan.svg"));
    let args = ["check", file, "--plan", "--picture", picture.to_str().unwrap()];
    let rows: Value = serde_json::from_str(&status(&[&args[..], &["--json"]].concat(), 0).0).unwrap();
    let row = &rows[0];
    assert_eq!((&row["valid"], &row["plan"]["can_be_done"]), (&json!(true), &json!(true)));
    let plan = &row["plan"];
    let time = |key: &str| number(&plan["predicted_plate_time_s"][key]);
    assert!(0.0 < time("least") && time("least") <= time("median") && time("median") <= time("most"));
    let dry_runs = plan["dry_runs"].as_array().unwrap();
    assert!(dry_runs.len() == 5 && dry_runs.iter().all(|each| each["completed"] == true));
    assert!(number(&plan["smallest_gap"]["gap_mm"]) > 0.0);
    assert_eq!(plan["smallest_gap"]["parts"], json!(["penny-1", "penny-2"]));
    assert_eq!(plan["independence"]["singular_values"].as_array().unwrap().len(), 4);
    assert!((0.01..1.0).contains(&number(&plan["independence"]["share"])), "{plan}");
    let planner = &plan["planner"];
    assert_eq!((&planner["name"], &planner["chosen"]), (&json!("synthesized_field"), &json!("auto")));
    assert_eq!(planner["alternatives"], json!(["moving_field", "cor_sequence", "pseudo_inverse"]));
    for (part, start, end) in [(0, [-110.0, 45.0], [-100.0, -30.0]), (1, [60.0, -50.0], [40.0, -30.0])] {
        let part = &plan["parts"][part];
        assert_eq!(part["start"]["position_mm"], json!(start));
        assert_eq!(part["target"]["position_mm"], json!(end));
        let [first, second] = [0, 1].map(|k| number(&part["start"]["singular_values"][k]));
        assert!(first >= second && second > 0.0, "{part}");
    }

    let drawn = fs::read_to_string(&picture).unwrap();
    let (said, _) = status(&args, 0);
    let [least, median, most] = ["least", "median", "most"].map(time);
    let predicted = format!(" {median:.1} s of plate time ({least:.1} to {most:.1})");
    assert!(said.contains(&predicted), "equal jobs, equal forecasts: {predicted} {said}");
    assert_eq!(fs::read_to_string(&picture).unwrap(), drawn);
    for label in
        ["can be done", "planner ", "predicted ", "smallest gap", "all together", "penny-1  start", "penny-2  target"]
    {
        assert_eq!(said.lines().filter(|line| line.trim_start().starts_with(label)).count(), 1, "{label}: {said}");
    }
    assert!(drawn.starts_with("<svg ") && drawn.trim_end().ends_with("</svg>"));
    for words in ["trajectories on upm-2", "predicted path", "target", "wanted path", "penny-1", "penny-2"] {
        assert!(drawn.contains(words), "{words}");
    }
    fs::remove_file(&picture).unwrap();
    let (_, stderr) = status(&["check", file, "--picture", picture.to_str().unwrap()], 2);
    assert!(stderr.contains("--picture: expected ") && !picture.exists(), "{stderr}");
    let (said, _) = status(&["check", file], 0);
    assert_eq!(said.lines().count(), 1, "only where asked: {said}");
}

#[test]
fn missing_direction_makes_the_job_infeasible_and_ends_its_run_at_the_first_observation() {
    let folder = TempDir::new().unwrap();
    let file = hardly_along_y(folder.path());
    let row = planned(&file, 1);
    let plan = &row["plan"];
    assert_eq!((&row["valid"], &plan["can_be_done"]), (&json!(true), &json!(false)));
    assert_eq!(plan["predicted_plate_time_s"], Value::Null);
    assert!(plan["dry_runs"].as_array().unwrap().iter().all(|each| each["completed"] == false), "{plan}");
    assert_eq!(plan["independence"]["weakest_part"], "penny-1");
    assert_eq!(plan["independence"]["weakest_direction_deg"], 90.0);
    assert_eq!(plan["independence"]["share"], 0.0);
    let start = &plan["parts"][0]["start"];
    assert!(start["direction_deg"] == 90.0 && number(&start["longest_step_mm"]) < 0.01, "{start}");
    assert!(number(&start["singular_values"][0]) > 0.5 && number(&start["singular_values"][1]) < 2e-3, "{start}");
    let picture = folder.path().join("plan.svg").to_str().unwrap().to_owned();
    let (said, _) = status(&["check", file.to_str().unwrap(), "--plan", "--picture", &picture], 1);
    assert!(said.contains("cannot be done") && said.contains("towards 90 deg, 0.000 of the best"), "{said}");
    assert!(fs::read_to_string(picture).unwrap().contains("cannot be done"));
    let reason = plan["dry_runs"][0]["reason"].as_str().unwrap();
    assert!(reason.contains("penny-1 towards 90 deg") && reason.contains("at least 1e-4"), "{reason}");
    let (report, _) = run(&file, folder.path(), 1);
    assert_eq!((&report["outcome"], &report["pulses"]), (&json!("failed"), &json!(0)));
    assert_eq!(report["stop"], json!({"code": "uncontrollable", "text": reason}));
}

#[test]
fn speed_that_can_be_held_is_in_the_plan_and_a_faster_one_is_told_by_the_run() {
    let folder = TempDir::new().unwrap();
    let file = shipped(folder.path(), "plus-sign-upm-2", |job| {
        let path = json!({"circle": {"radius_mm": 25}, "speed_mm_s": 500, "repeat": 2});
        (job["planner"], job["task"]) = (json!("synthesized_field"), json!({"type": "trajectories", "paths": [path]}));
    });
    let forecast = number(&planned(&file, 0)["plan"]["speed_mm_s"]["can_be_held"]);
    let (report, warnings) = run(&file, folder.path(), 0);
    let held = number(&report["speed_held_mm_s"]);
    assert!((held / forecast - 1.0).abs() < 0.1, "{held} {forecast}");
    assert!(warnings.contains("lap 1 took") && report["reason"].as_str().unwrap().contains("% of the speed asked"));
}

#[test]
fn tolerance_finer_than_can_be_held_is_a_warning_and_its_run_ends_soon() {
    let folder = TempDir::new().unwrap();
    let to_within = |tolerance_mm: f64| {
        shipped(folder.path(), "plus-sign-upm-2", |job| {
            job["task"] = json!({"type": "arrange", "targets_mm": [[0, 0]]});
            (job["planner"], job["tolerance_mm"]) = (json!("synthesized_field"), json!(tolerance_mm));
        })
    };
    let (_, warned) = status(&["check", to_within(0.5).to_str().unwrap()], 0);
    assert_eq!(warned, "", "0.5 mm can be held");
    let file = to_within(0.001);
    let path = file.to_str().unwrap();
    let (said, warned) = status(&["check", path], 0);
    assert!(said.contains(": ok, job plus-sign-upm-2"), "{said}");
    assert!(
        warned.contains("warning: ") && warned.contains("tolerance_mm: expected ") && warned.contains("found 0.001 mm"),
        "{warned}"
    );
    assert!(warned.contains("expected 0.29 mm or more with synthesized_field"), "{warned}");
    let (rows, _) = status(&["check", path, "--json"], 0);
    let rows: Value = serde_json::from_str(&rows).unwrap();
    assert_eq!((&rows[0]["valid"], rows[0]["warnings"].as_array().map(Vec::len)), (&json!(true), Some(1)));
    let (report, _) = run(&file, folder.path(), 1);
    assert_eq!(report["stop"]["code"], "no_progress");
    assert!(number(&report["plate_time_s"]) < 60.0, "{report}");
}

#[test]
fn dry_run_is_the_run_without_pixels_which_can_be_verified() {
    let folder = TempDir::new().unwrap();
    let file = shipped(folder.path(), "arrange-2", |job| job["planner"] = json!("cor_sequence"));
    let plan = planned(&file, 0)["plan"].clone();
    assert_eq!((&plan["planner"]["name"], &plan["planner"]["chosen"]), (&json!("cor_sequence"), &json!("job")));
    let dry_run = &plan["dry_runs"][0];
    let out = folder.path().join("runs");
    let (report, _) = run(&file, &out, 0);
    assert_eq!((&report["camera"], &report["pulses"]), (&json!("positions"), &dry_run["pulses"]));
    assert_eq!((&report["plate_time_s"], &report["seed"]), (&dry_run["plate_time_s"], &dry_run["seed"]));
    let args = ["check", file.to_str().unwrap(), "--plan", "--json", "--seeds", "7,9"];
    let rows: Value = serde_json::from_str(&status(&args, 0).0).unwrap();
    let runs = &rows[0]["plan"]["dry_runs"];
    assert_eq!((&runs[0], &runs[1]["seed"], &runs[2]), (dry_run, &json!(9), &Value::Null));
    let out = out.to_str().unwrap();
    let (verified, _) = status(&["verify", "last", "--out", out], 0);
    assert!(verified.contains("byte for byte"), "{verified}");
}
