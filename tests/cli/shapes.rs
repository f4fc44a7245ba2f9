//! Jobs with generated targets and paths, with `upm` as a subprocess.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use tempfile::TempDir;

use super::{file, root, run, status};

#[path = "../docs/pages.rs"]
#[allow(dead_code)] // prose and marks
mod pages;

/// A job on `upm-2` in a new file.
fn written(folder: &Path, parts: u32, task: Value) -> PathBuf {
    let rig = root().join("configs/rigs/upm-2.json");
    let job = json!({"name": "shape", "rig": rig, "parts": [{"kind": "penny", "count": parts}], "task": task});
    file(folder, "job.json", &job)
}

#[test]
fn run_of_a_drawing_is_verified_without_its_file() {
    let folder = TempDir::new().unwrap();
    let drawing = folder.path().join("roof.svg");
    fs::write(&drawing, r#"<svg xmlns="http://www.w3.org/2000/svg"><path d="M0 10 L10 0 L20 10"/></svg>"#).unwrap();
    let task = json!({"type": "arrange", "targets": {"svg": {"file": "roof.svg", "width_mm": 120}}});
    let file = written(folder.path(), 3, task);
    let (run, _) = run(&file, &folder.path().join("runs"), &["--camera", "positions"], 0);
    fs::remove_file(drawing).unwrap();
    fs::remove_file(file).unwrap();
    let effective: Value = serde_json::from_str(&fs::read_to_string(run.join("effective.json")).unwrap()).unwrap();
    assert_eq!(effective["job"]["task"]["targets"]["svg"]["d"], "M0,10 L10,0 L20,10");
    status(&["verify", run.to_str().unwrap()], 0);
}

/// A fault's path, expected and found value, without the file.
fn without_file<'a>(file: &Path, line: &'a str) -> &'a str {
    line.trim_end().strip_prefix(&format!("upm: {}: ", file.display())).unwrap_or_else(|| panic!("{line}"))
}

#[test]
fn examples_of_the_guide_to_jobs_are_valid_or_faulty_as_stated() {
    let folder = TempDir::new().unwrap();
    let guide = root().join("docs/jobs.md");
    let blocks = pages::Page::read(&guide).blocks;
    let (mut valid, mut faulty, mut others) = (0, 0, Vec::new());
    for (i, pages::Block { info, text, .. }) in blocks.iter().enumerate().filter(|(_, of)| of.info.starts_with("json"))
    {
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
        match blocks.get(i + 1).filter(|block| block.info == "text") {
            None => {
                status(&["check", file.to_str().unwrap()], 0);
                valid += 1;
            }
            Some(expected) => {
                let (_, stderr) = status(&["check", file.to_str().unwrap()], 2);
                let found = without_file(&file, &stderr).to_owned();
                others.extend((found != expected.text.trim_end().replace('\n', " ")).then_some(found));
                faulty += 1;
            }
        }
    }
    assert_eq!(others, Vec::<String>::new(), "faults that the guide tells otherwise");
    assert!(valid >= 8 && faulty >= 1, "{valid} valid, {faulty} faulty");
}
