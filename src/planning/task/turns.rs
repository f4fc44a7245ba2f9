//! Paths for rotations: all parts turn and shift together as far as possible, and each moves individually for the rest.
//!
//! A rotation about a centre carries all parts alike, nearly as a rigid body; relative motions take many pulses about
//! many centres. Paths are therefore searched in a frame that moves with the parts: the rigid motion nearest to that of
//! all parts together.

use std::f64::consts::PI;

use super::least_effort::{Effort, JointPath, ROUGH_ROUNDS, ROUNDS, eased, effort_of};
use super::multi_disc::MultiDiscProblem;
use super::routes::{PLANNED_GAP_M, PrioritizedPlanner};
use super::staging::{StagedPaths, straighten};
use upm_core::geometry::Vec2;
use upm_core::random::Rng;

/// Longest displacement of a part from one stage to the next, m.
const FINE_M: f64 = 8e-3;
/// Length of a stage during optimisation, m, and the least and greatest number of stages.
const COARSE_M: f64 = 15e-3;
const LEAST_STAGES: f64 = 2.0;
const MOST_STAGES: f64 = 16.0;
/// Searches in one frame that parts cannot cross straight.
const TRIES: usize = 2;
/// Number of collision-free paths, best first after rough optimisation, that are optimised to the end.
const FINISHED: usize = 2;
/// Angle of a frame's turn beyond which the opposite direction is tried too, rad.
const EITHER_WAY_RAD: f64 = 1.2;
/// Angles from which assignments are searched, and number of times the frame is refitted to each.
const ANGLES: usize = 12;
const REFITS: usize = 3;
/// Directions in which targets are drawn out, shifts of two targets against each other relative to their distance
/// across, and number of such layouts by way of which paths are searched.
const DIRECTIONS: usize = 6;
const SHEARS: [f64; 4] = [-3.0, -1.5, 1.5, 3.0];
const THROUGH: usize = 2;
/// Gap between rims on an acceptable path, m: slightly less than that of routes in the frame.
const LEAST_GAP_M: f64 = PLANNED_GAP_M - 0.3e-3;

/// Motion task for rotations: parts, targets and effort.
#[derive(Clone, Copy)]
pub(super) struct RigidMotionProblem<'a> {
    pub(super) problem: &'a MultiDiscProblem,
    pub(super) starts_m: &'a [Vec2],
    pub(super) effort: &'a dyn Effort,
}

/// Rigid motion of the plane at uniform rate.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RigidRotation {
    center_m: Vec2,
    shift_m: Vec2,
    angle_rad: f64,
}

impl RigidRotation {
    /// The motion that brings `from_m` nearest to `to_m`: the least sum of squares (Procrustes, in closed form).
    pub(super) fn between(from_m: &[Vec2], to_m: &[Vec2]) -> Self {
        let count = from_m.len().max(1) as f64;
        let center_m = from_m.iter().sum::<Vec2>() / count;
        let end_m = to_m.iter().sum::<Vec2>() / count;
        let (mut dot, mut cross) = (0.0, 0.0);
        for (from, to) in from_m.iter().zip(to_m) {
            let (from, to) = (from - center_m, to - end_m);
            dot += from.dot(&to);
            cross += from.perp(&to);
        }
        let angle_rad = if dot == 0.0 && cross == 0.0 { 0.0 } else { libm::atan2(cross, dot) };
        Self { center_m, shift_m: end_m - center_m, angle_rad }
    }

    /// Image of `p` after a fraction `share` of the motion.
    pub(super) fn carry(&self, p: Vec2, share: f64) -> Vec2 {
        let (sin, cos) = libm::sincos(self.angle_rad * share);
        let arm = p - self.center_m;
        self.center_m + self.shift_m * share + Vec2::new(cos * arm.x - sin * arm.y, sin * arm.x + cos * arm.y)
    }

    /// Upper bound of the displacement, m, of a part that goes from `from_m` to `to_m` in the moving frame during one
    /// of `legs` of the motion.
    fn way_m(&self, from_m: Vec2, to_m: Vec2, legs: usize) -> f64 {
        let arm_m = (from_m - self.center_m).norm().max((to_m - self.center_m).norm());
        (to_m - from_m).norm() + (self.angle_rad.abs() * arm_m + self.shift_m.norm()) / legs as f64
    }

    /// Preimage of `p` under the whole motion.
    pub(super) fn undo(&self, p: Vec2) -> Vec2 {
        let (sin, cos) = libm::sincos(self.angle_rad);
        let arm = p - self.center_m - self.shift_m;
        self.center_m + Vec2::new(cos * arm.x + sin * arm.y, cos * arm.y - sin * arm.x)
    }
}

