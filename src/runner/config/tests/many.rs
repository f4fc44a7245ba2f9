//! Jobs for many parts: the shipped ones, and ones refused with the numbers that conflict.

use serde_json::{Value, json};

use super::{job, lines, shipped, value_of};
use crate::config::{JobSpec, TaskSpec, place_parts};
use upm_core::random::Streams;

fn on_upm_2(parts: &Value, task: Value) -> Result<JobSpec, Vec<String>> {
    let document = json!({"name": "m", "rig": "rigs/upm-2.json", "parts": parts, "task": task});
    job(&document).map_err(lines)
}

fn pennies(count: usize) -> Value {
    json!([{"kind": "penny", "count": count}])
}

fn arrange(parts: &Value, targets_mm: Value) -> Result<JobSpec, Vec<String>> {
    on_upm_2(parts, json!({"type": "arrange", "targets_mm": targets_mm}))
}

fn bin(kinds: &[&str], min: [f64; 2], max: [f64; 2]) -> Value {
    json!({"kinds": kinds, "region_mm": {"min": min, "max": max}})
}

fn sort(parts: &Value, bins: &[Value]) -> Result<JobSpec, Vec<String>> {
    on_upm_2(parts, json!({"type": "sort", "bins": bins}))
}

fn path(waypoints_mm: &[[f64; 2]], speed_mm_s: f64, repeat: u32) -> Value {
    json!({"waypoints_mm": waypoints_mm, "speed_mm_s": speed_mm_s, "repeat": repeat})
}

fn follow(paths: &[Value], in_phase: bool) -> Result<JobSpec, Vec<String>> {
    on_upm_2(&pennies(paths.len()), json!({"type": "trajectories", "paths": paths, "in_phase": in_phase}))
}

#[test]
fn thousands_of_parts_are_refused_before_their_paths_are_compared() {
    let groups = json!(vec![json!({"kind": "penny", "count": 64}); 64]);
    let circle = json!({"circle": {"radius_mm": 5}, "count": 64, "speed_mm_s": 5});
    let task = json!({"type": "trajectories", "in_phase": true, "paths": vec![circle; 64]});
    let only = ["parts: expected up to 64 in all, found 4096 parts"];
    assert_eq!(on_upm_2(&groups, task).unwrap_err(), only);
    let line = json!({"line": {"from_mm": [-100, 0], "to_mm": [100, 0]}});
    assert_eq!(on_upm_2(&groups, json!({"type": "arrange", "targets": line})).unwrap_err(), only);
}

#[test]
fn corner_off_the_plate_is_named_once_for_all_parts_on_its_path() {
    let corners = [[-100, -100], [-100, 0], [-100, 100], [100, 100], [200, 0], [100, -100]];
    let path = json!({"waypoints_mm": corners, "count": 2, "speed_mm_s": 8});
    let faults = on_upm_2(&pennies(2), json!({"type": "trajectories", "paths": [path], "in_phase": true})).unwrap_err();
    assert_eq!(faults.len(), 1, "{faults:?}");
    assert!(faults[0].starts_with("task.paths[0].waypoints_mm[4][0]: expected from -141.875 to 141.875"), "{faults:?}");
}

#[test]
fn laps_without_length_are_refused_in_phase() {
    let places = [path(&[[-40.0, 0.0]], 8.0, 0), path(&[[40.0, 0.0]], 8.0, 0)];
    let faults = follow(&places, true).unwrap_err();
    assert_eq!(faults, ["task.paths[0].waypoints_mm: expected a lap above 0 mm (in_phase), found a lap of 0 mm"]);
    assert!(follow(&places, false).is_ok());
}

#[test]
fn every_shipped_job_is_valid_and_its_parts_find_room() {
    let mut names: Vec<String> = Vec::new();
    for entry in std::fs::read_dir(shipped("")).unwrap() {
        let path = entry.unwrap().path();
        let is_job = path.file_name().is_some_and(|name| !name.to_string_lossy().starts_with("daemon"));
        if is_job && path.extension().is_some_and(|extension| extension == "json") {
            let spec = JobSpec::load(&path).unwrap_or_else(|faults| panic!("{faults:?}"));
            assert_eq!(Some(spec.name.as_str()), path.file_stem().and_then(|stem| stem.to_str()));
            for seed in 1..=20 {
                place_parts(&spec, Streams::new(seed)).unwrap();
            }
            names.push(spec.name);
        }
    }
    for name in
        "arrange-2 arrange-4 arrange-8 arrange-16 arrange-24 sort-8 sort-12 swap-2 ring-6 bowtie-3 hold-4 line-10 letters-16 ballet-8 circle-turns".split(' ')
    {
        assert!(names.iter().any(|other| other == name), "{name}");
    }
}

