use super::assignment::assign;
use super::least_effort::Effort;
use super::multi_disc::MultiDiscProblem;
use super::routes::PLANNED_GAP_M;
use super::staging::{StagedPaths, find_stages};
use super::turns::RigidMotionProblem;
use super::{PartOutline, Setpoints};
use std::sync::Arc;
use upm_core::geometry::Vec2;
use upm_core::random::{Rng, Streams};

/// Way that takes a part as long as its last step into its place, m; measured on the shipped jobs.
const LAST_M: f64 = 20e-3;

/// The assignment changes only when another costs less than this fraction of it; noise would make it alternate.
const CLEARLY_BETTER: f64 = 0.8;

/// Gap between rims for which a chosen route is kept, m: less than the planned one, since parts stray from it.
const KEPT_GAP_M: f64 = 2.5e-3;

/// Distance within which every part has reached a stage, m.
const STAGE_REACHED_M: f64 = 1e-3;

/// Stages into which the way from one stage to the next is divided: the parts round a corner before they reach it.
const STAGES_BETWEEN: usize = 4;

/// Cycles after which a new route is searched while a part is blocked.
const REPLAN_AFTER: usize = 16;

/// Fraction of a stage's initial distance at which the next stage begins, for rotations: they leave the hardest part of
/// it.
const STAGE_LEFT: f64 = 0.4;

/// Bound of the stride of rotations, relative to the mean distance of a place from its nearest neighbour. To draw parts
/// together takes the more time the closer they are: terms of second order in the steps, and the part of them that a
/// sequence leaves, would be made up for where that is dearest.
const STRIDE_BY_SPACING: f64 = 0.5;
/// Bound of the stride of rotations: the pulses that a contraction of the places by as much (rms) takes. It binds where
/// all relative motions are hard, as on the weak rig, however far apart the places are.
const MOST_DRAWN_PULSES: f64 = 100.0;

/// Other assignments tried for parts that are blocked.
const EXCHANGES: usize = 3;

/// The kind of motion that moves the parts; it determines which paths are short.
#[derive(Clone, Debug, Default)]
pub enum Motions {
    /// Every part moves independently of the others, as with synthesised fields: the cost of a path is its length.
    #[default]
    Independent,
    /// Rotations: joint motions of all parts cost little, relative motions much.
    Rotations {
        /// Longest displacement of a part in one sequence of rotations, m.
        stride_m: f64,
        /// Effort of steps.
        effort: Arc<dyn Effort>,
    },
}

/// The plate and the parts on it, as tasks see them.
#[derive(Clone, Debug, Default)]
pub struct PlateScene {
    /// Half the plate's side, m.
    pub half_side_m: f64,
    /// The kind of motion that moves the parts.
    pub motions: Motions,
    /// Discs of the parts, in the order of the positions given to [`Task::next`](super::Task::next).
    pub discs: Vec<PartOutline>,
}

/// Steers every part to a place: assigns the places and finds the paths.
#[derive(Clone, Debug)]
pub(super) struct PathFollower {
    motions: Motions,
    discs: Vec<PartOutline>,
    half_side_m: f64,
    places_m: Vec<Vec2>,
    /// Group of each part; parts of one group may exchange their places.
    groups: Vec<usize>,
    /// Index of each part's place.
    pub(super) place_of: Vec<usize>,
    /// Latest position of each part, m.
    pub(super) seen_m: Vec<Vec2>,
    /// Remaining stages, m: positions of all parts; from each to the next they move straight and in step.
    stages_m: Vec<Vec<Vec2>>,
    /// Distance of the parts from the present stage when it became the present one, root mean square, m.
    begun_m: f64,
    /// True while the routes lead round each other.
    round: bool,
    blocked: Vec<usize>,
    /// Cycles since the last search for a route.
    observations: usize,
    rng: Rng,
    /// Way left to the places at first, m; see [`Self::left_m`].
    at_first_m: f64,
    /// Way that a part's last step counts as, m.
    last_m: f64,
    /// Largest progress so far, 0 to 1.
    progress: f64,
}

