//! Figures of runs, dry runs and open-loop pulses on the pages, and figures that two pages have.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::{Value, json};
use tempfile::TempDir;

use super::page::{FigurePage, numbers};
use super::{file, read, root, run, shipped, status};

/// Header of the tables of one coin, of pictures, of the plate and of the daemon on the page of results.
const RESULTS: &str = "| what | measured | command |";

/// Runs a shipped job, altered by `change`; returns its report.
fn report(name: &str, change: impl FnOnce(&mut Value)) -> Value {
    let folder = TempDir::new().unwrap();
    run(&shipped(folder.path(), name, change), &folder.path().join("out"), &[], 0).1
}

/// Folders of the runs in `out`.
fn run_folders(out: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(out).unwrap().map(|entry| entry.unwrap().path());
    entries.filter(|path| path.is_dir()).collect()
}

fn number(value: &Value, pointer: &str) -> f64 {
    value.pointer(pointer).and_then(Value::as_f64).unwrap_or_else(|| panic!("{pointer} in {value}"))
}

fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, f64::max)
}

#[test]
fn knocked_parts_go_as_far_as_the_page_of_jobs_says() {
    // a part is brought back beyond the tolerance alone
    let report = report("hold-4", |job| job["tolerance_mm"] = json!(100));
    assert_eq!(report["pulses"], 1, "the probe alone: {report}");
    let parts = report["parts"].as_array().unwrap();
    let off_mm: Vec<f64> = parts.iter().map(|part| number(part, "/error_mm")).collect();
    let least_mm = off_mm.iter().copied().fold(f64::INFINITY, f64::min);
    let mut page = FigurePage::open("docs/jobs.md");
    page.passage("without a pulse its parts are", "mm off after 10 s", &[least_mm, largest(off_mm.into_iter())]);
    page.assert_as_measured();
}

/// How far one pulse carries a penny from the middle of a plate along x, mm.
fn carried_mm(pulse: &Value) -> f64 {
    let folder = TempDir::new().unwrap();
    let experiment = json!({
        "rig": root().join("configs/rigs/upm-2.json"),
        "plate": "kinematic",
        "parts": [{"kind": "penny", "position_mm": [0, 0]}],
        "pulses": [pulse],
    });
    let experiment = file(folder.path(), "pulse.json", &experiment);
    let (stdout, _) = status(&["simulate", experiment.to_str().unwrap(), "--json"], 0);
    let result: Value = serde_json::from_str(&stdout).unwrap();
    result["parts"][0]["x_mm"].as_array().unwrap().last().unwrap().as_f64().unwrap()
}

#[test]
fn pulses_carry_a_penny_as_far_as_the_student_page_says() {
    const SPEEDS: &str = "| `A`, m/s |";
    let mut page = FigurePage::open("docs/student.md");
    let columns = page.row(SPEEDS, "moved, mm").columns;
    assert!(columns.len() > 5, "{columns:?}");
    for column in columns.iter().skip(1) {
        let speed_mps: f64 = column.parse().unwrap();
        let moved_mm = carried_mm(&json!({"direction_deg": 0, "speed_mps": speed_mps, "sustain_s": 0.1}));
        page.cell(SPEEDS, "moved, mm", column, &[moved_mm]);
    }
    let harmonics = json!([{"cos": [0.4, 0, 0]}, {"cos": [0.2, 0, 0]}]);
    let back_mm = -carried_mm(&json!({"harmonics": harmonics, "sustain_s": 0.1}));
    page.passage("and the coin goes back by", "mm.", &[back_mm]);
    page.assert_as_measured();
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn more_coins_and_more_scatter_have_the_figures_of_the_student_page() {
    let mut page = FigurePage::open("docs/student.md");
    let shares = [2, 8, 16].map(|parts| {
        let folder = TempDir::new().unwrap();
        let name = format!("arrange-{parts}");
        let file = shipped(folder.path(), &name, |job| job["planner"] = json!("cor_sequence"));
        let (stdout, _) = status(&["check", file.to_str().unwrap(), "--plan", "--json"], 0);
        number(&serde_json::from_str(&stdout).unwrap(), "/0/plan/independence/share")
    });
    page.passage("With two coins it is", ". This is a dry run", &shares);
    let off_mm = [0.3, 0.1].map(|spread| {
        let report = report("arrange-8", |job| {
            job["rig"] = read("configs/rigs/upm-2.json");
            job["rig"]["library"] = json!(root().join("assets/libraries/upm-2.json"));
            job["rig"]["friction"]["spread"] = json!(spread);
        });
        number(&report, "/prediction_error_mm/library")
    });
    page.passage("forecasts for eight coins are off by", ", and the job", &off_mm);
    page.assert_as_measured();
}

#[test]
#[cfg(feature = "rerun")]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn recording_of_a_lap_is_as_large_as_the_results_page_says() {
    let out = TempDir::new().unwrap();
    let args = ["run", "configs/plus-sign.json", "--quiet", "--rerun", "save", "--out", out.path().to_str().unwrap()];
    status(&args, 0);
    let recording = run_folders(out.path())[0].join("run.rrd");
    let size_mb = (fs::metadata(recording).unwrap().len() as f64 / 1e6).round();
    let page = FigurePage::open("docs/results.md");
    let said = numbers(page.row(RESULTS, "recording of one lap").cell("measured"));
    assert!((said[0]..=said[1]).contains(&size_mb), "{size_mb} MB, docs/results.md says {said:?}");
}

