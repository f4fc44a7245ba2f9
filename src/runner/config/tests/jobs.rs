use proptest::prelude::*;
use serde_json::{Value, json};

use super::{job, lines, origin, set, shipped, value_of};
use crate::config::{JobSpec, LibraryRef, TaskSpec, schema, schema_names};

#[test]
fn defaults_are_as_documented() {
    let document =
        json!({"name": "a", "rig": "rigs/upm-1.json", "parts": [{"kind": "dime"}], "task": {"type": "plus_sign"}});
    let spec = job(&document).unwrap();
    assert_eq!(spec.task, TaskSpec::PlusSign { laps: 1, edge_margin_m: 0.005, corridor_m: 0.5e-3 });
    assert_eq!((spec.seed(), spec.tolerance_m, spec.plate_time_limit_s), (1, 0.0005, 600.0));
    let effective = spec.effective();
    for (pointer, value) in [
        ("/seed", json!(1)),
        ("/parts/0/count", json!(1)),
        ("/task/laps", json!(1)),
        ("/planner", json!("auto")),
        ("/limits/plate_time_s", json!(600.0)),
        ("/deadlines", json!("relaxed")),
        ("/rig/motors/low_pass_hz", json!(1000.0)),
    ] {
        assert_eq!(effective.pointer(pointer), Some(&value), "{pointer}");
    }
}

#[test]
fn endless_job_is_detected_by_task_and_limit() {
    let path = |repeat: u32| json!({"waypoints_mm": [[0, 0], [20, 0]], "speed_mm_s": 10, "repeat": repeat});
    let is_endless = |task: Value| {
        let mut document = value_of("plus-sign.json");
        set(&mut document, "/task", task);
        set(&mut document, "/limits/plate_time_s", json!(60));
        job(&document).unwrap().is_endless()
    };
    for (task, endless) in [
        (json!({"type": "plus_sign", "laps": 0}), true),
        (json!({"type": "plus_sign", "laps": 2}), false),
        (json!({"type": "trajectories", "paths": [path(0)]}), true),
        (json!({"type": "trajectories", "paths": [path(3)]}), false),
        (json!({"type": "hold"}), true),
        (json!({"type": "hold", "duration_s": 0}), true),
        (json!({"type": "hold", "duration_s": 60}), true),
        (json!({"type": "hold", "duration_s": 59.9}), false),
        (json!({"type": "arrange", "targets_mm": [[0, 0]]}), false),
    ] {
        assert_eq!(is_endless(task.clone()), endless, "{task}");
    }
}

#[test]
fn schemas_describe_every_key() {
    fn undescribed(schema: &Value, at: &str, found: &mut Vec<String>) {
        for (key, member) in schema.get("properties").and_then(Value::as_object).into_iter().flatten() {
            if member.get("description").is_none() && member.get("const").is_none() {
                found.push(format!("{at}.{key}"));
            }
        }
        for (key, value) in schema.as_object().into_iter().flatten() {
            undescribed(value, &format!("{at}.{key}"), found);
        }
        for (i, value) in schema.as_array().into_iter().flatten().enumerate() {
            undescribed(value, &format!("{at}.{i}"), found);
        }
    }
    for name in schema_names() {
        let schema = schema(name).unwrap();
        assert_eq!(schema["title"], json!(name));
        let mut found = Vec::new();
        undescribed(&schema, name, &mut found);
        assert!(found.is_empty(), "{found:?}");
    }
    assert_eq!(schema("daemons"), None);
}

#[test]
fn a_job_from_another_folder_keeps_its_library() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("rigs")).unwrap();
    std::fs::copy(shipped("rigs/upm-1.json"), folder.path().join("rigs/upm-1.json")).unwrap();
    let path = folder.path().join("job.json");
    std::fs::copy(shipped("plus-sign.json"), &path).unwrap();
    let spec = JobSpec::load(&path).unwrap();
    let expected = folder.path().join("rigs").join("../../assets/libraries/upm-1.json");
    assert_eq!(spec.library, Some(LibraryRef::File(expected)));
    assert_eq!(spec.effective()["rig"]["library"], json!("rigs/../../assets/libraries/upm-1.json"));
    std::fs::write(&path, spec.effective().to_string()).unwrap();
    assert_eq!(JobSpec::load(&path).unwrap().effective(), spec.effective());
}

