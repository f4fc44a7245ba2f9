use serde_json::{Value, json};

use super::{lines, set, shipped, text_of, value_of};
use crate::config::{DaemonSpec, JobSpec, Origin, RigSpec};
use upm_core::job::Pace;

fn daemon(document: &Value) -> Result<DaemonSpec, Vec<String>> {
    DaemonSpec::from_json(&document.to_string(), &Origin::of_file(&shipped("test.json"))).map_err(lines)
}

/// The faults of the shipped file with one value changed.
fn changed(pointer: &str, value: Value) -> Vec<String> {
    let mut document = value_of("daemon.json");
    set(&mut document, pointer, value);
    daemon(&document).unwrap_err()
}

#[test]
fn the_shipped_daemon_has_three_plates_each_with_its_library() {
    let spec = DaemonSpec::load(&shipped("daemon.json")).unwrap();
    assert_eq!(spec.plate_names(), ["upm-1", "upm-2", "upm-2-evening"]);
    assert_eq!((spec.listen.to_string().as_str(), spec.pace), ("127.0.0.1:8750", Pace::RealTime));
    assert!(spec.plates.iter().all(|plate| plate.library.exists()));
    assert_eq!(spec.default_plate.as_deref(), Some("upm-2"));
    let [strong, evening] = ["upm-2", "upm-2-evening"].map(|name| spec.plate(name).unwrap());
    // one library serves both: they differ only in light and friction
    assert_eq!(strong.rig.fingerprint, evening.rig.fingerprint);
    assert_eq!(strong.rig.model.name, evening.rig.model.name);
    assert_ne!(strong.rig.document.friction, evening.rig.document.friction);
    assert_ne!(strong.rig.document.camera.levels, evening.rig.document.camera.levels);
}

#[test]
fn defaults_are_those_of_the_shipped_file() {
    let least = json!({"plates": [{"name": "only", "rig": "rigs/upm-2.json"}]});
    let spec = daemon(&least).unwrap();
    let shipped = DaemonSpec::load(&shipped("daemon.json")).unwrap();
    assert_eq!(spec.default_plate.as_deref(), Some("only"));
    assert_eq!((&spec.keep, &spec.watchdog, spec.queue), (&shipped.keep, &shipped.watchdog, shipped.queue));
    assert_eq!((spec.min_free_bytes, &spec.rerun), (500_000_000, &None));
    assert_eq!(spec.listen, shipped.listen);
    let mut two = least;
    two["plates"].as_array_mut().unwrap().push(json!({"name": "other", "rig": "rigs/upm-2.json"}));
    set(&mut two, "/rerun", json!("connect=rerun+http://10.0.0.2:9876/proxy"));
    let spec = daemon(&two).unwrap();
    let url = "rerun+http://10.0.0.2:9876/proxy".to_owned();
    assert_eq!((spec.default_plate, spec.rerun), (None, Some(upm_recording::RerunMode::Connect { url: Some(url) })));
}

#[test]
fn every_fault_is_reported_with_its_path() {
    let rig = value_of("rigs/upm-2.json");
    let mut inline = rig.clone();
    inline.as_object_mut().unwrap().remove("library");
    let document = json!({
        "listen": "localhost:8750",
        "plates": [
            {"name": "..", "rig": "rigs/upm-9.json"},
            {"name": "a", "rig": inline},
            {"name": "A", "rig": "rigs/upm-2.json"},
        ],
        "default_plate": "b",
        "hosts": ["lab.example.org", "lab:80", "http://x", ""],
        "stop_listen": "8751",
        "rerun": "spawn",
    });
    let wanted = "listen: expected an IP address and a port like 127.0.0.1:8750 or [::1]:8750, found \"localhost:8750\"
stop_listen: expected an IP address and a port like 127.0.0.1:8750 or [::1]:8750, found \"8751\"
plates[0].name: expected 1 to 64 letters, digits, `.`, `_`, `-`, the first neither `.` nor `-`, all ASCII, found \"..\"
$: expected a file that can be read, found no such file (did you mean RIGS/upm-1.json?)
plates[1].library: expected a path (rig upm-2 names no library), found nothing
plates[2].name: expected a name that no plate before has, found \"A\"
default_plate: expected one of .., a, A (did you mean a?), found \"b\"
hosts[1]: expected a host name or IP address without a port like lab.example.org, found \"lab:80\"
hosts[2]: expected a host name or IP address without a port like lab.example.org, found \"http://x\"
hosts[3]: expected a host name or IP address without a port like lab.example.org, found \"\"
rerun: expected one of off, save, connect, connect=URL, found \"spawn\"";
    let rigs = shipped("rigs").display().to_string();
    assert_eq!(daemon(&document).unwrap_err().join("\n"), wanted.replace("RIGS", &rigs));
}

#[test]
fn a_request_may_not_bring_a_daemon_that_names_files() {
    let faults = DaemonSpec::from_json(&text_of("daemon.json"), &Origin::of_request("daemon")).unwrap_err();
    assert!(faults.iter().all(|fault| fault.expected.contains("files cannot be named here")), "{faults:?}");
    assert_eq!(faults.len(), 4);
}

