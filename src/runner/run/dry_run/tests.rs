use std::path::Path;

use nalgebra::DMatrix;
use proptest::prelude::*;
use serde_json::{Value, json};

use super::*;
use crate::config::Origin;
use crate::run::SelectionReason;
use crate::run::coverage::fixture::library;
use upm_control::RunEnd;
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

#[test]
fn flows_that_move_all_parts_alike_have_no_independence() {
    let made = library([Twist::new(0.5, 0.0, 0.0), Twist::new(0.0, 0.5, 0.0), Twist::new(0.4, 0.4, 0.0)]);
    let both = Independence::of_rotations(&made, &[Vec2::new(-0.05, 0.0), Vec2::new(0.05, 0.02)]);
    assert_eq!(both.singular_values.len(), 4);
    assert!(both.singular_values[1] > 1.0 && both.singular_values[2] < 1e-7, "{both:?}");
    let alone = Independence::of_rotations(&made, &[Vec2::new(-0.05, 0.0)]);
    assert!(alone.share() > 0.5, "{alone:?}");
    let none = Independence::of_rotations(&made, &[]);
    assert_eq!((none.singular_values.len(), none.weakest, none.share()), (0, None, 0.0));
    let dead = Independence::of_rotations(&library([Twist::new(0.0, 0.0, 0.0)]), &[Vec2::zeros()]);
    assert_eq!((dead.singular_values.clone(), dead.share()), (vec![0.0, 0.0], 0.0));
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
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("configs/job.json");
    let text = json!({"name": "made", "seed": 3, "rig": "rigs/upm-2.json", "parts": parts, "task": task});
    JobSpec::from_json(&text.to_string(), &Origin::of_file(&folder), None).unwrap()
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

#[test]
fn a_forecast_sums_up_its_dry_runs() {
    let nearest = |gap_m| Some(ClosestApproach { gap_m, parts: [0, 1], at_s: 1.0 });
    let met = |limit: &str, times| LimitMet { limit: limit.into(), times };
    let one = |ending: RunEnd, plate_time_s, gap_m, limits_met| DryRun {
        ending,
        plate_time_s,
        cycles: 1,
        pulses: 1,
        trails_m: Vec::new(),
        targets_m: Vec::new(),
        nearest: nearest(gap_m),
        limits_met,
        prediction_error_m: None,
        left_off: false,
        progress: 1.0,
        work_ms: 1.0,
    };
    let done = || RunEnd::completed("there");
    let planner = PlannerSelection {
        method: PlanningMethod::CorSequence,
        reason: SelectionReason::OnePart,
        alternatives: vec![],
    };
    let mut forecast = Forecast {
        planner,
        half_side_m: 0.1,
        parts: Vec::new(),
        independence: Independence { singular_values: Vec::new(), weakest: None },
        fields: false,
        speed_mps: None,
        dry_runs: vec![
            one(done(), 9.0, 0.003, vec![met("a", 2), met("b", 1)]),
            one(done(), 4.0, 0.001, vec![]),
            one(done(), 5.0, 0.002, vec![met("b", 3)]),
        ],
        friction_spread: 0.0,
    };
    let time = |dry_run: &DryRun| dry_run.plate_time_s;
    assert_eq!(forecast.verdict(), PlanVerdict::CanBeDone);
    assert_eq!(forecast.range(time), Some([4.0, 5.0, 9.0]));
    assert_eq!(forecast.nearest(), nearest(0.001));
    assert_eq!(forecast.limits_met(), [met("b", 4), met("a", 2)]);
    forecast.dry_runs[2].ending = RunEnd::failed("stalled");
    assert_eq!(forecast.verdict(), PlanVerdict::Likely);
    assert_eq!(forecast.endings(), [("stalled", 1), ("there", 2)]);
    assert_eq!(forecast.range(time), Some([4.0, 6.5, 9.0]));
    forecast.dry_runs[1].ending = RunEnd::failed("stalled");
    assert_eq!(forecast.verdict(), PlanVerdict::Unlikely);
    forecast.dry_runs[0].left_off = true;
    assert_eq!((forecast.verdict(), forecast.decided()), (PlanVerdict::Unlikely, 3), "left off at its end");
    for dry_run in &mut forecast.dry_runs {
        dry_run.ending = RunEnd::failed("left off");
    }
    assert_eq!((forecast.verdict(), forecast.decided()), (PlanVerdict::CannotBeDone, 2));
    assert!(forecast.verdict().is_failure());
    forecast.dry_runs.iter_mut().for_each(|dry_run| dry_run.left_off = true);
    assert_eq!((forecast.verdict(), forecast.verdict().is_failure()), (PlanVerdict::Undecided, false));
    forecast.dry_runs.clear();
    assert_eq!(forecast.range(time), None);
}

#[test]
fn number_of_dry_runs_follows_from_the_work_of_those_done() {
    assert_eq!(affordable(0.0, 1), DRY_RUNS, "no work at all");
    assert_eq!(affordable(100.0, 1), DRY_RUNS);
    assert_eq!(affordable(WORK_MS / 2.5, 1), 2, "another may take 1.3 times as long, two may not");
    assert_eq!(affordable(WORK_MS / 2.0, 1), 1);
    assert_eq!(affordable(2.0 * WORK_MS, 1), 1);
    assert_eq!(affordable(0.75 * WORK_MS, 3), 3);
}
