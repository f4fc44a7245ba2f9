//! Jobs for many parts: the shipped ones, and ones refused with the numbers that conflict.

use serde_json::{Value, json};

use super::{job, lines, shipped};
use crate::config::{JobSpec, TaskSpec, place_parts};
use upm_core::random::Streams;

fn on_upm_2(parts: &Value, task: Value) -> Result<JobSpec, Vec<String>> {
    let document = json!({"name": "m", "rig": "rigs/upm-2.json", "parts": parts, "task": task});
    job(&document).map_err(lines)
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