/// Runs as many seeds and laps as the table's first row names.
#[test]
#[ignore = "campaign: `cargo test --test cli -- --ignored campaign_of` runs it"]
fn campaign_of_the_plus_sign_has_the_figures_of_the_results_page() {
    let mut page = FigurePage::open("docs/results.md");
    let rows = page.rows(RESULTS);
    let label = rows.iter().map(|row| &row.cells[0]).find(|label| label.contains(" seeds, ")).unwrap();
    let [seeds, laps] = numbers(label)[..] else { panic!("expected seeds and laps, found {label:?}") };
    let folder = TempDir::new().unwrap();
    let file = shipped(folder.path(), "plus-sign", |job| {
        job["task"]["laps"] = json!(laps as u32);
        job["limits"] = json!({"plate_time_s": 300.0 * laps});
    });
    let (out, seeds) = (folder.path().join("out"), format!("1..{seeds}"));
    let args = ["run", file.to_str().unwrap(), "--seeds", &seeds, "-q", "--out", out.to_str().unwrap()];
    status(&args, 0);
    let texts = run_folders(&out).into_iter().map(|run| fs::read_to_string(run.join("report.json")).unwrap());
    let reports: Vec<Value> = texts.map(|text| serde_json::from_str(&text).unwrap()).collect();
    let done = reports.iter().filter(|report| report["outcome"] == "completed" && report["lost_parts"] == 0).count();
    page.cell(RESULTS, label, "measured", &[done as f64, reports.len() as f64]);
    let over = |key: &'static str| reports.iter().map(move |report| number(report, key));
    // of all frames together
    let squares = over("/cross_track_rms_mm").zip(over("/frames")).map(|(rms_mm, frames)| rms_mm.powi(2) * frames);
    let cross_mm = (squares.sum::<f64>() / over("/frames").sum::<f64>()).sqrt();
    let worst_mm = largest(over("/cross_track_rms_mm"));
    page.cell(RESULTS, "cross-track error in every frame", "measured", &[cross_mm, worst_mm]);
    let (most_mm, travel) = (largest(over("/cross_track_max_mm")), largest(over("/travel_ratio")));
    page.cell(RESULTS, "largest distance from the path", "measured", &[most_mm, travel]);
    let sensed_mm = largest(over("/sensing_rms_error_mm"));
    page.cell(RESULTS, "measured against true position", "measured", &[sensed_mm]);
    page.assert_as_measured();
}

#[test]
#[ignore = "long: `cargo test -- --ignored` runs it"]
fn half_of_the_time_step_changes_as_much_as_the_results_page_says() {
    let tool = ["tools/bench/plate.py", "--repeats", "1", "--json", "--upm", env!("CARGO_BIN_EXE_upm")];
    let output = Command::new("python3").args(tool).current_dir(root()).output().unwrap();
    // the status tells of the speed, too, which is the machine's
    let result: Value = serde_json::from_slice(&output.stdout).unwrap();
    let worst = largest(result["halving"].as_array().unwrap().iter().map(|plate| number(plate, "/worst_share")));
    let mut page = FigurePage::open("docs/results.md");
    page.cell(RESULTS, "halving the time step", "measured", &[100.0 * worst]);
    page.assert_as_measured();
}

/// The tests do not measure these: they take hours, or other programs.
#[test]
fn figures_that_a_page_takes_from_another_are_equal() {
    let (readme, results) = (FigurePage::open("README.md"), FigurePage::open("docs/results.md"));
    let of_rows = |labels: &[&str]| -> Vec<f64> {
        labels.iter().flat_map(|label| numbers(&results.row(RESULTS, label).cells.join(" "))).collect()
    };
    for (label, labels) in [
        ("table and 16 pennies in a picture", &["table and 16 pennies from nothing"][..]),
        ("one pulse, motion of four points", &["one pulse, four points", "the same pulse, stepping alone"]),
    ] {
        let row = readme.row("| what | `upm` | best rival |", label);
        let (taken, measured) = (numbers(&row.cells.join(" ")), of_rows(labels));
        assert!(taken.len() > 2, "{row:?}");
        let others: Vec<&f64> = taken.iter().filter(|number| !measured.contains(number)).collect();
        assert_eq!(others, [&0.0; 0], "README.md, {label:?}: docs/results.md has {measured:?}");
    }
    let faults = FigurePage::open("docs/faults.md");
    let runs = faults.text_between("In the newest campaign", "runs broke a rule").trim();
    let said = readme.text_between("faults drawn by seed,", "runs [broke a rule]").trim();
    assert_eq!(said, runs, "README.md and docs/faults.md");
    let limits = FigurePage::open("docs/limits.md");
    let [stopped, harmless] = numbers(limits.text_between("nothing dangerous happens (", "runs with"))[..] else {
        panic!("docs/limits.md says how many of how many runs stop");
    };
    let said = numbers(faults.text_between("no fault began completed.", "stopped ("));
    assert_eq!(said, [harmless, stopped], "docs/limits.md and docs/faults.md");
}
