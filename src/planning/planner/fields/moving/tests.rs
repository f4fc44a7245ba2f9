//! Closed loops without a plate: parts under Coulomb's law in fine steps, frames with noise, friction that differs.

use std::sync::Arc;

use rand::RngExt as _;

use super::aims::{Aims, Heading, MovingPart};
use super::planner::{MovingPlanner, Segment};
use crate::cor_library::Library;
use crate::planner::PlannerParams;
use crate::planner::fields::rollout::RolloutDisc;
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

fn to_rest(targets_m: &[Vec2]) -> Vec<Heading> {
    targets_m.iter().map(|&target_m| Heading { target_m, subgoal_m: target_m, along_mps: None }).collect()
}

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
}

fn params() -> PlannerParams {
    let params = crate::planner::fixture::params();
    PlannerParams { half_side_m: HALF_SIDE_M, edge_margin_m: 0.0015, separation_m: 0.002, ..params }
}

fn planner(library: &Arc<Library>, count: usize) -> MovingPlanner {
    MovingPlanner::new(library, params(), &vec![PENNY_M; count]).unwrap()
}

#[test]
fn parts_at_dense_targets_are_not_pushed_apart() {
    // at rest in a row, with these gaps: the largest wish to move, m/s
    let asked_mps = |gap_m: f64, at_targets_m: f64| {
        let place_m = |i: usize, gap_m: f64| Vec2::new((2.0 * PENNY_M + gap_m) * i as f64, 0.0);
        let part = |i: usize| MovingPart {
            disc: RolloutDisc {
                position_m: place_m(i, gap_m),
                velocity_mps: Vec2::zeros(),
                radius_m: PENNY_M,
                friction: 0.3,
            },
            drift_mps: Vec2::zeros(),
            target_m: place_m(i, at_targets_m),
            beyond_m: 0.0,
            along_mps: None,
        };
        let wish = Aims::default().wish(&[0, 1, 2, 3, 4, 5].map(part), &params(), 0.08);
        wish.changes_mps.iter().map(|change| change.norm()).fold(0.0, f64::max)
    };
    assert!(asked_mps(2.05e-3, 2.05e-3) < 1e-9);
    assert!(asked_mps(1.9e-3, 1.9e-3) > 1e-4, "nearer than they may be");
}

fn arranged(library: &Arc<Library>, count: usize, seed: u64, limit_s: f64) -> Outcome {
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
    let mut planner = planner(library, count);
    let period_s = planner.period_s();
    let envelope = Envelope { attack_s: period_s, sustain_s: period_s, rest_s: REST_S };
    let mut outcome = Outcome { plate_s: 0.0, off_m: f64::INFINITY, gap_m: 0.0 };
    while outcome.plate_s < limit_s {
        let places_m: Vec<Vec2> = world.seen_m().into_iter().flatten().collect();
        let targets = assigned(&places_m, &targets_m);
        let off_m = places_m.iter().zip(&targets).map(|(place, target)| (place - target).norm()).fold(0.0, f64::max);
        if off_m < TOLERANCE_M {
            break;
        }
        planner.rest(&places_m);
        let still = TwistWave { base_radps: std::f64::consts::TAU / period_s, harmonics: Vec::new() };
        let plan = |planner: &mut MovingPlanner| {
            let targets_m = assigned(&planner.next_places_m(), &targets_m);
            planner.plan(&to_rest(&targets_m))
        };
        let mut segment = plan(&mut planner);
        let mut from = still;
        loop {
            planner.begin();
            let envelope = Envelope { sustain_s: segment.pulse.sustain_s, ..envelope };
            let fade = Fade { from, to: segment.pulse.wave.clone(), envelope };
            let next = (!segment.sets_down).then(|| plan(&mut planner));
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

/// Segments of parts that go from place to place, the last one included.
fn segments(planner: &mut MovingPlanner, targets_m: &[Vec2]) -> Vec<Segment> {
    let mut segments = Vec::new();
    for _ in 0..8 {
        segments.push(planner.plan(&to_rest(targets_m)));
        planner.begin();
    }
    segments
}

/// Every drive, its cross-fade and its end within counts, and the plate within its stroke, at other instants than those
/// of the planner.
#[test]
fn every_change_of_the_motion_stays_within_coils_and_stroke() {
    let library = upm_2();
    let (starts_m, targets_m) =
        ([Vec2::new(-0.09, 0.02), Vec2::new(0.05, -0.06)], [Vec2::new(0.03, 0.09), Vec2::zeros()]);
    let mut planner = planner(&library, 2);
    planner.rest(&starts_m);
    let segments = segments(&mut planner, &targets_m);
    let period_s = planner.period_s();
    let drive = |segment: &Segment, sustain_s: f64| {
        let pulse = &segment.pulse;
        library.field_drive(&pulse.wave, pulse.follows, sustain_s).unwrap()
    };
    let limit = library.fields.as_ref().unwrap().limit_counts;
    let (mut strongest, mut farthest_m) = (0.0f64, 0.0f64);
    for pair in segments.windows(2) {
        let (last, next) = (drive(&pair[0], 0.0), drive(&pair[1], period_s));
        for k in 0..700 {
            let t_s = period_s * f64::from(k) / 233.0;
            let (rising, fading) = (next.counts_at(t_s), last.counts_at(period_s + t_s));
            strongest = rising.iter().zip(fading).map(|(a, b)| (a + b).abs()).fold(strongest, f64::max);
            let place = displacement(&pair[1].pulse.wave, t_s);
            farthest_m = farthest_m.max(place.velocity_mps.amax() + 0.1 * place.spin_radps.abs());
        }
    }
    // so few parts are carried by low harmonics, which the stroke limits
    assert!(farthest_m > 5.5e-3 && farthest_m < 6.1e-3, "{farthest_m}");
    assert!(strongest < 1.01 * limit, "{strongest} of {limit}");
}

#[test]
fn parts_are_followed_to_where_they_are_by_frames_alone() {
    let library = upm_2();
    let mut planner = planner(&library, 1);
    planner.rest(&[Vec2::zeros()]);
    planner.plan(&to_rest(&[Vec2::new(0.05, 0.0)]));
    planner.begin();
    // the part stays where it was, whatever the motion should do
    for frame in 1..40 {
        planner.observe(0.004 * f64::from(frame), &[Some(Vec2::zeros())]);
    }
    assert!(planner.places_m()[0].norm() < 0.3e-3, "{:?}", planner.places_m());
    planner.observe(0.03, &[None]);
    assert_eq!(planner.places_m().len(), 1);
}
