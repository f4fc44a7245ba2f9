//! Closed-loop tests with rotations: joint motions of all parts cost little.

use std::sync::Arc;

use super::*;
use crate::task::Effort;
use crate::task::multi_disc::MultiDiscProblem;
use crate::task::turns::{RigidMotionProblem, RigidRotation};

/// Toy effort: a shift of all parts costs little, any other motion much, and more the further out.
#[derive(Debug)]
pub struct Toy;

impl Effort for Toy {
    fn squared(&self, places_m: &[Vec2], steps_m: &[Vec2], slopes: Option<(&mut [Vec2], &mut [Vec2])>) -> f64 {
        const TOGETHER: f64 = 1e3;
        const APART: f64 = 1e5;
        const OUT_M: f64 = 0.1;
        let mean = steps_m.iter().sum::<Vec2>() / steps_m.len().max(1) as f64;
        let dear = |place: &Vec2| APART * (1.0 + place.norm_squared() / (OUT_M * OUT_M));
        let apart = places_m.iter().zip(steps_m).map(|(place, step)| dear(place) * (step - mean).norm_squared());
        let cost = apart.sum::<f64>() + TOGETHER * steps_m.len() as f64 * mean.norm_squared();
        if let Some((by_place, by_step)) = slopes {
            let pull = places_m.iter().zip(steps_m).map(|(place, step)| (step - mean) * (2.0 * dear(place)));
            let pull: Vec<Vec2> = pull.collect();
            let mean_pull = pull.iter().sum::<Vec2>() / pull.len().max(1) as f64;
            for i in 0..places_m.len() {
                by_step[i] += pull[i] - mean_pull + mean * (2.0 * TOGETHER);
                by_place[i] += places_m[i] * (2.0 * APART / (OUT_M * OUT_M) * (steps_m[i] - mean).norm_squared());
            }
        }
        cost
    }
}

fn by_rotations() -> Motions {
    Motions::Rotations { stride_m: 0.016, effort: Arc::new(Toy) }
}

fn arranged(discs: &[PartOutline], starts_m: &[Vec2], targets_m: &[Vec2], exchange: bool) -> ClosedLoopResult {
    let params = ArrangeParams {
        scene: PlateScene { half_side_m: HALF_SIDE_M, motions: by_rotations(), discs: discs.to_vec() },
        targets_m: targets_m.iter().copied().map(Some).collect(),
        exchange,
        arrive_m: ARRIVE_M,
    };
    run(&mut Arrange::new(params), discs, starts_m, 0.03, 200)
}

#[test]
fn two_change_places_round_each_other() {
    for (x, y) in [(0.03, 0.0), (0.03, 0.03), (0.0112, 0.0), (0.1, 0.1)] {
        let starts_m = [Vec2::new(x, y), Vec2::new(-x, y)];
        let course = arranged(&pennies(2), &starts_m, &[starts_m[1], starts_m[0]], false);
        assert!(course.cycles < 60 && course.gap_m > 0.002 && course.edge_gap_m > 0.001, "{x}, {y}: {course:?}");
    }
}

#[test]
fn a_set_that_is_turned_goes_round_as_one() {
    let starts_m = ring(6, 0.03, 0.0);
    let targets_m = ring(6, 0.03, 2.0);
    let problem = MultiDiscProblem::new(pennies(6), HALF_SIDE_M, targets_m);
    let mut rng = Streams::new(1).stream("ways");
    let stages = RigidMotionProblem { problem: &problem, starts_m: &starts_m, effort: &Rigid }.stages(&mut rng);
    let radius_m = starts_m[0].norm();
    let out = stages.places_m.iter().flatten().map(|place| (place.norm() - radius_m).abs()).fold(0.0, f64::max);
    // chords between stages 25 mm apart lie 2 mm inside
    assert!(!stages.round && out < 0.0025, "{out}");
}

/// Effort that counts only the deviation from a rigid motion of all parts.
#[derive(Debug)]
struct Rigid;

impl Effort for Rigid {
    fn squared(&self, places_m: &[Vec2], steps_m: &[Vec2], slopes: Option<(&mut [Vec2], &mut [Vec2])>) -> f64 {
        let ends_m: Vec<Vec2> = places_m.iter().zip(steps_m).map(|(place, step)| place + step * 0.5).collect();
        let begins_m: Vec<Vec2> = places_m.iter().zip(steps_m).map(|(place, step)| place - step * 0.5).collect();
        let turn = RigidRotation::between(&begins_m, &ends_m);
        let left = begins_m.iter().zip(&ends_m).map(|(begin, end)| end - turn.carry(*begin, 1.0));
        let left: Vec<Vec2> = left.collect();
        if let Some((_, by_step)) = slopes {
            let pull = left.iter().zip(steps_m).map(|(left, step)| left * 2e5 + step * 20.0);
            by_step.iter_mut().zip(pull).for_each(|(slope, pull)| *slope += pull);
        }
        let squares = |of: &[Vec2]| of.iter().map(|v| v.norm_squared()).sum::<f64>();
        1e5 * squares(&left) + 10.0 * squares(steps_m)
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn scattered_parts_reach_scattered_places_by_rotations(seed in 0u64..10_000, count in 2usize..=12, kinds in 1usize..=3) {
        let (discs, starts_m, targets_m) = scene(seed, count, kinds);
        let course = arranged(&discs, &starts_m, &targets_m, seed % 2 == 0);
        prop_assert!(course.cycles < 150 && course.gap_m > 0.0015 && course.edge_gap_m > 0.0005, "{course:?}");
    }

    #[test]
    fn rigid_motions_are_found_again(x in -0.1..0.1f64, y in -0.1..0.1f64, angle in -3.1..3.1f64, seed in 0u64..1000) {
        let mut rng = Streams::new(seed).stream("scene");
        let from_m = scattered(&[PENNY_M; 5], 0.003, 0.005, &mut rng);
        let (sin, cos) = libm::sincos(angle);
        let moved = |p: &Vec2| Vec2::new(cos * p.x - sin * p.y + x, sin * p.x + cos * p.y + y);
        let to_m: Vec<Vec2> = from_m.iter().map(moved).collect();
        let turn = RigidRotation::between(&from_m, &to_m);
        for (from, to) in from_m.iter().zip(&to_m) {
            prop_assert!((turn.carry(*from, 1.0) - to).norm() < 1e-12 && (turn.carry(*from, 0.0) - from).norm() < 1e-12);
            prop_assert!((turn.undo(*to) - from).norm() < 1e-12);
        }
    }
}