#[test]
fn a_run_folder_needs_no_other_file() {
    let spec = JobSpec::load(&shipped("plus-sign.json")).unwrap().with_seed(99);
    let mut whole = spec.effective();
    whole["library"] = value_of("../assets/libraries/upm-1.json");
    let again =
        JobSpec::from_json(&whole.to_string(), &super::super::Origin::of_file("run/effective.json".as_ref()), None)
            .unwrap();
    assert_eq!(again.seed(), 99);
    assert!(matches!(&again.library, Some(LibraryRef::Inline(library)) if library["rig"] == "upm-1"));
    assert_eq!((again.rig.model, again.task), (spec.rig.model, spec.task));
    whole["library"]["entries"] = json!([]);
    let line = "library.entries: expected a list of 3 or more items (an object each), found a list of 0";
    assert_eq!(lines(job(&whole).unwrap_err()), [line]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn effective_is_the_same_job_again(
        seed in any::<u64>(),
        tolerance_um in 1..5000_u32,
        mass_g in 100..5000_u32,
        places in proptest::collection::vec((-900..900_i32, -900..900_i32), 1..5),
        task in 0..5_usize,
    ) {
        let parts: Vec<Value> = (places.iter().zip(0..))
            .map(|(&(x, y), i)| json!({"kind": "penny", "position_mm": [f64::from(x) / 50.0 - 100.0 + 60.0 * f64::from(i), f64::from(y) / 10.0]}))
            .collect();
        let targets: Vec<Value> = parts.iter().map(|part| part["position_mm"].clone()).collect();
        let paths: Vec<Value> = (targets.iter().zip(0..))
            .map(|(at, i)| json!({"waypoints_mm": [at, [25.1 * f64::from(i), 0.7]], "speed_mm_s": 12.3}))
            .collect();
        let task = [
            json!({"type": "arrange", "targets_mm": targets}),
            json!({"type": "arrange", "targets_mm": targets, "assignment": "fixed"}),
            json!({"type": "trajectories", "paths": paths}),
            json!({"type": "hold", "duration_s": 3.3}),
            json!({"type": "sort", "bins": [{"kinds": ["penny", "dime"], "region_mm": {"min": [-100, -100], "max": [0, 3.5]}}]}),
        ][task].clone();
        let mut rig = value_of("rigs/upm-2.json");
        set(&mut rig, "/plate/mass_kg", json!(f64::from(mass_g) / 1000.0));
        set(&mut rig, "/camera/full_well_e", Value::Null);
        let document = json!({
            "name": "p", "seed": seed, "rig": rig, "parts": parts, "task": task, "tolerance_mm": f64::from(tolerance_um) / 1000.0
        });
        let spec = job(&document).unwrap();
        let text = serde_json::to_string_pretty(&spec.effective()).unwrap();
        let again = JobSpec::from_json(&text, &origin(), None).unwrap();
        prop_assert_eq!(&again, &spec);
        prop_assert_eq!(again.effective(), spec.effective());
    }
}

#[test]
fn tasks_of_a_list_are_refused_where_they_cannot_follow_each_other() {
    let made = |change: Value| {
        let mut document = json!({
            "name": "made", "rig": "rigs/upm-2.json", "parts": [{"kind": "penny", "count": 2}],
            "tasks": [{"type": "arrange", "targets_mm": [[-40, 0], [40, 0]]}, {"type": "hold", "duration_s": 1}],
        });
        document.as_object_mut().unwrap().extend(change.as_object().unwrap().clone());
        job(&document).map(|job| job.each_task().map(|task| task.name()).collect::<Vec<_>>()).map_err(lines)
    };
    assert_eq!(made(json!({"repeat": 0})), Ok(vec!["arrange", "hold"]));
    let hold = json!({"type": "hold"});
    for (change, refused) in [
        (json!({"tasks": null}), "task: expected exactly one of task and tasks, found none"),
        (json!({"task": hold}), "task: expected exactly one of task and tasks, found task and tasks"),
        (json!({"tasks": null, "task": hold, "repeat": 2}), "repeat: expected 1 without tasks, found 2"),
        (
            json!({"tasks": [hold, hold]}),
            "tasks[0]: expected one that ends, since another follows it, found a task without end",
        ),
        (
            json!({"tasks": [hold], "repeat": 2}),
            "tasks[0]: expected one that ends, since another follows it, found a task without end",
        ),
        (
            json!({"tasks": [{"type": "hold", "duration_s": 1}, {"type": "plus_sign"}]}),
            "parts: expected exactly one part for plus_sign, found 2 parts",
        ),
        (
            json!({"tasks": [{"type": "arrange", "targets_mm": [[0, 0], [0, 19]]}]}),
            "tasks[0].targets_mm[1]: expected 21.050 mm or more (both radii and 2.000 mm between the rims), found \
             19.000 mm from tasks[0].targets_mm[0]",
        ),
    ] {
        assert_eq!(made(change), Err(vec![refused.to_owned()]));
    }
}
