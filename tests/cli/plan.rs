//! `upm check --plan` as a subprocess: the forecast of a job, and a full run to compare it with.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use tempfile::TempDir;

use super::{job, root, status};

/// Runs `upm check --plan --json` for one job and expects this exit status; returns the job's row.
fn planned(file: &Path, expected: i32) -> Value {
    let (stdout, _) = status(&["check", file.to_str().unwrap(), "--plan", "--json"], expected);
    let rows: Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(rows.as_array().unwrap().len(), 1);
    rows[0].clone()
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
    job(folder, |job| job["library"] = json!("library.json"))
}

#[test]
fn feasible_job_is_reported_with_its_figures() {
    let file = root().join("configs/trajectories.json");
    let row = planned(&file, 0);
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
    for (part, start, end) in [(0, [-110.0, 45.0], [-100.0, -30.0]), (1, [60.0, -50.0], [40.0, -30.0])] {
        let part = &plan["parts"][part];
        assert_eq!(part["start"]["position_mm"], json!(start));
        assert_eq!(part["target"]["position_mm"], json!(end));
        let [first, second] = [0, 1].map(|k| number(&part["start"]["singular_values"][k]));
        assert!(first >= second && second > 0.0, "{part}");
    }
    assert_eq!(planned(&file, 0), row, "equal jobs, equal forecasts");

    let (said, _) = status(&["check", file.to_str().unwrap(), "--plan"], 0);
    for label in
        ["can be done", "planner ", "predicted ", "smallest gap", "all together", "penny-1  start", "penny-2  target"]
    {
        assert_eq!(said.lines().filter(|line| line.trim_start().starts_with(label)).count(), 1, "{label}: {said}");
    }
    let (said, _) = status(&["check", file.to_str().unwrap()], 0);
    assert_eq!(said.lines().count(), 1, "only where asked: {said}");
}

#[test]
fn missing_direction_makes_the_job_infeasible_and_is_named() {
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
    let (said, _) = status(&["check", file.to_str().unwrap(), "--plan"], 1);
    assert!(said.contains("cannot be done") && said.contains("towards 90 deg, 0.000 of the best"), "{said}");
}

#[test]
fn infeasible_run_ends_at_its_first_observation_with_part_and_direction() {
    let folder = TempDir::new().unwrap();
    let file = hardly_along_y(folder.path());
    let plan = &planned(&file, 1)["plan"];
    let reason = plan["dry_runs"][0]["reason"].as_str().unwrap();
    assert!(reason.contains("penny-1 towards 90 deg") && reason.contains("at least 1e-4"), "{reason}");
    let out = folder.path().to_str().unwrap();
    let (report, _) = status(&["run", file.to_str().unwrap(), "--out", out, "--rerun", "off", "--json"], 1);
    let report: Value = serde_json::from_str(&report).unwrap();
    assert_eq!((&report["outcome"], &report["pulses"]), (&json!("failed"), &json!(0)));
    assert_eq!(report["stop"], json!({"code": "uncontrollable", "text": reason}));
}

/// A shipped job on `upm-2`, altered by `change`.
fn shipped(folder: &Path, name: &str, change: impl FnOnce(&mut Value)) -> PathBuf {
    let mut job: Value = serde_json::from_str(&fs::read_to_string(root().join("configs").join(name)).unwrap()).unwrap();
    job["rig"] = json!(root().join("configs/rigs/upm-2.json"));
    change(&mut job);
    let file = folder.join("job.json");
    fs::write(&file, job.to_string()).unwrap();
    file
}

#[test]
fn speed_that_can_be_held_is_in_the_plan_and_a_faster_one_is_told_by_the_run() {
    let folder = TempDir::new().unwrap();
    let file = shipped(folder.path(), "plus-sign-upm-2.json", |job| {
        let path = json!({"circle": {"radius_mm": 40}, "speed_mm_s": 500, "repeat": 2});
        job["task"] = json!({"type": "trajectories", "paths": [path]});
    });
    let speed = planned(&file, 0)["plan"]["speed_mm_s"].clone();
    let (said, _) = status(&["check", file.to_str().unwrap(), "--plan"], 0);
    assert!(said.contains(" mm/s can be held, 500.0 asked, laps will be late"), "{said}");
    let out = folder.path().to_str().unwrap();
    let (report, warnings) = status(&["run", file.to_str().unwrap(), "--out", out, "--rerun", "off", "--json"], 0);
    let report: Value = serde_json::from_str(&report).unwrap();
    let (held, forecast) = (number(&report["speed_held_mm_s"]), number(&speed["can_be_held"]));
    assert!((held / forecast - 1.0).abs() < 0.1, "{held} {forecast}");
    assert!(warnings.contains("lap 1 took") && report["reason"].as_str().unwrap().contains("% of the speed asked"));
}