impl RigidMotionProblem<'_> {
    /// Stages a few millimetres apart to the problem's targets: of the paths in a few frames, straight and round each
    /// other, the one with the least effort after optimisation.
    pub(super) fn stages(&self, rng: &mut Rng) -> StagedPaths {
        let still = RigidRotation::default();
        let nearest = RigidRotation::between(self.starts_m, &self.problem.targets_m);
        let mut frames = vec![nearest, still];
        if nearest.angle_rad.abs() > EITHER_WAY_RAD {
            // the same end in the opposite direction of rotation
            let angle_rad = nearest.angle_rad - std::f64::consts::TAU.copysign(nearest.angle_rad);
            frames.push(RigidRotation { angle_rad, ..nearest });
        }
        let straight = frames.iter().map(|frame| (self.straight_in(frame), false));
        let mut ways: Vec<(JointPath, bool)> = straight.collect();
        for frame in &frames {
            ways.extend(self.round_each_other_in(frame, rng).into_iter().map(|way_m| (way_m, true)));
        }
        let mut through: Vec<(f64, JointPath)> = self.through_drawn_out().collect();
        through.sort_by(|a, b| a.0.total_cmp(&b.0));
        ways.extend(through.into_iter().take(THROUGH).map(|(_, way_m)| (way_m, false)));
        let roughly = |(way_m, round): (JointPath, bool)| {
            let (way_m, cost) = eased(way_m, self.problem, self.effort, ROUGH_ROUNDS);
            (way_m, cost, round)
        };
        let mut ways: Vec<(JointPath, f64, bool)> = ways.into_iter().map(roughly).collect();
        ways.sort_by(|a, b| a.1.total_cmp(&b.1));
        let finished = ways.into_iter().filter_map(|(way_m, _, round)| self.eased(way_m, round)).take(FINISHED);
        finished.min_by(|a, b| a.cost.total_cmp(&b.cost)).unwrap_or_else(|| {
            let mut routes = PrioritizedPlanner::new(self.problem, self.starts_m).routes(rng);
            straighten(self.problem, &mut routes);
            let places_m = fine(&routes.places_m());
            StagedPaths { cost: f64::INFINITY, places_m, blocked: routes.blocked, round: true }
        })
    }

    /// The stages of a path after optimisation, if parts keep apart on it.
    fn eased(&self, way_m: JointPath, round: bool) -> Option<StagedPaths> {
        let (way_m, _) = eased(way_m, self.problem, self.effort, ROUNDS);
        let clear = way_m.windows(2).all(|pair| self.problem.is_clear(&pair[0], &pair[1], LEAST_GAP_M));
        let cost = clear.then(|| effort_of(&way_m, self.effort))?;
        Some(StagedPaths { cost, places_m: fine(&way_m), blocked: Vec::new(), round })
    }

    /// Least effort of straight paths in the frame of all parts and of those by way of drawn-out targets, ignoring
    /// collisions.
    pub(super) fn straight_effort(&self) -> f64 {
        let frame = RigidRotation::between(self.starts_m, &self.problem.targets_m);
        let straight = effort_of(&self.straight_in(&frame), self.effort);
        self.through_drawn_out().map(|(cost, _)| cost).fold(straight, f64::min)
    }

    /// Paths by way of the drawn-out targets that leave room, each with its effort.
    fn through_drawn_out(&self) -> impl Iterator<Item = (f64, JointPath)> {
        drawn_out(&self.problem.targets_m).filter_map(|layout_m| self.through(&layout_m))
    }

    /// Path straight to `layout_m` in the frame of all parts and straight on from there, with its effort; `None` where
    /// that leaves no room.
    fn through(&self, layout_m: &[Vec2]) -> Option<(f64, JointPath)> {
        let targets_m = &self.problem.targets_m;
        let inside = |(part, at): (usize, &Vec2)| at.amax() < self.problem.reach_m(part);
        if !layout_m.iter().enumerate().all(inside) || !self.problem.is_clear(layout_m, targets_m, PLANNED_GAP_M) {
            return None;
        }
        let problem = self.problem.with_targets(layout_m.to_vec());
        let frame = RigidRotation::between(self.starts_m, layout_m);
        let mut way_m = RigidMotionProblem { problem: &problem, ..*self }.straight_in(&frame);
        let on = RigidMotionProblem { starts_m: layout_m, ..*self }.straight_in(&RigidRotation::default());
        way_m.extend(on.into_iter().skip(1));
        Some((effort_of(&way_m, self.effort), way_m))
    }

    /// Assignment to `places_m` with the least effort of straight paths. Candidates are the nearest places (least sum
    /// of squares, by `assign`) of parts that are turned by one of a few angles and shifted over the places or over a
    /// drawn-out layout of them.
    pub(super) fn assignment(&self, places_m: &[Vec2], assign: impl Fn(&[Vec2], &[Vec2]) -> Vec<usize>) -> Vec<usize> {
        let chosen_m = |at_m: &[Vec2], of: &[usize]| -> Vec<Vec2> { of.iter().map(|&place| at_m[place]).collect() };
        let effort = |place_of: &[usize]| {
            let problem = self.problem.with_targets(chosen_m(places_m, place_of));
            RigidMotionProblem { problem: &problem, ..*self }.straight_effort()
        };
        let mut best = assign(self.starts_m, places_m);
        let mut least = effort(&best);
        let mut tried = vec![best.clone()];
        let whole = self.problem.with_targets(places_m.to_vec());
        let roomy = |layout_m: &Vec<Vec2>| whole.is_clear(layout_m, places_m, PLANNED_GAP_M);
        for layout_m in std::iter::once(places_m.to_vec()).chain(drawn_out(places_m).filter(roomy)) {
            let over = RigidRotation::between(self.starts_m, &layout_m);
            for k in 0..ANGLES {
                let mut frame = RigidRotation { angle_rad: std::f64::consts::TAU * k as f64 / ANGLES as f64, ..over };
                for _ in 0..REFITS {
                    let turned_m: Vec<Vec2> = self.starts_m.iter().map(|&start| frame.carry(start, 1.0)).collect();
                    let place_of = assign(&turned_m, &layout_m);
                    frame = RigidRotation::between(self.starts_m, &chosen_m(&layout_m, &place_of));
                    if tried.contains(&place_of) {
                        continue;
                    }
                    let cost = effort(&place_of);
                    if cost < least {
                        (best, least) = (place_of.clone(), cost);
                    }
                    tried.push(place_of);
                }
            }
        }
        best
    }

    fn straight_in(&self, frame: &RigidRotation) -> JointPath {
        let ends_m = self.problem.targets_m.iter().map(|&target| frame.undo(target));
        let ways_m: Vec<Vec<Vec2>> = self.starts_m.iter().zip(ends_m).map(|(&start, end)| vec![start, end]).collect();
        self.in_table(frame, &ways_m)
    }

    /// Paths round each other in a frame that cannot be crossed straight.
    fn round_each_other_in(&self, frame: &RigidRotation, rng: &mut Rng) -> Vec<JointPath> {
        let ends_m = self.problem.targets_m.iter().map(|&target| frame.undo(target)).collect();
        let framed = self.problem.with_targets(ends_m);
        if framed.is_clear(self.starts_m, &framed.targets_m, PLANNED_GAP_M) {
            return Vec::new();
        }
        let mut search = PrioritizedPlanner::new(&framed, self.starts_m);
        let mut routes = Some(search.routes(rng));
        let mut found = Vec::new();
        for _ in 0..TRIES {
            let Some(mut tried) = routes.filter(|routes| routes.blocked.is_empty()) else { break };
            straighten(&framed, &mut tried);
            found.push(self.in_table(frame, &tried.ways_m));
            routes = search.other_routes(rng);
        }
        found
    }

    /// Path in the table's frame for routes in a moving one, some centimetres from stage to stage, on the plate.
    fn in_table(&self, frame: &RigidRotation, ways_m: &[Vec<Vec2>]) -> JointPath {
        let legs = ways_m.first().map_or(0, |way_m| way_m.len().saturating_sub(1));
        let length_m =
            |way_m: &Vec<Vec2>| way_m.windows(2).map(|leg_m| frame.way_m(leg_m[0], leg_m[1], legs)).sum::<f64>();
        let stages =
            (ways_m.iter().map(length_m).fold(0.0, f64::max) / COARSE_M).ceil().clamp(LEAST_STAGES, MOST_STAGES);
        let mut way_m = vec![self.starts_m.to_vec()];
        for k in 1..stages as usize {
            let share = k as f64 / stages;
            let at = |(part, way_m): (usize, &Vec<Vec2>)| {
                let place = share * legs as f64;
                let leg = (place as usize).min(legs.saturating_sub(1));
                let in_frame = way_m[leg].lerp(way_m.get(leg + 1).unwrap_or(&way_m[leg]), place - leg as f64);
                let reach_m = self.problem.reach_m(part);
                frame.carry(in_frame, share).map(|x| x.clamp(-reach_m, reach_m))
            };
            way_m.push(ways_m.iter().enumerate().map(at).collect());
        }
        way_m.push(self.problem.targets_m.clone());
        way_m
    }
}

