//! Closed-loop tests: parts that follow their subgoals within a few percent, from cycle to cycle, until the task is
//! done.

mod rotations;

use proptest::prelude::*;
use rand::RngExt;
use std::f64::consts::TAU;

use super::{Arrange, ArrangeParams, BinParams, Motions, PENNY_M, PartOutline, PlateScene, Sort, SortParams, Task};
use upm_core::geometry::Vec2;
use upm_core::random::{Rng, Streams};
use upm_core::time::PlateTime;

const HALF_SIDE_M: f64 = 0.1524;
const ARRIVE_M: f64 = 0.00045;
/// Longest displacement of a part in one cycle, m.
const STRIDE_M: f64 = 0.012;

/// Result of a run.
#[derive(Debug)]
struct ClosedLoopResult {
    cycles: usize,
    /// Least gap between rims at any time, m.
    gap_m: f64,
    /// Least gap between a rim and the plate's edge, m.
    edge_gap_m: f64,
    blocked: Vec<usize>,
}

/// All parts move the same fraction of their displacements, at most a stride; each strays from it by `noise` of it.
fn step(parts_m: &[Vec2], subgoals_m: &[Vec2], noise: f64, rng: &mut Rng) -> Vec<Vec2> {
    let longest_m = parts_m.iter().zip(subgoals_m).map(|(from, to)| (to - from).norm()).fold(0.0, f64::max);
    let share = (STRIDE_M / longest_m).min(1.0);
    let mut stray = || Vec2::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0)) * noise;
    let go = |(from, to): (&Vec2, &Vec2)| from + (to - from) * share + stray() * (to - from).norm() * share;
    parts_m.iter().zip(subgoals_m).map(go).collect()
}

/// Least gap between rims while all move straight and in step, m.
fn least_gap_m(discs: &[PartOutline], from_m: &[Vec2], to_m: &[Vec2]) -> f64 {
    let mut least_m = f64::INFINITY;
    for k in 0..=8 {
        let at = |i: usize| from_m[i].lerp(&to_m[i], f64::from(k) / 8.0);
        for a in 0..discs.len() {
            for b in 0..a {
                least_m = least_m.min((at(a) - at(b)).norm() - discs[a].radius_m - discs[b].radius_m);
            }
        }
    }
    least_m
}

fn run(task: &mut dyn Task, discs: &[PartOutline], starts_m: &[Vec2], noise: f64, cycles: usize) -> ClosedLoopResult {
    let mut rng = Streams::new(1).stream("strays");
    let mut parts_m = starts_m.to_vec();
    let mut course =
        ClosedLoopResult { cycles: 0, gap_m: f64::INFINITY, edge_gap_m: f64::INFINITY, blocked: Vec::new() };
    for cycle in 0..cycles {
        course.cycles = cycle;
        let wanted = task.next(PlateTime::from_secs(0.3 * cycle as f64), &parts_m);
        course.blocked = wanted.blocked;
        if wanted.done {
            return course;
        }
        let next_m = step(&parts_m, &wanted.subgoals_m, noise, &mut rng);
        course.gap_m = course.gap_m.min(least_gap_m(discs, &parts_m, &next_m));
        for (part_m, disc) in next_m.iter().zip(discs) {
            course.edge_gap_m = course.edge_gap_m.min(HALF_SIDE_M - disc.radius_m - part_m.amax());
        }
        parts_m = next_m;
    }
    course.cycles = usize::MAX;
    course
}

fn arranged(discs: &[PartOutline], starts_m: &[Vec2], targets_m: &[Vec2], exchange: bool) -> ClosedLoopResult {
    let (discs, targets_m) = (discs.to_vec(), targets_m.iter().copied().map(Some).collect());
    let params = ArrangeParams {
        scene: PlateScene { half_side_m: HALF_SIDE_M, motions: Motions::Independent, discs: discs.clone() },
        targets_m,
        exchange,
        arrive_m: ARRIVE_M,
    };
    run(&mut Arrange::new(params), &discs, starts_m, 0.03, 150)
}

fn pennies(count: usize) -> Vec<PartOutline> {
    vec![PartOutline { kind: 0, radius_m: PENNY_M }; count]
}

/// Positions on a circle, rims `gap_m` apart; `turn` is in positions.
fn ring(count: usize, gap_m: f64, turn: f64) -> Vec<Vec2> {
    let radius_m = (PENNY_M + 0.5 * gap_m) / (0.5 * TAU / count as f64).sin();
    let at = |i: usize| TAU * (i as f64 + turn) / count as f64;
    (0..count).map(|i| radius_m * Vec2::new(at(i).cos(), at(i).sin())).collect()
}

/// Random positions, rims `gap_m` apart and `margin_m` inside the edge.
fn scattered(radii_m: &[f64], gap_m: f64, margin_m: f64, rng: &mut Rng) -> Vec<Vec2> {
    loop {
        let mut places_m: Vec<Vec2> = Vec::new();
        for _ in 0..20_000 {
            let Some(radius_m) = radii_m.get(places_m.len()) else { return places_m };
            let reach_m = HALF_SIDE_M - radius_m - margin_m;
            let p = Vec2::new(rng.random_range(-reach_m..reach_m), rng.random_range(-reach_m..reach_m));
            if places_m.iter().zip(radii_m).all(|(q, other_m)| (p - q).norm() > radius_m + other_m + gap_m) {
                places_m.push(p);
            }
        }
    }
}

