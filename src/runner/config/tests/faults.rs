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
    for (file, found) in [
        ("daemon.json", "a daemon's configuration, for `upm serve --config`"),
        ("rigs/upm-1.json", "a rig, for `upm calibrate --rig`"),
    ] {
        assert_eq!(listing(&value_of(file).to_string()), format!("bad.json: expected a job, found {found}\n"));
    }
    let rig = RigSpec::from_json(&value_of("plus-sign.json").to_string(), &Origin::of_request("x"));
    assert_eq!(lines(rig.unwrap_err()), ["$: expected a rig, found a job, for `upm run`"]);
    let mut strange = value_of("plus-sign.json");
    strange["plates"] = json!([]);
    assert!(listing(&strange.to_string()).contains(", found unknown key \"plates\"\n"), "it is a job all the same");
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
    assert_eq!(fault(&path), format!("cannot read {}: no such file", path.display()));
    assert_eq!(fault(folder.path()), format!("cannot read {}: it is a folder", folder.path().display()));
    let near = folder.path().join("y.json");
    std::fs::write(&near, "{}").unwrap();
    assert_eq!(
        fault(&path),
        format!("cannot read {}: no such file (did you mean {}?)", path.display(), near.display())
    );
    std::fs::write(&path, b"{\"name\": \"\xff\"}").unwrap();
    assert!(fault(&path).ends_with("expected UTF-8 text, found a byte that is not UTF-8 at offset 10"));
    let mut file = std::fs::File::create(&path).unwrap();
    file.write_all(&vec![b' '; MOST_BYTES as usize + 1]).unwrap();
    assert!(fault(&path).contains("up to 1 MiB"), "{}", fault(&path));
}

#[test]
fn a_rig_that_is_not_there_is_a_fault_of_the_job() {
    let mut document = value_of("plus-sign.json");
    set(&mut document, "/rig", json!("rigs/upm-9.json"));
    let faults = job(&document).unwrap_err();
    assert_eq!(faults.len(), 1);
    let line = faults[0].to_string();
    let (named, read) = line.split_once(": cannot read ").unwrap();
    assert!(
        named.ends_with("test.json: rig") && read.contains("rigs/upm-9.json: no such file (did you mean "),
        "{line}"
    );
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
        lines(JobSpec::from_json(&text, &origin, None).unwrap_err()).first().map(String::as_str),
        Some("rig: expected a path or a rig object, found nothing")
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