#[test]
fn corridor_narrower_than_can_be_held_is_refused_with_the_one_that_can() {
    let folder = TempDir::new().unwrap();
    let file = shipped(folder.path(), "plus-sign-upm-2.json", |job| job["task"]["corridor_mm"] = json!(0.05));
    let (_, refused) = status(&["check", file.to_str().unwrap()], 2);
    assert!(refused.contains("task.corridor_mm: expected 0.14 or more") && refused.contains("found 0.05"), "{refused}");
}

#[test]
fn tolerance_finer_than_can_be_held_is_a_warning_and_its_run_ends_soon() {
    let folder = TempDir::new().unwrap();
    let file = shipped(folder.path(), "arrange-4.json", |job| job["tolerance_mm"] = json!(0.001));
    let path = file.to_str().unwrap();
    let (said, warned) = status(&["check", path], 0);
    assert!(said.contains(": ok, job arrange-4"), "{said}");
    assert!(
        warned.contains("warning: ") && warned.contains("tolerance_mm: expected ") && warned.contains("found 0.001 mm"),
        "{warned}"
    );
    assert!(warned.contains("expected 0.29 mm or more with synthesized_field"), "{warned}");
    let (rows, _) = status(&["check", path, "--json"], 0);
    let rows: Value = serde_json::from_str(&rows).unwrap();
    assert_eq!((&rows[0]["valid"], rows[0]["warnings"].as_array().map(Vec::len)), (&json!(true), Some(1)));
    let out = folder.path().to_str().unwrap();
    let (report, _) = status(&["run", path, "--out", out, "--rerun", "off", "--json"], 1);
    let report: Value = serde_json::from_str(&report).unwrap();
    assert_eq!(report["stop"]["code"], "no_progress");
    assert!(number(&report["plate_time_s"]) < 60.0, "{report}");
    let (_, warned) = status(&["check", root().join("configs/arrange-4.json").to_str().unwrap()], 0);
    assert_eq!(warned, "", "0.5 mm can be held");
}

#[test]
fn too_little_time_is_a_reason() {
    let folder = TempDir::new().unwrap();
    let file = job(folder.path(), |job| job["limits"]["plate_time_s"] = json!(5));
    let plan = &planned(&file, 1)["plan"];
    assert_eq!(plan["endings"][0]["times"], 5, "{plan}");
    assert!(plan["endings"][0]["reason"].as_str().unwrap().starts_with("plate time limit of 5 s reached"), "{plan}");
}

#[test]
fn only_jobs_are_planned_and_faulty_ones_refused() {
    let folder = TempDir::new().unwrap();
    for other in ["configs/rigs/upm-1.json", "assets/libraries/upm-1.json"] {
        let (stdout, stderr) = status(&["check", other, "--plan"], 2);
        assert!(stdout.is_empty() && stderr.contains("--plan: expected jobs alone, found "), "{stderr}");
    }
    let file = job(folder.path(), |job| job["tolerance_mm"] = json!(0));
    let (stdout, stderr) = status(&["check", file.to_str().unwrap(), "--plan"], 2);
    assert!(stdout.is_empty() && stderr.contains("tolerance_mm: expected a number above 0"), "{stderr}");
}

#[test]
fn the_predicted_ways_are_drawn() {
    let folder = TempDir::new().unwrap();
    let picture = folder.path().join("plan.svg");
    let picture = picture.to_str().unwrap();
    status(&["check", "configs/trajectories.json", "--plan", "--picture", picture], 0);
    let drawn = fs::read_to_string(picture).unwrap();
    assert!(drawn.starts_with("<svg ") && drawn.trim_end().ends_with("</svg>"));
    for words in ["trajectories on upm-2", "predicted path", "start", "target", "wanted path", "penny-1", "penny-2"] {
        assert!(drawn.contains(words), "{words}");
    }
    fs::remove_file(picture).unwrap();
    let (_, stderr) = status(&["check", "configs/trajectories.json", "--picture", picture], 2);
    assert!(stderr.contains("--picture: expected ") && !Path::new(picture).exists(), "{stderr}");
    let hopeless = hardly_along_y(folder.path());
    status(&["check", hopeless.to_str().unwrap(), "--plan", "--picture", picture], 1);
    assert!(fs::read_to_string(picture).unwrap().contains("cannot be done"));
}

/// Asserts that the shipped job takes the predicted time within a quarter.
fn a_run_takes_what_was_predicted(name: &str) {
    let file = root().join("configs").join(name);
    let predicted_s = number(&planned(&file, 0)["plan"]["predicted_plate_time_s"]["median"]);
    let folder = TempDir::new().unwrap();
    let (file, out) = (file.to_str().unwrap(), folder.path().to_str().unwrap());
    let (report, _) = status(&["run", file, "--out", out, "--rerun", "off", "--json"], 0);
    let taken_s = number(&serde_json::from_str::<Value>(&report).unwrap()["plate_time_s"]);
    assert!((predicted_s / taken_s - 1.0).abs() < 0.25, "{predicted_s} s predicted, {taken_s} s taken");
}

