//! Closed-loop tasks: parts move as forecast, with scatter and with a friction that the planner does not know.

use std::f64::consts::PI;

use rand::RngExt as _;

use super::planner;
use crate::planner::fixture::{PENNY_M, penny, rotations, scatter};
use crate::planner::{PartState, PlanStatus};
use upm_core::geometry::Vec2;
use upm_core::random::{Rng, Streams};

/// Standard deviations of friction, of one pulse and of the camera.
const FRICTION_SD: f64 = 0.03;
const PULSE_SD: f64 = 0.02;
const CAMERA_SD_M: f64 = 0.02e-3;

fn normal(rng: &mut Rng) -> f64 {
    (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0
}

fn away_m(parts: &[PartState]) -> f64 {
    parts.iter().map(|part| part.step_m.norm_squared()).sum::<f64>().sqrt()
}

/// Random starts to random targets.
fn arrives(count: usize, seed: u64) -> usize {
    let mut rng = Streams::new(seed).numbered("loop", count as u64);
    let starts_m = scatter(count, &mut || rng.random());
    let places_m = scatter(count, &mut || rng.random());
    arrives_at(places_m, starts_m, rng)
}

/// Runs from `starts_m` to these positions (nearest first), to 0.5 mm, and returns the number of pulses. Every cycle
/// has a plan, gaps stay open, and the parts are nearer after every twenty cycles.
fn arrives_at(mut places_m: Vec<Vec2>, starts_m: Vec<Vec2>, mut rng: Rng) -> usize {
    let (count, mut at_m) = (starts_m.len(), starts_m);
    let targets_m: Vec<Vec2> = at_m
        .iter()
        .map(|p| {
            let nearest =
                (0..places_m.len()).min_by(|&a, &b| (places_m[a] - p).norm().total_cmp(&(places_m[b] - p).norm()));
            places_m.swap_remove(nearest.unwrap())
        })
        .collect();
    let gains: Vec<f64> = (0..count).map(|_| 1.0 + FRICTION_SD * normal(&mut rng)).collect();
    let (mut planner, mut pulses, mut twenty_before_m) = (planner(), 0, f64::INFINITY);
    for cycle in 0..300 {
        let state = |i: usize, gain: f64, seen_m: Vec2| PartState { gain, ..penny(seen_m, targets_m[i] - seen_m) };
        let seen: Vec<PartState> = (0..count)
            .map(|i| state(i, 1.0, at_m[i] + CAMERA_SD_M * Vec2::new(normal(&mut rng), normal(&mut rng))))
            .collect();
        if seen.iter().all(|part| part.step_m.norm() < 0.45e-3) {
            return pulses;
        }
        if cycle % 20 == 0 {
            assert!(away_m(&seen) < twenty_before_m, "{count} parts, cycle {cycle}");
            twenty_before_m = away_m(&seen);
        }
        let plan = planner.plan(&seen, &[]);
        assert_eq!(plan.status, PlanStatus::Solved, "{count} parts, cycle {cycle}");
        for pulse in rotations(&plan) {
            let truth: Vec<PartState> = (0..count).map(|i| state(i, gains[i], at_m[i])).collect();
            let after_m = planner.forecast(&truth, pulse);
            for (p, after) in at_m.iter_mut().zip(after_m) {
                *p += (after - *p) * (1.0 + PULSE_SD * normal(&mut rng));
            }
            pulses += 1;
            for i in 0..count {
                assert!((0..i).all(|j| (at_m[i] - at_m[j]).norm() > 2.0 * PENNY_M), "{count} parts: a touch");
            }
        }
    }
    panic!("{count} parts: not there after 300 cycles");
}

#[test]
fn one_to_eight_parts_arrive() {
    for (count, seeds) in [(1, 0..3), (2, 0..3), (4, 0..2), (8, 0..1)] {
        let pulses: Vec<usize> = seeds.map(|seed| arrives(count, seed)).collect();
        eprintln!("{count} parts: {pulses:?} pulses");
    }
}

/// Positions with 5 mm between pennies, in a row and on a hexagon, where sequences of long pulses stalled.
#[test]
fn dense_places_are_reached() {
    let row = |k: usize| Vec2::new(24e-3 * (k as f64 - 2.5), 0.02);
    let hexagon = |k: usize| 24e-3 * Vec2::new((k as f64 * PI / 3.0).cos(), (k as f64 * PI / 3.0).sin());
    for (seed, places_m) in [(1, (0..6).map(row).collect::<Vec<_>>()), (2, (0..6).map(hexagon).collect())] {
        let mut rng = Streams::new(seed).stream("dense");
        let starts_m = scatter(6, &mut || rng.random());
        eprintln!("seed {seed}: {} pulses", arrives_at(places_m, starts_m, rng));
    }
}