impl PathFollower {
    /// Steering to one place for each part; parts with the same number in `groups` may exchange them. A part without a
    /// place stays where it is first seen.
    pub(super) fn new(scene: &PlateScene, places_m: &[Vec2], groups: Vec<usize>, parts_in_table_m: &[Vec2]) -> Self {
        let PlateScene { half_side_m, motions, discs } = scene;
        let parts = parts_in_table_m.len();
        let seen_m: Vec<Vec2> =
            parts_in_table_m.iter().map(|part_m| if is_finite(*part_m) { *part_m } else { Vec2::zeros() }).collect();
        let place = |i: usize| places_m.get(i).copied().unwrap_or(seen_m[i]);
        let group = |i: usize| if i < places_m.len() { groups.get(i).copied().unwrap_or(i) } else { usize::MAX - i };
        let mut steering = Self {
            motions: motions.clone(),
            discs: (0..parts).map(|i| discs.get(i).copied().unwrap_or_default()).collect(),
            half_side_m: *half_side_m,
            places_m: (0..parts).map(place).collect(),
            groups: (0..parts).map(group).collect(),
            place_of: Vec::new(),
            seen_m,
            stages_m: Vec::new(),
            begun_m: 0.0,
            round: false,
            blocked: Vec::new(),
            observations: 0,
            rng: Streams::new(0).stream("routes"),
            at_first_m: 0.0,
            last_m: LAST_M,
            progress: 0.0,
        };
        steering.place_of = steering.best_assignment(&steering.seen_m, &steering.places_m, &[]);
        if let Motions::Rotations { stride_m, effort } = motions {
            let stride_m = stride_m.min(STRIDE_BY_SPACING * spacing_m(&steering.places_m));
            let stride_m = stride_m.min(MOST_DRAWN_PULSES / drawing_together(&steering.places_m, effort.as_ref()));
            steering.motions = Motions::Rotations { stride_m, effort: Arc::clone(effort) };
            steering.place_of = steering.turning_assignment(effort.as_ref());
        }
        steering.at_first_m = steering.left_m();
        steering
    }

    /// Records the parts' positions, m; a part keeps its last one when the new one is not finite.
    pub(super) fn see(&mut self, parts_in_table_m: &[Vec2]) {
        for (seen, part) in self.seen_m.iter_mut().zip(parts_in_table_m) {
            if is_finite(*part) {
                *seen = *part;
            }
        }
    }

    /// Records the parts' positions, m, and updates assignment and route.
    pub(super) fn observe(&mut self, parts_in_table_m: &[Vec2]) {
        self.see(parts_in_table_m);
        if matches!(self.motions, Motions::Independent) {
            self.exchange_places();
        }
        self.progress = self.progress.max(1.0 - self.left_m() / self.at_first_m.max(f64::MIN_POSITIVE));
        self.observations += 1;
        let may_keep = self.blocked.is_empty() || self.observations <= REPLAN_AFTER;
        match self.motions.clone() {
            Motions::Independent if may_keep && self.keep_path() => {}
            Motions::Independent => self.find_path(),
            Motions::Rotations { stride_m, .. } if may_keep && self.keep_turning_path(stride_m) => {}
            Motions::Rotations { stride_m, effort } => self.find_turning_path(stride_m, effort.as_ref()),
        }
    }

    /// The same where parts need not reach their places exactly.
    pub(super) fn arriving_about(mut self) -> Self {
        self.last_m = 0.0;
        Self { at_first_m: self.left_m(), ..self }
    }

    /// Way left to the places, all parts together, where the last tenths of a millimetre count as they take time, m.
    fn left_m(&self) -> f64 {
        self.distances_m().map(|left_m| left_m + self.last_m * left_m / (left_m + 0.5e-3)).sum()
    }

    /// The place assigned to each part at present, m.
    pub(super) fn targets_m(&self) -> Vec<Vec2> {
        self.place_of.iter().map(|&place| self.places_m[place]).collect()
    }

    /// Next position of each part, m: while all go straight there and in step they keep apart.
    pub(super) fn subgoals_m(&self) -> Vec<Vec2> {
        self.stages_m.first().unwrap_or(&self.seen_m).clone()
    }

    /// Output for the cycle when `there` parts have arrived; `to` names their destination in words.
    pub(super) fn wanted(&self, to: &str, there: usize) -> Setpoints {
        Setpoints {
            subgoals_m: self.subgoals_m(),
            targets_m: self.targets_m(),
            phase: self.phase(to, there),
            progress: self.progress,
            cross_track_m: vec![0.0; self.seen_m.len()],
            blocked: self.blocked.clone(),
            stride_m: match self.motions {
                Motions::Independent => None,
                Motions::Rotations { stride_m, .. } => Some(stride_m),
            },
            ..Setpoints::default()
        }
    }

    /// Present activity in words: destination, kind of path and number of arrived parts.
    fn phase(&self, to: &str, there: usize) -> String {
        let of = self.seen_m.len();
        let round = if matches!(self.motions, Motions::Independent) { self.stages_m.len() > 1 } else { self.round };
        match round {
            _ if of == 0 => "no parts".into(),
            _ if !self.blocked.is_empty() => format!("{to}: {there} of {of} there, {} blocked", self.blocked.len()),
            false if !matches!(self.motions, Motions::Independent) => format!("{to}: {there} of {of} there"),
            false => format!("{to}, straight: {there} of {of} there"),
            true => format!("{to}, round each other: {there} of {of} there"),
        }
    }

