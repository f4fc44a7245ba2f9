use std::io::Write as _;
use std::path::Path;

use serde_json::json;

use super::{job, lines, set, value_of};
use crate::config::{JobSpec, MOST_BYTES, Origin, RigSpec};

fn listing(text: &str) -> String {
    let origin =
        Origin { file: "bad.json".to_owned(), folder: Some(concat!(env!("CARGO_MANIFEST_DIR"), "/../..").into()) };
    let faults = JobSpec::from_json(text, &origin, None).unwrap_err();
    faults.iter().map(|fault| format!("{fault}\n")).collect()
}

#[test]
fn every_fault_of_a_bad_job_is_listed() {
    assert_eq!(listing(include_str!("bad-shape.json")), include_str!("bad-shape.faults"));
    assert_eq!(listing(include_str!("bad-job.json")), include_str!("bad-job.faults"));
}

#[test]
fn a_file_of_another_kind_is_one_fault() {
    for (file, found) in [("daemon.json", "a daemon's configuration"), ("rigs/upm-1.json", "a rig")] {
        assert_eq!(listing(&value_of(file).to_string()), format!("bad.json: $: found {found}, allowed: a job\n"));
    }
    let rig = RigSpec::from_json(&value_of("plus-sign.json").to_string(), &Origin::of_request("x"));
    assert_eq!(lines(rig.unwrap_err()), ["$: found a job, allowed: a rig"]);
    let mut strange = value_of("plus-sign.json");
    strange["plates"] = json!([]);
    assert!(
        listing(&strange.to_string()).starts_with("bad.json: plates: found unknown key"),
        "it is a job all the same"
    );
}

#[test]
fn syntax_tells_line_and_column() {
    let line = listing("{\n  \"name\": \"x\",,\n}");
    assert!(line.starts_with("bad.json: $: found key must be a string at line 2 column 15"), "{line}");
    for (text, word) in [
        ("", "EOF"),
        ("{} x", "trailing"),
        ("{\"seed\": 1e999}", "out of range"),
        ("{\"seed\": NaN}", "expected value"),
        ("\u{feff}{}", "expected value"),
    ] {
        assert!(listing(text).contains(word), "{text}: {}", listing(text));
    }
    assert!(listing(&"[".repeat(100_000)).contains("recursion limit"));
}

#[test]
fn a_key_that_stands_twice_is_a_fault() {
    let text = value_of("plus-sign.json").to_string().replacen('{', "{\"seed\": 3, ", 1);
    assert!(listing(&text).contains("seed: found the key \"seed\" a second time"), "{}", listing(&text));
}

#[test]
fn files_that_cannot_be_read_are_one_fault() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.json");
    let fault = |path: &Path| {
        let faults = RigSpec::load(path).unwrap_err();
        assert_eq!(faults.len(), 1);
        faults[0].to_string()
    };
    assert!(fault(&path).contains("x.json: $: found No such file or directory"), "{}", fault(&path));
    assert!(fault(folder.path()).contains("Is a directory"), "{}", fault(folder.path()));
    std::fs::write(&path, b"{\"name\": \"\xff\"}").unwrap();
    assert!(fault(&path).ends_with("found a byte that is not UTF-8 at offset 10, allowed: UTF-8 text"));
    let mut file = std::fs::File::create(&path).unwrap();
    file.write_all(&vec![b' '; MOST_BYTES as usize + 1]).unwrap();
    assert!(fault(&path).contains("up to 1 MiB"), "{}", fault(&path));
}

#[test]
fn a_rig_that_is_not_there_is_a_fault_of_the_job() {
    let mut document = value_of("plus-sign.json");
    set(&mut document, "/rig", json!("rigs/upm-9.json"));
    let faults = lines(job(&document).unwrap_err());
    assert_eq!(faults.len(), 1);
    assert!(faults[0].starts_with("rig: found \"rigs/upm-9.json\", allowed: a rig file (No such file"), "{faults:?}");
}

#[test]
fn a_request_names_no_files() {
    let origin = Origin::of_request("request");
    let mut document = value_of("plus-sign.json");
    set(&mut document, "/library", json!("library.json"));
    let faults = lines(JobSpec::from_json(&document.to_string(), &origin, None).unwrap_err());
    assert_eq!(faults.len(), 2, "{faults:?}");
    assert!(faults.iter().all(|fault| fault.contains("files cannot be named here")), "{faults:?}");
    document.as_object_mut().unwrap().remove("rig");
    document.as_object_mut().unwrap().remove("library");
    let text = document.to_string();
    assert_eq!(
        lines(JobSpec::from_json(&text, &origin, None).unwrap_err())[0].split(',').next(),
        Some("rig: found nothing")
    );
    let rig = RigSpec::load(&super::shipped("rigs/upm-2.json")).unwrap();
    assert_eq!(JobSpec::from_json(&text, &origin, Some(&rig)).unwrap().rig, rig);
}

#[test]
fn faults_of_a_rig_file_carry_its_name() {
    let folder = tempfile::tempdir().unwrap();
    let mut rig = value_of("rigs/upm-1.json");
    set(&mut rig, "/plate/resonance_hz/x", json!(80));
    std::fs::write(folder.path().join("rig.json"), rig.to_string()).unwrap();
    let mut document = value_of("plus-sign.json");
    set(&mut document, "/rig", json!("rig.json"));
    let origin = Origin::of_file(&folder.path().join("job.json"));
    let faults = JobSpec::from_json(&document.to_string(), &origin, None).unwrap_err();
    assert_eq!(faults.len(), 1);
    assert!(faults[0].file.ends_with("rig.json") && faults[0].path == "plate.resonance_hz.x");
    set(&mut document, "/rig", rig);
    let faults = JobSpec::from_json(&document.to_string(), &origin, None).unwrap_err();
    assert!(faults[0].file.ends_with("job.json") && faults[0].path == "rig.plate.resonance_hz.x");
}
