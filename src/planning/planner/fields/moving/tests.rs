//! Closed loops without a plate: parts under Coulomb's law in fine steps, frames with noise, friction that differs.

use std::sync::Arc;

use rand::RngExt as _;

use super::planner::{MovingPlanner, Segment};
use crate::cor_library::Library;
use crate::planner::PlannerParams;
use crate::planner::fields::tests::upm_2;
use crate::planner::fixture::PENNY_M;
use crate::planner::friction::friction_of;
use upm_core::geometry::{Twist, Vec2};
use upm_core::random::{Rng, Streams};
use upm_core::signal::{Envelope, TwistWave};
use upm_core::units::GRAVITY_MPS2;

const HALF_SIDE_M: f64 = 0.1524;
const STEP_S: f64 = 1e-4;
const FRAME_S: f64 = 1.0 / 60.0;
const NOISE_M: f64 = 2e-5;
const REST_S: f64 = 0.04;
const TOLERANCE_M: f64 = 0.45e-3;
/// Deviations of friction from part to part, and of the plate's response.
const SPREAD: f64 = 0.1;
const RESPONSE: f64 = 0.005;

/// Nearly normal: the sum of twelve uniform deviates.
fn normal(rng: &mut Rng) -> f64 {
    (0..12).map(|_| rng.random_range(-0.5..0.5)).sum()
}

/// Plate motion of two consecutive segments.
struct Fade {
    from: TwistWave,
    to: TwistWave,
    envelope: Envelope,
}

fn displacement(wave: &TwistWave, t_s: f64) -> Twist {
    (1..).zip(&wave.harmonics).fold(Twist::ZERO, |sum, (k, harmonic)| {
        let radps = f64::from(k) * wave.base_radps;
        let (sin, cos) = libm::sincos(radps * t_s);
        sum + (harmonic.cos * sin - harmonic.sin * cos) * radps.recip()
    })
}

impl Fade {
    /// Velocity and displacement of the plate `t_s` after the segment began.
    fn at(&self, t_s: f64) -> (Twist, Vec2) {
        let (height, slope) = (self.envelope.at(t_s), self.envelope.slope(t_s));
        let to = displacement(&self.to, t_s);
        let mut velocity = self.to.at(t_s) * height + to * slope;
        let mut offset = to * height;
        if t_s < self.envelope.attack_s {
            let from = displacement(&self.from, t_s);
            velocity = velocity + self.from.at(t_s) * (1.0 - height) + from * -slope;
            offset = offset + from * (1.0 - height);
        }
        (velocity, offset.velocity_mps)
    }
}

struct World {
    places_m: Vec<Vec2>,
    velocities_mps: Vec<Vec2>,
    friction: Vec<f64>,
    response: f64,
    gap_m: f64,
    noise: Rng,
}

impl World {
    fn step(&mut self, (velocity, offset_m): (Twist, Vec2)) {
        let velocity = velocity * self.response;
        for (i, &friction) in self.friction.iter().enumerate() {
            let slip = velocity.velocity_at(self.places_m[i] - offset_m) - self.velocities_mps[i];
            let turning = 0.388 * (PENNY_M * velocity.spin_radps).powi(2);
            let most = friction * GRAVITY_MPS2 * STEP_S;
            self.velocities_mps[i] += slip * (most / (slip.norm_squared() + turning).sqrt().max(most));
            self.places_m[i] += self.velocities_mps[i] * STEP_S;
            for j in 0..i {
                self.gap_m = self.gap_m.min((self.places_m[i] - self.places_m[j]).norm() - 2.0 * PENNY_M);
            }
        }
    }

    fn seen_m(&mut self) -> Vec<Option<Vec2>> {
        let Self { places_m, noise, .. } = self;
        places_m.iter().map(|place_m| Some(place_m + Vec2::new(normal(noise), normal(noise)) * NOISE_M)).collect()
    }
}

fn scattered(count: usize, apart_m: f64, rng: &mut Rng) -> Vec<Vec2> {
    let reach_m = HALF_SIDE_M - PENNY_M - 5e-3;
    let mut places_m: Vec<Vec2> = Vec::new();
    while places_m.len() < count {
        let place_m = Vec2::new(rng.random_range(-reach_m..reach_m), rng.random_range(-reach_m..reach_m));
        if places_m.iter().all(|other_m| (place_m - other_m).norm() > apart_m) {
            places_m.push(place_m);
        }
    }
    places_m
}

fn assigned(places_m: &[Vec2], targets_m: &[Vec2]) -> Vec<Vec2> {
    use pathfinding::prelude::{Matrix, kuhn_munkres_min};
    let cost = |(i, j): (usize, usize)| ((places_m[i] - targets_m[j]).norm_squared() * 1e12) as i64;
    let places = kuhn_munkres_min(&Matrix::from_fn(places_m.len(), targets_m.len(), cost)).1;
    places.into_iter().map(|place| targets_m[place]).collect()
}

/// Outcome of a loop.
#[derive(Debug)]
struct Outcome {
    plate_s: f64,
    off_m: f64,
    gap_m: f64,
    set_downs: usize,
    plan_ms: Vec<f64>,
}

