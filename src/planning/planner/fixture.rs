//! A library without a rig, for tests: the belt model of physics.md section 1 in closed form.

use std::f64::consts::{FRAC_2_PI, PI, TAU};
use std::sync::{Arc, LazyLock};

use rand::RngExt as _;

use crate::cor_library::{DisplacementModel, Library, testing};
use crate::planner::{PartState, Plan, PlanStatus, PlannedPulse, PlannerParams, Rotation};
use upm_core::geometry::{Twist, Vec2};
use upm_core::random::Streams;

pub(super) const PENNY_M: f64 = 0.009525;
pub(super) const HALF_SIDE_M: f64 = 0.1016;
const FRICTION_MPS2: f64 = 0.3 * 9.81;
const BASE_RADPS: f64 = TAU * 60.0;
const ATTACK_S: f64 = 1.0 / 60.0;
const REST_S: f64 = 0.03;
const SPIN_RADPS: f64 = 8.0;

/// Mean force over μ m g on a part that moves at `ratio` of the belt's amplitude.
fn mean_force(ratio: f64) -> f64 {
    FRAC_2_PI * libm::acos((1.0 - (3.0 - 4.0 * ratio.min(0.5)).sqrt()) / 2.0) - 1.0
}

/// Distance travelled in one pulse on a belt of amplitude `speed_mps`, m: pumped for S + 2A, then coasting to rest.
fn belt_distance(speed_mps: f64, sustain_s: f64) -> f64 {
    if speed_mps * BASE_RADPS < 0.57 * FRICTION_MPS2 {
        return 0.0;
    }
    const STEP_S: f64 = 2e-4;
    let (mut v, mut x) = (0.0, 0.0);
    for _ in 0..((sustain_s + 2.0 * ATTACK_S) / STEP_S).round() as usize {
        let after = v + STEP_S * FRICTION_MPS2 * mean_force(v / speed_mps);
        x += 0.5 * STEP_S * (v + after);
        v = after;
    }
    x + 0.5 * v * v / FRICTION_MPS2
}

fn displacement() -> DisplacementModel {
    let speed_mps = [0.004, 0.006, 0.01, 0.02, 0.04, 0.07, 0.1, 0.15, 0.2, 0.3, 0.45, 0.7, 1.0, 1.5, 2.5].to_vec();
    let sustain_s: Vec<f64> = (0..26).map(|k| 0.01 * f64::from(k)).collect();
    let row = |&speed: &f64| sustain_s.iter().map(|&sustain| belt_distance(speed, sustain)).collect();
    let distance_m: Vec<Vec<f64>> = speed_mps.iter().map(row).collect();
    let sd_m = distance_m.iter().map(|row| row.iter().map(|d| 0.03 * d).collect()).collect();
    DisplacementModel { speed_mps, sustain_s, distance_m, sd_m }
}

/// Centres on a 17 × 17 grid over the plate at 8 rad/s and translations in 16 directions.
pub(super) fn library() -> Arc<Library> {
    static BUILT: LazyLock<Arc<Library>> = LazyLock::new(build);
    Arc::clone(&BUILT)
}

fn build() -> Arc<Library> {
    let at = |k: i32| HALF_SIDE_M * f64::from(k - 8) / 8.0;
    let rotation = |k: i32| Twist::about(Vec2::new(at(k % 17), at(k / 17)), SPIN_RADPS);
    let translation = |k: i32| {
        let (sin, cos) = libm::sincos(PI * f64::from(k) / 16.0);
        Twist::new(0.8 * cos, 0.8 * sin, 0.0)
    };
    let pumps = (0..289).map(rotation).chain((0..16).map(translation));
    Arc::new(Library {
        plate_side_m: 2.0 * HALF_SIDE_M,
        base_radps: BASE_RADPS,
        attack_s: ATTACK_S,
        rest_s: REST_S,
        displacement: displacement(),
        ..testing::library(pumps)
    })
}

pub(super) fn params() -> PlannerParams {
    PlannerParams {
        half_side_m: HALF_SIDE_M,
        lever_arm_m: 0.1,
        edge_margin_m: 0.001,
        separation_m: 0.0015,
        min_distance_m: 0.0002,
        frame_s: 1.0 / 60.0,
        exposure_s: 0.002,
        max_sustain_s: 0.3,
    }
}

pub(super) fn penny(position_m: Vec2, step_m: Vec2) -> PartState {
    PartState { position_m, step_m, radius_m: PENNY_M, gain: 1.0 }
}

pub(super) fn mm(x: f64, y: f64) -> Vec2 {
    Vec2::new(x, y) * 1e-3
}

/// Pennies on the plate with random steps of up to `reach_m` along each axis.
pub(super) fn scene(count: usize, reach_m: f64, seed: u64) -> Vec<PartState> {
    let mut rng = Streams::new(seed).stream("scene");
    let mut draw = || rng.random::<f64>();
    let places = scatter(count, &mut draw);
    places.into_iter().map(|p| penny(p, reach_m * Vec2::new(2.0 * draw() - 1.0, 2.0 * draw() - 1.0))).collect()
}

/// Checks the status of any planner with nothing to move, steps below a pulse, or a part with a position that is not
/// finite.
pub(super) fn ends_without_a_plan(plan: impl Fn(&[PartState]) -> PlanStatus) {
    assert_eq!(plan(&[]), PlanStatus::NothingToDo);
    assert_eq!(plan(&[penny(mm(1.0, 2.0), mm(0.05, 0.0))]), PlanStatus::NothingToDo);
    assert!(matches!(plan(&[penny(mm(f64::NAN, 2.0), mm(1.0, 0.0))]), PlanStatus::SolverFailed(_)));
}

/// `count` positions on the plate, rims at least a radius apart.
pub(super) fn scatter(count: usize, draw: &mut impl FnMut() -> f64) -> Vec<Vec2> {
    let half = HALF_SIDE_M - 2.0 * PENNY_M;
    'again: loop {
        let mut places: Vec<Vec2> = Vec::new();
        for _ in 0..6000 {
            let p = Vec2::new(half * (2.0 * draw() - 1.0), half * (2.0 * draw() - 1.0));
            if places.iter().all(|q| (p - q).norm() > 3.0 * PENNY_M) {
                places.push(p);
            }
            if places.len() == count {
                return places;
            }
        }
        continue 'again;
    }
}

#[test]
fn belts_follow_the_sheet() {
    assert!((mean_force(0.0) - 0.2386).abs() < 1e-4);
    assert!(mean_force(0.5).abs() < 1e-12);
    let fast = belt_distance(50.0, 0.1);
    let sheet = 0.5 * 0.2386 * 1.2386 * FRICTION_MPS2 * (0.1 + 2.0 * ATTACK_S).powi(2);
    assert!((fast / sheet - 1.0).abs() < 0.01, "{fast} against {sheet}");
}

/// The pulses of a plan that consists of rotations only.
pub(super) fn rotations(plan: &Plan) -> impl Iterator<Item = &Rotation> {
    plan.pulses.iter().map(|pulse| match pulse {
        PlannedPulse::Rotation(rotation) => rotation,
        PlannedPulse::Field(field) => panic!("{field:?}"),
    })
}