/// Coins at random positions, and random targets for them.
fn scene(seed: u64, count: usize, kinds: usize) -> (Vec<PartOutline>, Vec<Vec2>, Vec<Vec2>) {
    let mut rng = Streams::new(seed).stream("scene");
    let discs = coins(count, kinds);
    let radii_m = radii_m(&discs);
    let starts_m = scattered(&radii_m, 0.003, 0.005, &mut rng);
    let targets_m = scattered(&radii_m, 0.003, 0.002, &mut rng);
    (discs, starts_m, targets_m)
}

#[test]
fn two_change_places() {
    for (x, y) in [(0.03, 0.0), (0.03, 0.03), (0.0112, 0.0), (0.1, 0.1), (0.1, 0.135)] {
        let starts_m = [Vec2::new(x, y), Vec2::new(-x, y)];
        let course = arranged(&pennies(2), &starts_m, &[starts_m[1], starts_m[0]], false);
        assert!(course.cycles < 25 && course.gap_m > 0.002 && course.edge_gap_m > 0.001, "{x}, {y}: {course:?}");
    }
}

#[test]
fn blocked_part_is_named_and_the_others_arrive() {
    // the largest disc leaves 24.8 mm beside it at most, wherever it goes; part 1 has a diameter of 30 mm and its
    // target on the far side
    let radii_m = [0.14, 0.015, 0.009];
    let discs: Vec<PartOutline> =
        radii_m.iter().zip(0..).map(|(&radius_m, kind)| PartOutline { kind, radius_m }).collect();
    let starts_m = [Vec2::zeros(), Vec2::new(-0.13, -0.13), Vec2::new(0.14, -0.12)];
    let targets_m = [Vec2::zeros(), Vec2::new(0.13, 0.13), Vec2::new(0.12, -0.14)].map(Some).to_vec();
    let params = ArrangeParams {
        scene: PlateScene { half_side_m: HALF_SIDE_M, motions: Motions::Independent, discs: discs.clone() },
        targets_m,
        exchange: true,
        arrive_m: ARRIVE_M,
    };
    let mut task = Arrange::new(params);
    let course = run(&mut task, &discs, &starts_m, 0.03, 40);
    assert_eq!((course.cycles, course.blocked), (usize::MAX, vec![1]));
    let wanted = task.next(PlateTime::from_secs(100.0), &starts_m);
    assert_eq!(wanted.blocked, [1]);
    assert_eq!(wanted.phase, "to the places: 1 of 3 there, 1 blocked");
    assert_eq!(wanted.subgoals_m, [Vec2::zeros(), starts_m[1], Vec2::new(0.12, -0.14)]);
}

/// Bins side by side across the plate, the i-th for kind i of [`coins`].
fn bins(kinds: usize, width_m: f64, height_m: f64, apart_m: f64) -> Vec<BinParams> {
    let middle = |i: usize| apart_m * (i as f64 - 0.5 * (kinds as f64 - 1.0));
    let half = 0.5 * Vec2::new(width_m, height_m);
    let bin = |i: usize| {
        let middle = Vec2::new(middle(i), 0.0);
        BinParams { parts: (i..64).step_by(kinds).collect(), min_m: middle - half, max_m: middle + half }
    };
    (0..kinds).map(bin).collect()
}

fn sorted(discs: &[PartOutline], starts_m: &[Vec2], bins: Vec<BinParams>) -> ClosedLoopResult {
    let params = SortParams {
        scene: PlateScene { half_side_m: HALF_SIDE_M, motions: Motions::Independent, discs: discs.to_vec() },
        bins: bins.clone(),
        margin_m: 5e-5,
    };
    let mut task = Sort::new(params);
    run(&mut task, discs, starts_m, 0.03, 150)
}

/// `count` coins of kinds 0 to `kinds` - 1 in turn.
fn coins(count: usize, kinds: usize) -> Vec<PartOutline> {
    (0..count).map(|i| PartOutline { kind: i % kinds, radius_m: [PENNY_M, 0.01213, 0.008955][i % kinds] }).collect()
}

fn radii_m(discs: &[PartOutline]) -> Vec<f64> {
    discs.iter().map(|disc| disc.radius_m).collect()
}

#[test]
fn three_kinds_cross_each_other_into_crowded_bins() {
    // two by two quarters with 3, 4 and 12 mm between them, and all in one row
    for (seed, (width_m, height_m)) in
        (0..24).zip([(0.0546, 0.0546), (0.057, 0.057), (0.073, 0.073), (0.03, 0.12)].repeat(6))
    {
        let mut rng = Streams::new(seed).stream("scene");
        let discs = coins(12, 3);
        let starts_m = scattered(&radii_m(&discs), 0.003, 0.005, &mut rng);
        let course = sorted(&discs, &starts_m, bins(3, width_m, height_m, 0.09));
        assert!(course.cycles < 60 && course.gap_m > 0.0015 && course.edge_gap_m > 0.0005, "{seed}: {course:?}");
    }
}

#[test]
fn bins_that_are_full_exchange_their_parts() {
    // each of two bins is filled with the other's parts
    let discs = coins(12, 2);
    let bins = bins(2, 0.085, 0.058, 0.1);
    let slot = |i: usize| {
        let middle = 0.5 * (bins[1 - i % 2].min_m + bins[1 - i % 2].max_m);
        let k = i / 2;
        middle + Vec2::new(0.028 * (k as f64 % 3.0 - 1.0), if k < 3 { 0.014 } else { -0.014 })
    };
    let starts_m: Vec<Vec2> = (0..12).map(slot).collect();
    let course = sorted(&discs, &starts_m, bins);
    assert!(course.cycles < 60 && course.gap_m > 0.0015, "{course:?}");
}
