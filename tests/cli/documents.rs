//! Figures of runs, dry runs and open-loop pulses on the pages.

use serde_json::{Value, json};
use tempfile::TempDir;

use super::page::FigurePage;
use super::{file, root, run, shipped, status};

#[test]
fn knocked_parts_go_as_far_as_the_page_of_jobs_says() {
    let folder = TempDir::new().unwrap();
    // a part is brought back beyond the tolerance alone
    let file = shipped(folder.path(), "hold-4", |job| job["tolerance_mm"] = json!(100));
    let (_, report) = run(&file, &folder.path().join("out"), &[], 0);
    assert_eq!(report["pulses"], 1, "the probe alone: {report}");
    let off_mm = report["parts"].as_array().unwrap().iter().map(|part| part["error_mm"].as_f64().unwrap());
    let off_mm = [off_mm.clone().fold(f64::INFINITY, f64::min), off_mm.fold(0.0, f64::max)];
    let mut page = FigurePage::open("docs/jobs.md");
    page.passage("without a pulse its parts are", "mm off after 10 s", &off_mm);
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
