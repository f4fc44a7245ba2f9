use std::path::Path;

use serde_json::{Value, json};

use super::{lines, rig, set, shipped, value_of};
use crate::config::{Diagnostic, JobSpec, Origin, RigSpec};
use crate::run::rig_library;

/// Shipped rigs as they are when written out: the members in which each differs from `upm-2`.
fn written_out(changes: &[(&str, Value)]) -> RigSpec {
    let mut document = value_of("rigs/upm-2.json");
    changes.iter().for_each(|(pointer, value)| set(&mut document, pointer, value.clone()));
    rig(&document).unwrap()
}

#[test]
fn a_rig_that_extends_another_equals_the_one_written_out() {
    let evening = written_out(&[
        ("/camera/levels", json!({"ground": 20, "plate": 190, "part": 40})),
        ("/camera/shading", json!(0.3)),
        ("/camera/shading_direction_deg", json!(115)),
        ("/friction/coefficient", json!(0.27)),
    ]);
    let knocked = written_out(&[("/simulation/knocks", json!({"every_s": 1.5, "push_mm": [0.6, 0.4]}))]);
    for (file, written_out) in [("rigs/upm-2-evening.json", evening), ("rigs/upm-2-knocked.json", knocked)] {
        let read = RigSpec::load(&shipped(file)).unwrap();
        assert_eq!((&read.document, &read.library), (&written_out.document, &written_out.library), "{file}");
        assert_eq!((&read.model, &read.sim), (&written_out.model, &written_out.sim), "{file}");
        assert_eq!(read.fingerprint, written_out.fingerprint, "{file}");
    }
}

#[test]
fn own_kinds_and_light_keep_the_library_and_another_plate_does_not() {
    let token = json!({"diameter_mm": 30, "mass_g": 8, "thickness_mm": 2.5});
    let mut cell = json!({"extends": "upm-2", "name": "my-cell", "kinds": {"token": token}});
    set(&mut cell, "/camera", json!({"levels": {"part": 55}}));
    let spec = rig(&cell).unwrap();
    assert_eq!((spec.model.name.as_str(), spec.document.camera.levels), ("my-cell", [12.0, 225.0, 55.0]));
    assert!(spec.kind("token").is_some());
    assert_eq!(rig_library(&spec).unwrap().rig, "upm-2");
    // what follows from the mass is that of the new mass
    set(&mut cell, "/plate", json!({"mass_kg": 2}));
    let heavy = rig(&cell).unwrap();
    assert_eq!(heavy.model.plate_inertia_kgm2, 2.0 * spec.model.plate_inertia_kgm2);
    let paths = |faults: Vec<Diagnostic>| faults.into_iter().map(|fault| fault.path).collect::<Vec<_>>();
    assert_eq!(paths(rig_library(&heavy).unwrap_err()), ["rig"]);
    set(&mut cell, "/name", json!("upm-2"));
    assert_eq!(paths(rig_library(&rig(&cell).unwrap()).unwrap_err()), ["fingerprint"]);
    set(&mut cell, "/fields", Value::Null);
    assert_eq!(rig(&cell).unwrap().model.fields, None);
}

#[test]
fn library_of_the_other_rig_is_found_from_another_folder() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    std::fs::create_dir(file("rigs")).unwrap();
    let mut base = value_of("rigs/upm-2.json");
    set(&mut base, "/library", json!("own.json"));
    std::fs::write(file("rigs/base.json"), base.to_string()).unwrap();
    std::fs::write(file("rigs/mid.json"), json!({"extends": "base", "name": "mid"}).to_string()).unwrap();
    std::fs::write(file("top.json"), json!({"extends": "rigs/mid.json", "name": "top"}).to_string()).unwrap();
    let top = RigSpec::load(&file("top.json")).unwrap();
    assert_eq!((top.library, top.document.library.as_deref()), (Some(file("rigs/own.json")), Some("rigs/own.json")));
    let mut job = value_of("arrange-2.json");
    set(&mut job, "/rig", json!("top.json"));
    let origin = Origin::of_file(&file("job.json"));
    let job = JobSpec::from_json(&job.to_string(), &origin, None).unwrap().effective();
    // the run folder has the whole rig
    assert!(job["rig"]["plate"].is_object() && job["rig"].get("extends").is_none(), "{job}");
}

#[test]
fn faults_carry_the_file_and_the_path_of_their_members() {
    let faults_of = |document: Value| lines(rig(&document).unwrap_err());
    let unknown = json!({"extends": "upm-2", "name": "a", "camera": {"levels": {"parts": 1}}});
    assert_eq!(
        faults_of(unknown),
        ["camera.levels.parts: expected one of ground, part, plate (did you mean part?), found unknown key \"parts\""]
    );
    let range = json!({"extends": "upm-2", "name": "a", "plate": {"damping_ratio": {"x": 7}}});
    assert!(faults_of(range)[0].starts_with("plate.damping_ratio.x: expected a number"));
    let half = json!({"extends": "upm-2", "name": "a", "kinds": {"token": {"mass_g": 8}}});
    let missing = faults_of(half);
    assert!(missing.len() == 2 && missing.iter().all(|fault| fault.starts_with("kinds.token.")), "{missing:?}");
    assert_eq!(faults_of(json!({"extends": 2, "name": "a"})), ["extends: expected a path, found 2"]);
    assert_eq!(faults_of(json!({"extends": "upm-2"})).len(), 1, "a name of its own");
    let gone = rig(&json!({"extends": "upm-3", "name": "a"})).unwrap_err()[0].to_string();
    assert!(gone.contains("test.json: extends: cannot read ") && gone.contains("upm-3.json: no such file"), "{gone}");
    let job = rig(&json!({"extends": "../arrange-4", "name": "a"})).unwrap_err()[0].to_string();
    assert!(job.contains("arrange-4.json: expected a rig, found a job"), "{job}");
    let text = json!({"extends": "upm-2", "name": "a"}).to_string();
    let sent = lines(RigSpec::from_json(&text, &Origin::of_request("rig")).unwrap_err());
    assert_eq!(sent, ["extends: expected nothing (files cannot be named here), found \"upm-2.json\""]);
}

#[test]
fn a_circle_and_a_long_chain_are_refused_with_their_files() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, base: &str| {
        let text = json!({"extends": base, "name": "a"}).to_string();
        std::fs::write(folder.path().join(name), text).unwrap();
    };
    write("a.json", "b");
    write("b.json", "./a.json");
    let fault = |path: &Path| RigSpec::load(path).unwrap_err()[0].to_string();
    let circle = fault(&folder.path().join("a.json"));
    assert!(circle.contains("b.json: extends: expected a rig that does not extend this one"), "{circle}");
    assert!(circle.ends_with("found a.json, which extends b.json, which extends a.json"), "{circle}");
    let strong = shipped("rigs/upm-2");
    (0..4).for_each(|k| {
        write(&format!("{k}.json"), &if k == 0 { strong.display().to_string() } else { (k - 1).to_string() })
    });
    assert_eq!(RigSpec::load(&folder.path().join("3.json")).map(|rig| rig.model.plate_mass_kg), Ok(1.0));
    write("4.json", "3");
    let long = fault(&folder.path().join("4.json"));
    assert!(long.contains("0.json: extends: expected 4 rigs at most, one through another"), "{long}");
}