/// The stages of a path after its first, with more between them where they are far apart.
fn fine(way_m: &[Vec<Vec2>]) -> Vec<Vec<Vec2>> {
    let mut places_m = Vec::new();
    for pair in way_m.windows(2) {
        let longest_m = pair[0].iter().zip(&pair[1]).map(|(from, to)| (to - from).norm()).fold(0.0, f64::max);
        let steps = (longest_m / FINE_M).ceil().max(1.0);
        let at = |k: usize| pair[0].iter().zip(&pair[1]).map(|(from, to)| from.lerp(to, k as f64 / steps)).collect();
        places_m.extend((1..=steps as usize).map(at));
    }
    places_m
}

/// The places drawn out in several directions by shearing them. Flows about centres are free of divergence: to draw a
/// crowd together takes many pulses, to gather a line along itself and to shear it few.
fn drawn_out(places_m: &[Vec2]) -> impl Iterator<Item = Vec<Vec2>> {
    let center_m = places_m.iter().sum::<Vec2>() / places_m.len().max(1) as f64;
    let ways = (0..DIRECTIONS).flat_map(|k| SHEARS.map(|shear| (PI * k as f64 / DIRECTIONS as f64, shear)));
    ways.map(move |(angle_rad, shear)| {
        let along = Vec2::new(libm::cos(angle_rad), libm::sin(angle_rad));
        places_m.iter().map(|p| p + along * (shear * along.perp(&(p - center_m)))).collect()
    })
}
