//! Jobs with generated targets and paths, with `upm` as a subprocess.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use tempfile::TempDir;

use super::{root, status};

#[path = "../doc_commands/pages.rs"]
#[allow(dead_code)] // commands and marks
mod pages;

/// A job on `upm-2` in a new file.
fn written(folder: &Path, parts: u32, task: Value) -> PathBuf {
    let rig = root().join("configs/rigs/upm-2.json");
    let job = json!({"name": "shape", "rig": rig, "parts": [{"kind": "penny", "count": parts}], "task": task});
    let path = folder.join("job.json");
    fs::write(&path, job.to_string()).unwrap();
    path
}

#[test]
fn plan_and_its_picture_have_the_places_of_a_rule() {
    let folder = TempDir::new().unwrap();
    let task = json!({"type": "arrange", "targets": {"circle": {"radius_mm": 50}}, "assignment": "fixed"});
    let file = written(folder.path(), 4, task);
    let picture = folder.path().join("plan.svg");
    let args = ["check", file.to_str().unwrap(), "--plan", "--json", "--picture", picture.to_str().unwrap()];
    let (rows, _) = status(&args, 0);
    let rows: Value = serde_json::from_str(&rows).unwrap();
    let places = rows[0]["plan"]["parts"].as_array().unwrap().iter().map(|part| &part["target"]["position_mm"]);
    let expected = [[50.0, 0.0], [0.0, 50.0], [-50.0, 0.0], [0.0, -50.0]];
    for (place, expected) in places.zip(expected) {
        for (found, expected) in place.as_array().unwrap().iter().zip(expected) {
            assert!((found.as_f64().unwrap() - expected).abs() < 1e-3, "{rows}");
        }
    }
    assert!(fs::read_to_string(picture).unwrap().contains("target"), "the picture marks them");
}

#[test]
fn schema_of_a_job_lists_every_rule() {
    let (schema, _) = status(&["schema", "job"], 0);
    let schema: Value = serde_json::from_str(&schema).unwrap();
    let keys =
        |of: &str| -> Vec<String> { schema["$defs"][of]["properties"].as_object().unwrap().keys().cloned().collect() };
    assert_eq!(keys("TargetRule"), ["circle", "grid", "line", "svg", "text"]);
    let of_path = keys("PathEntry");
    assert!(["circle", "lissajous", "svg", "waypoints_mm"].iter().all(|key| of_path.iter().any(|other| other == key)));
}

#[test]
fn run_of_a_drawing_is_verified_without_its_file() {
    let folder = TempDir::new().unwrap();
    let drawing = folder.path().join("roof.svg");
    fs::write(&drawing, r#"<svg xmlns="http://www.w3.org/2000/svg"><path d="M0 10 L10 0 L20 10"/></svg>"#).unwrap();
    let task = json!({"type": "arrange", "targets": {"svg": {"file": "roof.svg", "width_mm": 120}}});
    let file = written(folder.path(), 3, task);
    let out = folder.path().join("runs");
    status(&["run", file.to_str().unwrap(), "--out", out.to_str().unwrap(), "--rerun", "off", "--json"], 0);
    fs::remove_file(drawing).unwrap();
    fs::remove_file(file).unwrap();
    let run = fs::read_dir(&out).unwrap().next().unwrap().unwrap().path();
    let effective: Value = serde_json::from_str(&fs::read_to_string(run.join("effective.json")).unwrap()).unwrap();
    assert_eq!(effective["job"]["task"]["targets"]["svg"]["d"], "M0,10 L10,0 L20,10");
    status(&["verify", run.to_str().unwrap()], 0);
}

#[test]
fn letters_that_do_not_fit_are_one_line_with_the_height_that_does() {
    let folder = TempDir::new().unwrap();
    let text = |height_mm: f64| {
        let task = json!({"type": "arrange", "targets": {"text": {"string": "HI", "height_mm": height_mm}}});
        written(folder.path(), 16, task)
    };
    let (_, stderr) = status(&["check", text(60.0).to_str().unwrap()], 2);
    assert_eq!(stderr.lines().count(), 1, "{stderr}");
    assert!(stderr.contains("task.targets.text: expected 21.050 mm or more"), "{stderr}");
    assert!(stderr.contains("height_mm of at least 84.2 mm, found penny-"), "{stderr}");
    assert!(stderr.trim_end().ends_with(" 15.000 mm apart"), "{stderr}");
    status(&["check", text(84.2).to_str().unwrap()], 0);
    status(&["check", text(84.1).to_str().unwrap()], 2);
}

/// A fault's path, expected and found value, without the file.
fn without_file<'a>(file: &Path, line: &'a str) -> &'a str {
    line.trim_end().strip_prefix(&format!("upm: {}: ", file.display())).unwrap_or_else(|| panic!("{line}"))
}

#[test]
fn examples_of_the_guide_to_jobs_are_valid_or_faulty_as_stated() {
    let folder = TempDir::new().unwrap();
    let guide = root().join("docs/jobs.md");
    let blocks = pages::Page::read("docs/jobs.md", &fs::read_to_string(guide).unwrap()).fences;
    let (mut valid, mut faulty, mut others) = (0, 0, Vec::new());
    for (i, (info, text)) in blocks.iter().enumerate().filter(|(_, (info, _))| info.starts_with("json")) {
        let example: Value = serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {text}"));
        let file = match info.split_whitespace().nth(1) {
            Some(parts) => written(folder.path(), parts.parse().unwrap(), example),
            None => {
                let task = example["task"].clone();
                let file = written(folder.path(), 1, task);
                let mut job: Value = serde_json::from_str(&fs::read_to_string(&file).unwrap()).unwrap();
                job["parts"] = example["parts"].clone();
                fs::write(&file, job.to_string()).unwrap();
                file
            }
        };
        match blocks.get(i + 1).filter(|(info, _)| info == "text") {
            None => {
                status(&["check", file.to_str().unwrap()], 0);
                valid += 1;
            }
            Some((_, expected)) => {
                let (_, stderr) = status(&["check", file.to_str().unwrap()], 2);
                let found = without_file(&file, &stderr).to_owned();
                others.extend((found != expected.trim_end().replace('\n', " ")).then_some(found));
                faulty += 1;
            }
        }
    }
    assert_eq!(others, Vec::<String>::new(), "faults that the guide tells otherwise");
    assert!(valid >= 8 && faulty >= 2, "{valid} valid, {faulty} faulty");
}