    /// Distance of each part from its place, m.
    pub(super) fn distances_m(&self) -> impl Iterator<Item = f64> {
        self.seen_m.iter().zip(&self.place_of).map(|(seen_m, &place)| (seen_m - self.places_m[place]).norm())
    }

    /// Assignment with the least sum of squared distances from `starts_m` to `places_m`.
    fn best_assignment(&self, starts_m: &[Vec2], places_m: &[Vec2], never: &[(usize, usize)]) -> Vec<usize> {
        assign(starts_m.len(), places_m.len(), |part, place| {
            if self.may((part, &place), never) {
                (starts_m[part] - places_m[place]).norm_squared()
            } else {
                f64::INFINITY
            }
        })
    }

    fn may(&self, (part, place): (usize, &usize), never: &[(usize, usize)]) -> bool {
        self.groups[part] == self.groups[*place] && !never.contains(&(part, *place))
    }

    fn cost_m2(&self, place_of: &[usize]) -> f64 {
        self.seen_m.iter().zip(place_of).map(|(seen_m, &place)| (seen_m - self.places_m[place]).norm_squared()).sum()
    }

    fn problem(&self, place_of: &[usize]) -> MultiDiscProblem {
        let targets_m = place_of.iter().map(|&place| self.places_m[place]).collect();
        MultiDiscProblem::new(self.discs.clone(), self.half_side_m, targets_m)
    }

    /// Adopts a clearly better assignment; on a route round other parts only when the new one can be reached straight,
    /// so that exchanges terminate.
    fn exchange_places(&mut self) {
        let better = self.best_assignment(&self.seen_m, &self.places_m, &[]);
        if self.cost_m2(&better) >= CLEARLY_BETTER * self.cost_m2(&self.place_of) {
            return;
        }
        let problem = self.problem(&better);
        if self.stages_m.len() < 2 || problem.is_clear(&self.seen_m, &problem.targets_m, PLANNED_GAP_M) {
            self.place_of = better;
            self.stages_m.clear();
        }
    }

    /// Advances to the last stage that can be reached straight; false without such a stage.
    fn keep_path(&mut self) -> bool {
        let problem = self.problem(&self.place_of);
        let clear = |stage_m: &Vec<Vec2>| problem.is_clear(&self.seen_m, stage_m, KEPT_GAP_M);
        let Some(next) = self.stages_m.iter().rposition(clear) else { return false };
        self.stages_m.drain(..next);
        let reached = |stage_m: &Vec<Vec2>| {
            stage_m.iter().zip(&self.seen_m).all(|(to, from)| (to - from).norm() <= STAGE_REACHED_M)
        };
        self.stages_m.len() == 1 || !self.stages_m.first().is_some_and(reached)
    }

    /// Advances along a path of rotations: keeps the present stage until little of it is left, then takes one a stride
    /// further on. False where the path is no longer clear.
    fn keep_turning_path(&mut self, stride_m: f64) -> bool {
        let Some(present_m) = self.stages_m.first() else { return false };
        let on_it = self.stages_m.len() == 1 || self.away_m(present_m) > STAGE_LEFT * self.begun_m;
        if on_it && self.problem(&self.place_of).is_clear(&self.seen_m, present_m, KEPT_GAP_M) {
            return true;
        }
        !on_it && self.go_on(1, stride_m)
    }

    /// Advances to the stage a stride from the parts, or to the furthest before it that can be reached straight; false
    /// where there is none.
    fn go_on(&mut self, from: usize, stride_m: f64) -> bool {
        let longest_m = |stage_m: &Vec<Vec2>| {
            stage_m.iter().zip(&self.seen_m).map(|(to, seen)| (to - seen).norm()).fold(0.0, f64::max)
        };
        let ahead = self.stages_m.iter().skip(from).position(|stage_m| longest_m(stage_m) >= stride_m);
        let ahead = ahead.map_or(self.stages_m.len(), |ahead| from + ahead + 1);
        let problem = self.problem(&self.place_of);
        let clear = |stage_m: &Vec<Vec2>| problem.is_clear(&self.seen_m, stage_m, KEPT_GAP_M);
        let next = self.stages_m[..ahead].iter().skip(from).rposition(clear);
        self.stages_m.drain(..next.map_or(0, |next| from + next));
        self.begun_m = self.stages_m.first().map_or(0.0, |stage_m| self.away_m(stage_m));
        next.is_some()
    }