#[test]
fn job_may_repeat_its_plates_rig_but_name_no_other() {
    let spec = DaemonSpec::load(&shipped("daemon.json")).unwrap();
    let strong = &spec.plate("upm-2").unwrap().rig;
    let origin = Origin::of_request("job");
    let job = |rig: Value| {
        let mut document = value_of("arrange-2.json");
        set(&mut document, "/rig", rig);
        set(&mut document, "/plate", json!("upm-2"));
        JobSpec::from_json(&document.to_string(), &origin, Some(strong)).map_err(lines)
    };
    // as in the file, with its defaults left out and naming a library; and with all written out
    for rig in [value_of("rigs/upm-2.json"), serde_json::to_value(&strong.document).unwrap()] {
        let made = job(rig).unwrap();
        assert_eq!((&made.rig, made.library.is_some()), (strong, true));
    }
    let evening = &spec.plate("upm-2-evening").unwrap().rig.document;
    assert_eq!(
        job(json!(evening)).unwrap_err(),
        ["rig: expected the rig of plate upm-2, or nothing, found another rig"]
    );
    let mut nearly = value_of("rigs/upm-2.json");
    set(&mut nearly, "/plate/mass_kg", json!(1.000_000_000_000_000_2));
    assert_eq!(job(nearly).unwrap_err().len(), 1);
    let named = job(json!("rigs/upm-2.json")).unwrap_err();
    assert!(named[0].contains("files cannot be named here"), "{named:?}");
}

#[test]
fn knocks_of_a_job_are_those_of_its_plate() {
    let quiet = RigSpec::load(&shipped("rigs/upm-2.json")).unwrap();
    let knocked = RigSpec::load(&shipped("rigs/upm-2-knocked.json")).unwrap();
    let job = |plate_rig: &RigSpec, rig: &RigSpec| {
        let mut document = value_of("hold-4.json");
        set(&mut document, "/rig", serde_json::to_value(&rig.document).unwrap());
        JobSpec::from_json(&document.to_string(), &Origin::of_request("job"), Some(plate_rig)).map_err(lines)
    };
    for rig in [&quiet, &knocked] {
        assert_eq!(job(&knocked, rig).unwrap().rig, knocked, "a rig without knocks leaves them to the plate");
    }
    assert_eq!(job(&quiet, &quiet).unwrap().rig, quiet);
    let refused = job(&quiet, &knocked).unwrap_err();
    assert_eq!(refused, ["rig: expected the rig of the plate, or nothing, found another rig"]);
}

#[test]
fn shipped_plate_has_an_endless_standing_job_that_starts_running() {
    let spec = DaemonSpec::load(&shipped("daemon.json")).unwrap();
    let standing: Vec<_> = spec.plates.iter().map(|plate| plate.standing.as_ref()).collect();
    let [Some(plus_sign), None, None] = standing[..] else { panic!("{standing:?}") };
    assert_eq!((plus_sign.job.name.as_str(), plus_sign.starts_paused), ("plus-sign-endless", false));
    assert!(plus_sign.job.is_endless() && plus_sign.job.rig == spec.plates[0].rig);
    assert_eq!(spec.keep.standing_runs, 8);
    let mut paused = value_of("daemon.json");
    set(&mut paused, "/plates/0/standing_job/start", json!("paused"));
    assert!(daemon(&paused).unwrap().plates[0].standing.as_ref().unwrap().starts_paused);
}

#[test]
fn invalid_standing_job_is_reported_in_one_line_with_its_path() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("job.json");
    let with = |pointer: &str, value: Value| {
        let mut job = value_of("plus-sign-endless.json");
        set(&mut job, "/rig", json!(shipped("rigs/upm-1.json")));
        set(&mut job, pointer, value);
        std::fs::write(&file, job.to_string()).unwrap();
        changed("/plates/0/standing_job/job", json!(file))
    };
    for (pointer, value, expected) in [
        (
            "/rig",
            json!(shipped("rigs/upm-2.json")),
            "rig: expected the rig of plate upm-1, or nothing, found another rig",
        ),
        (
            "/plate",
            json!("upm-2"),
            "plate: expected upm-1 or nothing (it is the standing job of that plate), found \"upm-2\"",
        ),
        ("/library", json!("x.json"), "library: expected nothing (plate upm-1 has its library), found a library"),
        ("/task/laps", json!(-1), "task.laps: expected a whole number from 0 to 1000000, found -1"),
        (
            "/parts/0/kind",
            json!("pennyy"),
            "parts[0].kind: expected one of penny, nickel, dime, quarter (did you mean penny?), found \"pennyy\"",
        ),
    ] {
        assert_eq!(with(pointer, value), [expected], "{pointer}");
    }
    let gone = changed("/plates/0/standing_job/job", json!("gone.json"));
    assert!(matches!(&gone[..], [line] if line.starts_with("$: expected a file that can be read")), "{gone:?}");
}
