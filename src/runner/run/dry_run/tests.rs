use nalgebra::DMatrix;
use proptest::prelude::*;
use serde_json::{Value, json};

use super::*;
use crate::run::coverage::fixture::library;
use crate::run::testing::job_in_configs;
use upm_core::geometry::Twist;

#[test]
fn along_x_alone_nothing_goes_up() {
    let made = library([Twist::new(0.5, 0.0, 0.0), Twist::new(-0.3, 0.0, 0.0)]);
    let one = Independence::of_rotations(&made, &[Vec2::new(0.02, 0.03)]);
    let [first, second] = one.singular_values[..] else { panic!("{one:?}") };
    // two columns of length 1: each counts one metre of the fastest part
    assert!((first - 2f64.sqrt()).abs() < 1e-12 && second < 1e-7 && one.share() < 1e-7, "{one:?}");
    let (part, direction) = one.weakest.unwrap();
    assert!(part == 0 && direction.x.abs() < 1e-9 && (direction.y.abs() - 1.0).abs() < 1e-9, "{one:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn it_is_the_singular_value_decomposition(
        centers in proptest::collection::vec((-0.1..0.1f64, -0.1..0.1f64), 6..30),
        places in proptest::collection::vec((-0.09..0.09f64, -0.09..0.09f64), 1..6),
    ) {
        let made = library(centers.iter().map(|&(x, y)| Twist::about(Vec2::new(x, y), 20.0)));
        let places_m: Vec<Vec2> = places.iter().map(|&(x, y)| Vec2::new(x, y)).collect();
        let columns: Vec<Vec<f64>> = (0..made.entries.len())
            .map(|entry| {
                let steps: Vec<Vec2> = places_m.iter().map(|&p| made.displacement_at(entry, p, 0.2)).collect();
                let farthest = steps.iter().map(|step| step.norm()).fold(0.0, f64::max);
                steps.iter().flat_map(|step| [step.x / farthest, step.y / farthest]).collect()
            })
            .collect();
        prop_assume!(columns.iter().flatten().all(|x| x.is_finite()));
        let matrix = DMatrix::from_fn(2 * places_m.len(), columns.len(), |i, j| columns[j][i]);
        let found = Independence::of_rotations(&made, &places_m);
        let svd = matrix.svd(true, false);
        let (largest, count) = (svd.singular_values.max(), found.singular_values.len());
        prop_assert_eq!(count, 2 * places_m.len());
        for (k, value) in found.singular_values.iter().enumerate() {
            let expected = svd.singular_values.get(k).copied().unwrap_or(0.0);
            prop_assert!((value - expected).abs() < 1e-6 * largest, "{} {} {}", k, value, expected);
        }
    }
}

/// A job on a shipped rig.
fn job(parts: Value, task: Value) -> JobSpec {
    job_in_configs(&json!({"name": "made", "seed": 3, "rig": "rigs/upm-2.json", "parts": parts, "task": task}))
}

#[test]
fn parts_are_named_as_control_will_name_them() {
    let path = json!({"waypoints_mm": [[0, 0]], "speed_mm_s": 20});
    let elsewhere = |x: f64| json!({"waypoints_mm": [[x, 100]], "speed_mm_s": 20});
    let paths = json!([elsewhere(-100.0), elsewhere(-50.0), path, elsewhere(50.0), elsewhere(100.0)]);
    let parts = json!([{"kind": "penny", "count": 3}, {"kind": "penny", "position_mm": [10, 20]}, {"kind": "quarter"}]);
    let job = job(parts, json!({"type": "trajectories", "paths": paths}));
    let library = super::super::job_library(&job).unwrap();
    let RunSetup { params, placed, .. } = RunSetup::new(&job, &library).unwrap();
    let starts_m = named(&placed, &params);
    assert!(starts_m[0].x < starts_m[1].x && starts_m[1].x < starts_m[2].x, "{starts_m:?}");
    assert_eq!((starts_m[3], starts_m[4]), (placed[3].position_m, placed[4].position_m));
    let mut found: Vec<f64> = placed[..3].iter().map(|part| part.position_m.x).collect();
    found.sort_by(f64::total_cmp);
    assert_eq!(found, [starts_m[0].x, starts_m[1].x, starts_m[2].x]);
}
