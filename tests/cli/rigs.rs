//! Rigs and `upm` as a subprocess: their libraries, the rig given with `--rig`, and the required view of the camera.

use serde_json::{Value, json};
use tempfile::TempDir;

use super::{file, read, root, status};

/// The shipped rig `name` with an absolute library path, altered by `change`, in a new file.
fn rig(folder: &TempDir, name: &str, change: impl FnOnce(&mut Value)) -> String {
    let mut rig = read(&format!("configs/rigs/{name}.json"));
    rig["library"] = json!(root().join(format!("assets/libraries/{name}.json")));
    change(&mut rig);
    file(folder.path(), "my-rig.json", &rig).to_str().unwrap().to_owned()
}

#[test]
fn checked_rig_is_held_against_its_library() {
    let folder = TempDir::new().unwrap();
    let (stdout, _) = status(&["check", &rig(&folder, "upm-1", |_| {})], 0);
    assert!(stdout.contains("library of 337 motions"), "{stdout}");
    let none = rig(&folder, "upm-1", |rig| drop(rig.as_object_mut().unwrap().remove("library")));
    assert!(status(&["check", &none], 0).0.contains("no library (`upm calibrate` makes one)"));
    let copy = rig(&folder, "upm-2", |rig| rig["library"] = json!(root().join("assets/libraries/upm-1.json")));
    for args in [&["check", &copy][..], &["check", "configs/plus-sign.json", "--rig", &copy]] {
        let (_, stderr) = status(args, 2);
        assert!(stderr.starts_with(&format!("upm: rig {copy}: library: ")), "{stderr}");
        assert!(stderr.contains("\"upm-2\" (run `upm calibrate` for this rig), found \"upm-1\""), "{stderr}");
        assert_eq!(stderr.lines().count(), 1, "{stderr}");
    }
}

#[test]
fn job_is_checked_on_the_rig_given() {
    let says = |args: &[&str]| status(&[&["check", "configs/plus-sign-upm-2.json"], args].concat(), 0).0;
    assert!(says(&[]).contains("on upm-2,"));
    assert!(says(&["--rig", "configs/rigs/upm-1.json"]).contains("on upm-1,"));
    // bins that only the larger plate has room for
    let (_, stderr) = status(&["check", "configs/sort-8.json", "--rig", "configs/rigs/upm-1.json"], 2);
    assert!(stderr.lines().all(|line| line.contains("sort-8.json: task.bins")), "{stderr}");
}

/// Camera height that the fault names, mm.
fn height_mm(stderr: &str) -> f64 {
    assert!(stderr.lines().count() == 1 && stderr.contains("camera: expected the whole plate in view"), "{stderr}");
    let (_, said) = stderr.split_once("position_mm[2] of ").unwrap();
    said.split_once(' ').unwrap().0.parse().unwrap()
}

#[test]
fn camera_at_the_height_that_is_named_sees_the_whole_plate() {
    for (name, place_mm, tilt_deg) in [
        ("upm-1", [12.0, -24.0, 600.0], [1.5, -1.0, 2.0]),
        ("upm-1", [60.0, 30.0, 700.0], [0.0, 0.0, 30.0]),
        ("upm-2", [0.0, 0.0, 500.0], [-3.0, 2.0, 10.0]),
        ("upm-2", [15.0, -35.0, 1250.0], [1.5, -0.8, 44.0]),
    ] {
        let folder = TempDir::new().unwrap();
        let at = |height_mm: f64| {
            rig(&folder, name, |rig| {
                rig["camera"]["position_mm"] = json!([place_mm[0], place_mm[1], height_mm]);
                rig["camera"]["tilt_deg"] = json!(tilt_deg);
            })
        };
        let named_mm = height_mm(&status(&["check", &at(place_mm[2])], 2).1);
        assert!(named_mm > place_mm[2]);
        status(&["check", &at(named_mm)], 0);
        assert!(height_mm(&status(&["check", &at(named_mm - 2.0)], 2).1) <= named_mm, "the least that would do");
    }
}