fn arranged(library: &Arc<Library>, count: usize, seed: u64, limit_s: f64) -> Outcome {
    let params = PlannerParams {
        half_side_m: HALF_SIDE_M,
        edge_margin_m: 0.0015,
        separation_m: 0.002,
        ..crate::planner::fixture::params()
    };
    let mut rng = Streams::new(seed).stream("moving parts");
    let (starts_m, targets_m) = (scattered(count, 2.0 * PENNY_M + 3e-3, &mut rng), scattered(count, 25.4e-3, &mut rng));
    let usual = friction_of(library).unwrap();
    let mut world = World {
        velocities_mps: vec![Vec2::zeros(); count],
        friction: (0..count).map(|_| usual * (1.0 + SPREAD * normal(&mut rng).clamp(-3.0, 3.0))).collect(),
        response: 1.0 + RESPONSE * normal(&mut rng),
        places_m: starts_m,
        gap_m: f64::INFINITY,
        noise: rng,
    };
    let mut planner = MovingPlanner::new(library, params, &vec![PENNY_M; count]).unwrap();
    let period_s = planner.period_s();
    let envelope = Envelope { attack_s: period_s, sustain_s: period_s, rest_s: REST_S };
    let mut outcome = Outcome { plate_s: 0.0, off_m: f64::INFINITY, gap_m: 0.0, set_downs: 0, plan_ms: Vec::new() };
    while outcome.plate_s < limit_s {
        let places_m: Vec<Vec2> = world.seen_m().into_iter().flatten().collect();
        let targets = assigned(&places_m, &targets_m);
        let off_m = places_m.iter().zip(&targets).map(|(place, target)| (place - target).norm()).fold(0.0, f64::max);
        if off_m < TOLERANCE_M {
            break;
        }
        planner.rest(&places_m);
        let still = TwistWave { base_radps: std::f64::consts::TAU / period_s, harmonics: Vec::new() };
        let plan = |planner: &mut MovingPlanner, plan_ms: &mut Vec<f64>| -> Segment {
            let started = std::time::Instant::now();
            let segment = planner.plan(&assigned(&planner.next_places_m(), &targets_m));
            plan_ms.push(started.elapsed().as_secs_f64() * 1e3);
            segment
        };
        let mut segment = plan(&mut planner, &mut outcome.plan_ms);
        let mut from = still;
        loop {
            planner.begin();
            let fade = Fade { from, to: segment.pulse.wave.clone(), envelope };
            let next = (!segment.sets_down).then(|| plan(&mut planner, &mut outcome.plan_ms));
            let driven_s = if segment.sets_down { envelope.driven_s() } else { period_s };
            let mut frames = 1;
            for k in 0..(driven_s / STEP_S).round() as usize {
                world.step(fade.at((k as f64 + 0.5) * STEP_S));
                if (k as f64 + 1.0) * STEP_S >= f64::from(frames) * FRAME_S && f64::from(frames) * FRAME_S < driven_s {
                    planner.observe((k as f64 + 1.0) * STEP_S, &world.seen_m());
                    frames += 1;
                }
            }
            outcome.plate_s += driven_s;
            from = fade.to;
            match next {
                Some(next) => segment = next,
                None => break,
            }
        }
        (0..1000).for_each(|_| world.step((Twist::ZERO, Vec2::zeros())));
        outcome.plate_s += REST_S + FRAME_S;
        outcome.set_downs += 1;
    }
    let targets = assigned(&world.places_m, &targets_m);
    outcome.off_m = world.places_m.iter().zip(&targets).map(|(place, t)| (place - t).norm()).fold(0.0, f64::max);
    Outcome { gap_m: world.gap_m, ..outcome }
}

#[test]
fn four_parts_arrive_without_a_pause() {
    let outcome = arranged(&upm_2(), 4, 1, 4.0);
    assert!(outcome.off_m < 0.5e-3 && outcome.gap_m > 0.0, "{outcome:?}");
}

/// `moving=8,100,10` takes ten seeds of eight parts from seed 100 on.
#[test]
#[ignore = "a campaign: prints its table"]
fn campaign() {
    let asked = std::env::var("moving").unwrap_or_else(|_| "8,0,5".into());
    let numbers: Vec<u64> = asked.split(',').map(|number| number.parse().unwrap()).collect();
    let [count, first, seeds] = numbers[..] else { panic!("parts, first seed, seeds") };
    let (mut times, mut plans, mut done, mut touched) = (Vec::new(), Vec::new(), 0, 0);
    for seed in first..first + seeds {
        let outcome = arranged(&upm_2(), count as usize, seed, 60.0);
        let Outcome { plate_s, off_m, gap_m, set_downs, plan_ms } = outcome;
        println!("seed {seed}: {plate_s:.2} s, {:.2} mm off, gap {:.2} mm, {set_downs} set-downs", 1e3 * off_m, 1e3 * gap_m);
        done += u32::from(off_m < 0.5e-3);
        touched += u32::from(gap_m < 0.0);
        times.push(plate_s);
        plans.extend(plan_ms);
    }
    times.sort_by(f64::total_cmp);
    plans.sort_by(f64::total_cmp);
    let at = |of: &[f64], share: f64| of[((of.len() - 1) as f64 * share) as usize];
    println!(
        "== {count} parts: {done} of {seeds}, median {:.2} s, worst {:.2} s, {touched} touched, plan {:.1} ms, p99 {:.1} ms",
        at(&times, 0.5),
        at(&times, 1.0),
        at(&plans, 0.5),
        at(&plans, 0.99)
    );
}
