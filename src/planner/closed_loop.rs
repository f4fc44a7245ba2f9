//! Whole tasks closed over the planner: parts moved by the measured model with noise, at the size of real pulses.

use rand::RngExt as _;

use super::fixture::{PENNY_M, library, params, penny, rotations, scatter};
use super::{PartState, Plan, PlanStatus, Planner};
use upm_core::geometry::Vec2;
use upm_core::random::{Rng, Streams};
use upm_library::Library;

/// What one run took.
#[derive(Debug, Default)]
struct Tally {
    cycles: usize,
    pulses: usize,
    plate_s: f64,
    reached: bool,
    /// Smallest gap between rims after any pulse, m.
    gap_m: f64,
}

struct Noise(Rng);

impl Noise {
    /// Uniform in 0..1.
    fn draw(&mut self) -> f64 {
        self.0.random()
    }

    /// Standard normal, from twelve uniforms.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.draw()).sum::<f64>() - 6.0
    }
}

/// A part follows the flow in a bent path: the direction a fifth of the way along counts, 3 % and 1.5 degrees of noise.
fn play(library: &Library, plan: &Plan, positions: &mut [Vec2], noise: &mut Noise, tally: &mut Tally) {
    for pulse in rotations(plan) {
        let reverse = pulse.distance_m.signum();
        for p in positions.iter_mut() {
            let straight = library.displacement_at(pulse.entry, *p, pulse.sustain_s) * reverse;
            let bent = library.displacement_at(pulse.entry, *p + 0.2 * straight, pulse.sustain_s) * reverse;
            let turn = nalgebra::Rotation2::new(0.026 * noise.normal());
            *p += turn * bent * (1.0 + 0.03 * noise.normal());
        }
        tally.pulses += 1;
        tally.plate_s += pulse.sustain_s + 2.0 * library.attack_s + library.rest_after(pulse.sustain_s);
        for i in 0..positions.len() {
            for j in 0..i {
                tally.gap_m = tally.gap_m.min((positions[i] - positions[j]).norm() - 2.0 * PENNY_M);
            }
        }
    }
}

/// Random starts to random targets (nearest assignment by pairwise exchange), to 0.5 mm.
fn run(planner: &mut Planner, count: usize, cap_m: f64, seed: u64) -> Tally {
    let mut noise = Noise(Streams::new(seed).numbered("loop", count as u64));
    let mut positions = scatter(count, &mut || noise.draw());
    let mut targets = scatter(count, &mut || noise.draw());
    exchange(&positions, &mut targets);
    let mut tally = Tally { gap_m: f64::INFINITY, ..Tally::default() };
    for _ in 0..400 {
        let seen: Vec<Vec2> = positions.iter().map(|p| p + 5e-5 * Vec2::new(noise.normal(), noise.normal())).collect();
        let errors: Vec<Vec2> = targets.iter().zip(&seen).map(|(t, p)| t - p).collect();
        let worst = errors.iter().map(Vec2::norm).fold(0.0, f64::max);
        if worst < 0.5e-3 {
            tally.reached = true;
            break;
        }
        let scale = (cap_m / worst).min(1.0);
        let parts: Vec<PartState> = seen.iter().zip(&errors).map(|(&p, e)| penny(p, e * scale)).collect();
        let plan = planner.plan(&parts);
        if plan.status != PlanStatus::Solved {
            break;
        }
        play(planner.library.as_ref(), &plan, &mut positions, &mut noise, &mut tally);
        tally.cycles += 1;
    }
    tally
}

fn exchange(positions: &[Vec2], targets: &mut [Vec2]) {
    let mut better = true;
    while std::mem::take(&mut better) {
        for i in 0..targets.len() {
            for j in 0..i {
                let d = |a: Vec2, b: Vec2| (a - b).norm_squared();
                let now = d(positions[i], targets[i]) + d(positions[j], targets[j]);
                if d(positions[i], targets[j]) + d(positions[j], targets[i]) < now - 1e-12 {
                    targets.swap(i, j);
                    better = true;
                }
            }
        }
    }
}

/// Runs `count` parts from several random starts in steps of 10 mm and says what it took.
fn all_arrive(count: usize, seeds: std::ops::Range<u64>, most_plate_s: f64) {
    let mut planner = Planner::new(library(), params());
    let runs = seeds.end - seeds.start;
    let (mut cycles, mut pulses, mut plate_s) = (0, 0, 0.0);
    for seed in seeds {
        let tally = run(&mut planner, count, 0.01, seed);
        assert!(tally.reached, "{count} parts, seed {seed}: {tally:?}");
        assert!(tally.gap_m > 0.0, "{count} parts, seed {seed} touched: {tally:?}");
        cycles += tally.cycles;
        pulses += tally.pulses;
        plate_s += tally.plate_s;
    }
    let mean = |sum: f64| sum / runs as f64;
    let (cycles, pulses, plate_s) = (mean(cycles as f64), mean(pulses as f64), mean(plate_s));
    eprintln!("{count} parts: {cycles:.1} cycles, {pulses:.1} pulses, {plate_s:.1} s of plate time");
    assert!(plate_s < most_plate_s, "{count} parts took {plate_s:.1} s");
}

/// Bounds: the lower ends of what the plain planner of physics.md section 1 took.
#[test]
fn one_two_and_four_parts_arrive() {
    all_arrive(1, 0..10, 3.0);
    all_arrive(2, 0..10, 8.0);
    all_arrive(4, 0..6, 33.0);
}

#[test]
fn eight_parts_arrive() {
    all_arrive(8, 0..4, 29.0);
}