#[test]
fn plus_sign_on_the_weak_rig_takes_the_predicted_time() {
    a_run_takes_what_was_predicted("plus-sign.json");
}

#[test]
fn plus_sign_on_the_strong_rig_takes_the_predicted_time() {
    a_run_takes_what_was_predicted("plus-sign-upm-2.json");
}

#[test]
fn dense_job_by_fields_takes_the_predicted_time() {
    a_run_takes_what_was_predicted("arrange-16.json");
}

#[test]
fn planner_is_named_with_its_reason_and_the_other_ones() {
    let planner = |name: &str| planned(&root().join("configs").join(name), 0)["plan"]["planner"].clone();
    let auto = planner("arrange-8.json");
    assert_eq!((&auto["name"], &auto["chosen"]), (&json!("synthesized_field"), &json!("auto")));
    assert_eq!(
        (&auto["code"], &auto["alternatives"]),
        (&json!("several_parts"), &json!(["cor_sequence", "pseudo_inverse"]))
    );
    let named = planner("arrange-4-cor.json");
    assert_eq!((&named["name"], &named["chosen"]), (&json!("cor_sequence"), &json!("job")));
    assert_eq!(named["alternatives"], json!(["synthesized_field", "pseudo_inverse"]));
    let alone = planner("plus-sign.json");
    assert_eq!((&alone["name"], &alone["code"]), (&json!("cor_sequence"), &json!("no_fields")));
    let (said, _) = status(&["check", "configs/plus-sign-upm-2.json", "--plan"], 0);
    let line = said.lines().find(|line| line.trim_start().starts_with("planner ")).unwrap();
    assert!(line.contains("cor_sequence: the job moves one part; also possible: synthesized_field"), "{line}");
}

#[test]
fn failed_run_names_its_planner_and_the_alternatives() {
    let folder = TempDir::new().unwrap();
    let text = fs::read_to_string(root().join("configs/arrange-4.json")).unwrap();
    let mut job: Value = serde_json::from_str(&text).unwrap();
    job["rig"] = json!(root().join("configs/rigs/upm-2.json"));
    job["limits"] = json!({"plate_time_s": 0.5});
    let file = folder.path().join("job.json");
    fs::write(&file, job.to_string()).unwrap();
    let out = folder.path().to_str().unwrap();
    let run = ["run", file.to_str().unwrap(), "--out", out, "--rerun", "off"];
    let (said, _) = status(&run, 1);
    let line = said.lines().find(|line| line.trim_start().starts_with("planner ")).unwrap();
    assert!(line.contains("synthesized_field: the rig has fields and the job moves 4 parts"), "{line}");
    assert!(line.contains("also possible: cor_sequence"), "{line}");
    let (report, _) = status(&[&run[..], &["--json"]].concat(), 1);
    let planner = serde_json::from_str::<Value>(&report).unwrap()["planner"].clone();
    assert_eq!((&planner["name"], &planner["chosen"]), (&json!("synthesized_field"), &json!("auto")));
}

#[test]
fn dry_runs_of_twenty_four_coins_reach_the_goal() {
    let plan = &planned(&root().join("configs/arrange-24.json"), 0)["plan"];
    let completed = plan["dry_runs"].as_array().unwrap().iter().filter(|run| run["completed"] == true).count();
    assert!(completed >= 4, "{plan}");
}

#[test]
fn dry_run_is_the_run_without_pixels_which_can_be_verified() {
    let file = root().join("configs/arrange-8.json");
    let dry_run = planned(&file, 0)["plan"]["dry_runs"][0].clone();
    let folder = TempDir::new().unwrap();
    let (file, out) = (file.to_str().unwrap(), folder.path().to_str().unwrap());
    let run = ["run", file, "--camera", "positions", "--out", out];
    let (report, _) = status(&[&run[..], &["--json"]].concat(), 0);
    let report: Value = serde_json::from_str(&report).unwrap();
    assert_eq!((&report["camera"], &report["pulses"]), (&json!("positions"), &dry_run["pulses"]));
    assert_eq!((&report["plate_time_s"], &report["seed"]), (&dry_run["plate_time_s"], &dry_run["seed"]));
    let (verified, _) = status(&["verify", "last", "--out", out], 0);
    assert!(verified.contains("byte for byte"), "{verified}");
    let (said, _) = status(&run, 0);
    assert!(said.contains("camera          positions in place of pictures"), "{said}");
    let (said, _) = status(&[&run[..], &["--seeds", "1..2"]].concat(), 0);
    assert!(said.contains("2 seeds, positions in place of pictures: 2 completed"), "{said}");
}