#[test]
fn the_bowtie_is_a_lemniscate_with_its_parts_a_third_apart() {
    let spec = JobSpec::load(&shipped("bowtie-3.json")).unwrap();
    let TaskSpec::Trajectories { paths, in_phase: true, .. } = spec.task else { panic!("{:?}", spec.task) };
    for (path, third) in paths.iter().zip(0..) {
        assert_eq!(path.waypoints_m.len(), 60);
        for (k, p) in path.waypoints_m.iter().enumerate() {
            // x⁴ = a² (x² - y²)
            let (a, x, y) = (0.06, p.x, p.y);
            assert!((x.powi(4) - a * a * (x * x - y * y)).abs() < 1e-5 * a * a * a, "{p}");
            assert_eq!(paths[0].waypoints_m[(k + 20 * third) % 60], *p);
        }
    }
}

#[test]
fn targets_and_parts_go_one_to_one() {
    let three = json!([[0, 0], [40, 0], [80, 0]]);
    assert_eq!(
        arrange(&pennies(2), three.clone()).unwrap_err(),
        ["task.targets_mm: expected 2, one for each part, found 3 targets"]
    );
    assert_eq!(
        arrange(&pennies(4), three.clone()).unwrap_err(),
        ["task.targets_mm: expected 4, one for each part, found 3 targets"]
    );
    assert!(arrange(&pennies(3), three).is_ok());
}

#[test]
fn targets_must_be_as_far_apart_as_parts_need() {
    let mixed = json!([{"kind": "penny"}, {"kind": "quarter"}]);
    // (19.05 + 24.26) / 2 + 2 = 23.655
    assert_eq!(
        arrange(&mixed, json!([[0, 0], [0, 22.6]])).unwrap_err(),
        [
            "task.targets_mm[1]: expected 23.655 mm or more (both radii and 2.000 mm between the rims), found 22.600 mm from task.targets_mm[0]"
        ]
    );
    assert!(arrange(&mixed, json!([[0, 0], [0, 23.66]])).is_ok());
    let fixed = json!({"type": "arrange", "targets_mm": [[0, 0], [0, 30]], "assignment": "fixed"});
    assert!(on_upm_2(&mixed, fixed).is_ok());
}

#[test]
fn targets_must_be_where_the_planner_takes_parts() {
    // 152.4 - 9.525 - 1 = 141.875
    let line = |found: &str| {
        format!(
            "task.targets_mm[0][1]: expected from -141.875 to 141.875 (the whole part on the plate, 1.000 mm inside its edge), found {found}"
        )
    };
    assert_eq!(arrange(&pennies(1), json!([[0, 142]])).unwrap_err(), [line("142.000")]);
    assert_eq!(arrange(&pennies(1), json!([[0, -500]])).unwrap_err(), [line("-500.000")]);
    assert!(arrange(&pennies(1), json!([[-141.875, 141.875]])).is_ok());
}

#[test]
fn bins_have_room_for_their_parts() {
    let six = json!([{"kind": "penny", "count": 3}, {"kind": "quarter", "count": 3}]);
    let (kinds, corner) = (["penny", "quarter"], [0.0, 0.0]);
    // two rows of three quarters: 3 · 24.26 + 2 · 2 + 2 · 1 = 78.78
    let (wide, high) = (78.78, 52.52);
    assert!(sort(&six, &[bin(&kinds, corner, [wide, high])]).is_ok());
    assert_eq!(
        sort(&six, &[bin(&kinds, corner, [wide - 0.01, high])]).unwrap_err(),
        [
            "task.bins[0].region_mm: expected room for 6, the parts of its kinds (with 2.000 mm between rims, 1.000 mm to the border and 1.000 mm to the plate's edge), found 78.770 x 52.520 mm with room for 4 of 24.260 mm"
        ]
    );
    assert!(sort(&six, &[bin(&["penny"], corner, [64.0, 22.0]), bin(&["quarter"], [0.0, 30.0], [79.0, 57.0])]).is_ok());
    let faults = sort(&pennies(1), &[bin(&["penny"], [132.4, 0.0], [152.4, 20.1])]).unwrap_err();
    assert!(faults[0].contains("20.000 x 20.100 mm with room for 0 of 19.050 mm"), "{faults:?}");
    assert_eq!(
        sort(&pennies(1), &[bin(&["penny"], [60.0, 0.0], [0.0, 60.0])]).unwrap_err(),
        ["task.bins[0].region_mm: expected min below max along x and y, found [60.000, 0.000] to [0.000, 60.000]"]
    );
}

