//! `upm check` of a COR library as a subprocess.

use std::fs;
use std::path::Path;

use serde_json::{Value, json};
use tempfile::TempDir;

use super::{file, read, status};

/// JSON result of `upm check` for the one library in `args`.
fn coverage(args: &[&str]) -> Value {
    let args: Vec<&str> = ["check", "--json"].iter().chain(args).copied().collect();
    let rows: Value = serde_json::from_str(&status(&args, 0).0).unwrap();
    rows[0]["coverage"].clone()
}

#[test]
fn coverage_of_the_shipped_libraries_is_reported() {
    for (name, side_mm, motions) in [("upm-1", 203.2, 337), ("upm-2", 304.8, 410)] {
        let (library, rig) = (format!("assets/libraries/{name}.json"), format!("configs/rigs/{name}.json"));
        let known = coverage(&[&library, "--rig", &rig]);
        assert_eq!(known["side_mm"], side_mm);
        let count = |key: &str| known["centres"][key].as_u64().unwrap();
        assert_eq!(count("inside") + count("outside") + count("translations"), motions);
        assert_eq!(known["out_of_reach_share"], 0.0, "{name} moves parts everywhere and every way");
        let rows = known["longest_step_mm"].as_array().unwrap();
        let steps: Vec<f64> =
            rows.iter().flat_map(|row| row.as_array().unwrap()).map(|v| v.as_f64().unwrap()).collect();
        let least = steps.iter().copied().fold(f64::INFINITY, f64::min);
        assert_eq!(known["weakest"]["longest_step_mm"], json!(least));
        if name == "upm-2" {
            continue;
        }
        assert_eq!(coverage(&[&library]), known, "a library knows its plate");
        let (said, _) = status(&["check", &library, "--rig", &rig], 0);
        for label in ["centres", "largest gap", "weakest place", "longest step", "out of reach", "never strongest"] {
            assert_eq!(said.lines().filter(|line| line.trim_start().starts_with(label)).count(), 1, "{said}");
        }
    }
}

#[test]
fn coverage_is_drawn_for_one_library() {
    let folder = TempDir::new().unwrap();
    let map = folder.path().join("map.svg");
    let map = map.to_str().unwrap();
    let (library, rig) = ("assets/libraries/upm-1.json", "configs/rigs/upm-1.json");
    status(&["check", library, "--rig", rig, "--picture", map], 0);
    let drawn = fs::read_to_string(map).unwrap();
    assert!(drawn.starts_with("<svg ") && drawn.trim_end().ends_with("</svg>"));
    assert!(drawn.contains("upm-1") && drawn.contains("centre of rotation") && drawn.contains("weakest direction"));
    fs::remove_file(map).unwrap();
    for args in [
        &["check", library, library, "--picture", map][..],
        &["check", rig, "--picture", map],
        &["check", library, "--picture", "map.png"],
    ] {
        let (stdout, stderr) = status(args, 2);
        assert!(stdout.is_empty() && stderr.trim().lines().count() == 1, "{stdout}{stderr}");
        assert!(stderr.contains("--picture: expected ") && stderr.contains(", found "), "{stderr}");
        assert!(!Path::new(map).exists());
    }
    let nowhere = folder.path().join("no/such/folder/map.svg");
    status(&["check", library, "--picture", nowhere.to_str().unwrap()], 1);
}

#[test]
fn unreachable_places_are_marked() {
    let folder = TempDir::new().unwrap();
    let mut library = read("assets/libraries/upm-1.json");
    let motion = |velocity: [f64; 2], spin: f64| json!({"amplitudes": [-271, 69, 268, -66], "velocity_mm_s": velocity, "spin_rad_s": spin});
    // along x everywhere; along y only far from one centre, which is at (-25, 15) mm
    library["entries"] = json!([motion([40.0, 0.0], 0.0), motion([30.0, 0.0], 0.0), motion([6.0, 10.0], 0.4)]);
    let (path, map) = (file(folder.path(), "poor.json", &library), folder.path().join("map.svg"));
    let (path, map) = (path.to_str().unwrap(), map.to_str().unwrap());
    status(&["check", path, "--rig", "configs/rigs/upm-1.json", "--picture", map], 0);
    assert!(fs::read_to_string(map).unwrap().contains("out of reach"));
    let report = coverage(&[path, "--rig", "configs/rigs/upm-1.json"]);
    let share = report["out_of_reach_share"].as_f64().unwrap();
    assert!((50.0 / 441.0..200.0 / 441.0).contains(&share), "{share}");
    assert_eq!(report["centres"], json!({"inside": 1, "outside": 0, "translations": 2}));
    let degrees = report["weakest"]["direction_deg"].as_f64().unwrap();
    assert!((degrees - 90.0).abs() < 5.0, "{degrees}");
}

#[test]
fn calibration_output_that_is_a_folder_is_refused_before_anything_is_measured() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let (stdout, stderr) = status(&["calibrate", "--rig", "configs/rigs/upm-1.json", "--out", out], 2);
    assert_eq!(stdout, "");
    assert_eq!(stderr.trim_end(), format!("upm: {out}: expected the path of a file, found a folder or device"));
    let nowhere = folder.path().join("none/library.json");
    let (_, stderr) = status(&["calibrate", "--rig", "configs/rigs/upm-1.json", "--out", nowhere.to_str().unwrap()], 1);
    assert!(stderr.contains("cannot write "), "{stderr}");
}