    /// Distance of the parts from a stage, root mean square, m.
    fn away_m(&self, stage_m: &[Vec2]) -> f64 {
        let squares: f64 = stage_m.iter().zip(&self.seen_m).map(|(to, seen)| (to - seen).norm_squared()).sum();
        (squares / self.seen_m.len().max(1) as f64).sqrt()
    }

    fn turning_assignment(&self, effort: &dyn Effort) -> Vec<usize> {
        let assign = |starts_m: &[Vec2], places_m: &[Vec2]| self.best_assignment(starts_m, places_m, &[]);
        let problem = self.problem(&self.place_of);
        RigidMotionProblem { problem: &problem, starts_m: &self.seen_m, effort }.assignment(&self.places_m, assign)
    }

    /// Finds a new path for rotations, and adopts an assignment that takes clearly less effort.
    fn find_turning_path(&mut self, stride_m: f64, effort: &dyn Effort) {
        let better = self.turning_assignment(effort);
        let cost = |place_of: &[usize]| {
            RigidMotionProblem { problem: &self.problem(place_of), starts_m: &self.seen_m, effort }.straight_effort()
        };
        if better != self.place_of && cost(&better) < CLEARLY_BETTER * cost(&self.place_of) {
            self.place_of = better;
        }
        self.find_path();
        self.go_on(0, stride_m);
    }

    fn stages(&mut self, place_of: &[usize]) -> StagedPaths {
        let problem = self.problem(place_of);
        match &self.motions {
            Motions::Independent => find_stages(&problem, &self.seen_m, &mut self.rng),
            Motions::Rotations { effort, .. } => {
                RigidMotionProblem { problem: &problem, starts_m: &self.seen_m, effort: effort.as_ref() }
                    .stages(&mut self.rng)
            }
        }
    }

    /// Finds a new path. Where it leaves parts blocked, others of their kind may take their places.
    fn find_path(&mut self) {
        self.observations = 0;
        let mut best = self.stages(&self.place_of.clone());
        let mut never = Vec::new();
        for _ in 0..EXCHANGES {
            never.extend(best.blocked.iter().map(|&part| (part, self.place_of[part])));
            let other = self.best_assignment(&self.seen_m, &self.places_m, &never);
            if best.blocked.is_empty() || other.iter().enumerate().any(|pair| !self.may(pair, &never)) {
                break;
            }
            let found = self.stages(&other);
            if found.blocked.len() < best.blocked.len() {
                (best, self.place_of) = (found, other);
            }
        }
        self.round = best.round;
        (self.blocked, self.stages_m) = (best.blocked, best.places_m);
        if matches!(self.motions, Motions::Independent) {
            self.stages_m = divided(&self.stages_m);
        }
    }
}

/// The first stage and those that divide the ways between the others.
fn divided(stages_m: &[Vec<Vec2>]) -> Vec<Vec<Vec2>> {
    let between = |(from_m, to_m): (&Vec<Vec2>, &Vec<Vec2>), i: usize| {
        let share = i as f64 / STAGES_BETWEEN as f64;
        from_m.iter().zip(to_m).map(|(from, to)| from + (to - from) * share).collect()
    };
    let ways = stages_m.iter().zip(stages_m.iter().skip(1));
    let later = ways.flat_map(|way| (1..=STAGES_BETWEEN).map(move |i| between(way, i)));
    stages_m.first().cloned().into_iter().chain(later).collect()
}

/// Mean distance of a place from its nearest neighbour, m; infinite for a single place.
fn spacing_m(places_m: &[Vec2]) -> f64 {
    let nearest_m = |(i, at_m): (usize, &Vec2)| {
        let others_m = places_m.iter().enumerate().filter(|&(j, _)| j != i);
        others_m.map(|(_, other_m)| (other_m - at_m).norm()).fold(f64::INFINITY, f64::min)
    };
    places_m.iter().enumerate().map(nearest_m).sum::<f64>() / places_m.len() as f64
}

/// Effort of drawing the places together, pulses per metre (rms).
fn drawing_together(places_m: &[Vec2], effort: &dyn Effort) -> f64 {
    let count = places_m.len() as f64;
    let middle_m = places_m.iter().sum::<Vec2>() / count;
    let arms_m: Vec<Vec2> = places_m.iter().map(|place_m| place_m - middle_m).collect();
    let rms_m = (arms_m.iter().map(|arm_m| arm_m.norm_squared()).sum::<f64>() / count).sqrt();
    if rms_m > 0.0 { effort.squared(places_m, &arms_m, None).sqrt() / rms_m } else { 0.0 }
}

fn is_finite(p: Vec2) -> bool {
    p.iter().all(|x| x.is_finite())
}