#[test]
fn bins_do_not_overlap() {
    let (left, right) = (bin(&["penny"], [-60.0, 0.0], [0.0, 60.0]), bin(&["dime"], [-10.0, 50.0], [50.0, 100.0]));
    assert_eq!(
        sort(&pennies(2), &[left.clone(), right]).unwrap_err(),
        [
            "task.bins[1].region_mm: expected bins that do not overlap, found [-10.000, 50.000] to [50.000, 100.000] over task.bins[0], [-60.000, 0.000] to [0.000, 60.000]"
        ]
    );
    let beside = bin(&["dime"], [0.0, 0.0], [60.0, 60.0]);
    assert!(sort(&pennies(2), &[left, beside]).is_ok(), "a common border, and a bin without parts");
}

#[test]
fn every_kind_has_one_bin() {
    let mixed = json!([{"kind": "penny", "count": 2}, {"kind": "dime", "count": 3}]);
    let (here, there) = ([[-60.0, 0.0], [0.0, 60.0]], [[0.0, 0.0], [70.0, 60.0]]);
    let bins = |one: &[&str], two: &[&str]| [bin(one, here[0], here[1]), bin(two, there[0], there[1])];
    assert_eq!(
        sort(&mixed, &bins(&["penny"], &["quarter"])).unwrap_err(),
        ["task.bins: expected a bin for every kind of part, found no bin for dime, 3 of them on the plate"]
    );
    let twice = "task.bins[1].kinds[1]: expected each kind in one bin, found \"penny\" a second time";
    assert_eq!(sort(&mixed, &bins(&["penny"], &["dime", "penny"])).unwrap_err(), [twice]);
    let twice = "task.bins[1].kinds[1]: expected each kind in one bin, found \"dime\" a second time";
    assert_eq!(sort(&mixed, &bins(&["penny"], &["dime", "dime"])).unwrap_err(), [twice]);
}

#[test]
fn paths_start_and_end_apart() {
    let one = path(&[[0.0, 0.0], [60.0, 0.0]], 8.0, 1);
    let expected = "expected 21.050 mm or more (both radii and 2.000 mm between the rims)";
    assert_eq!(
        follow(&[one.clone(), path(&[[0.0, 20.0], [60.0, 30.0]], 8.0, 1)], false).unwrap_err(),
        [format!("task.paths[1].waypoints_mm[0]: {expected}, found 20.000 mm from task.paths[0].waypoints_mm[0]")]
    );
    assert_eq!(
        follow(&[one.clone(), path(&[[0.0, 30.0], [20.0, 9.0], [60.0, 12.0]], 9.0, 3)], false).unwrap_err(),
        [format!("task.paths[1].waypoints_mm[2]: {expected}, found 12.000 mm from task.paths[0].waypoints_mm[1]")]
    );
    assert!(follow(&[one, path(&[[0.0, 30.0], [60.0, 12.0]], 8.0, 0)], false).is_ok(), "it never ends");
}

#[test]
fn paths_in_phase_are_equally_long_and_fast() {
    let there = path(&[[-50.0, 0.0], [50.0, 0.0]], 8.0, 2);
    let beside = |x: f64, speed, repeat| path(&[[-50.0, 40.0], [x, 40.0]], speed, repeat);
    assert!(follow(&[there.clone(), beside(50.9, 8.0, 2)], true).is_ok(), "0.9 % longer");
    assert!(follow(&[there.clone(), beside(30.0, 5.0, 9)], false).is_ok(), "out of phase anything goes");
    assert_eq!(
        follow(&[there.clone(), beside(51.1, 8.0, 2)], true).unwrap_err(),
        [
            "task.paths[1].waypoints_mm: expected 200.000 mm within 1 % (that of task.paths[0], in_phase), found a lap of 202.200 mm"
        ]
    );
    assert_eq!(
        follow(&[there.clone(), beside(50.0, 8.5, 3)], true).unwrap_err(),
        [
            "task.paths[1].speed_mm_s: expected 8 (that of task.paths[0], in_phase), found 8.5",
            "task.paths[1].repeat: expected 2 (that of task.paths[0], in_phase), found 3"
        ]
    );
    // in phase they meet half-way along the first side, 10 mm apart
    let towards = path(&[[50.0, 10.0], [-50.0, 10.0]], 8.0, 2);
    assert!(follow(&[there.clone(), towards.clone()], false).is_ok(), "out of phase they may wait for each other");
    assert_eq!(
        follow(&[there, towards], true).unwrap_err(),
        [
            "task.paths[1].waypoints_mm: expected 21.050 mm or more (both radii and 2.000 mm between the rims), found 10.000 mm from the part of task.paths[0] at 25.0 % of the lap"
        ]
    );
}

#[test]
fn in_phase_is_off_unless_asked_for() {
    let spec = job(&value_of("trajectories.json")).unwrap();
    assert!(matches!(spec.task, TaskSpec::Trajectories { in_phase: false, .. }));
    assert_eq!(spec.effective().pointer("/task/in_phase"), Some(&json!(false)));
}
