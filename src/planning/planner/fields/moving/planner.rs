use std::ops::Range;
use std::sync::Arc;

use super::aims::{AHEAD, Aims, Heading, MovingPart, Wish, rms};
use super::filter::PartFilter;
use super::model::MovingModel;
use super::motion::{Motion, NearEdge};
use super::search::{SegmentProblem, Shot};
use crate::cor_library::Library;
use crate::planner::fields::optimizer::RolloutPool;
use crate::planner::fields::rollout::{Rollout, RolloutDisc};
use crate::planner::{FieldPulse, PlannerParams};
use upm_core::geometry::Vec2;
use upm_core::signal::Follows;

/// Rounds of improvement: of each start from rest, of each other start, of the best one, of each motion of the bank,
/// and of the best of those.
const FROM_REST_ROUNDS: usize = 8;
const FIRST_ROUNDS: usize = 3;
const ROUNDS: usize = 12;
const BANK_FIRST_ROUNDS: usize = 6;
const BANK_ROUNDS: usize = 10;
/// Motions of the bank that are tried from rest, and where the last motion leaves more than this share of what is
/// asked.
const BANK_FROM_REST: usize = 2;
const BANK: usize = 2;
const MUCH_LEFT: f64 = 0.4;
/// Cost of a motion of the bank relative to the best so far below which it takes its place: a change has its own cost.
const BETTER: f64 = 0.95;
/// Even harmonics of the second start, relative to the last motion's: they determine where parts are carried, and
/// reversed ones brake.
const REVERSED: f64 = -0.4;
/// Root mean square distance from the targets below which parts are set down, m, and the largest distance of a part
/// after it: set-downs from farther away miss, and are forecast to 0.3 mm.
const SET_DOWN_M: f64 = 1.5e-3;
const SET_DOWN_WITHIN_M: f64 = 0.3e-3;
/// A set-down from rest is worth it where it brings the worst part nearer by this factor.
const NEARER: f64 = 0.7;
/// Segments without getting nearer by this factor after which parts are set down anyway, where no part ends much
/// farther away.
const PATIENCE: usize = 8;
const GETS_NEARER: f64 = 0.85;
const FARTHER: f64 = 1.2;

/// Segments without getting nearer after which parts that hinder each other take a way round: five seconds, in which
/// most pass each other without one, and sooner.
const BLOCKED: usize = 75;

/// One segment of a motion without pauses.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// The motion. Its drive rises over one period, plays for another, which that of the last segment leaves out, and
    /// decays.
    pub pulse: FieldPulse,
    /// True for the last one, after which the parts rest.
    pub sets_down: bool,
    /// Forecast places at the end of its first period, m; of the last segment where the parts come to rest.
    pub ends_m: Vec<Vec2>,
}

/// Plans motions that never stop until all parts are at their targets (equation sheet, section 5.1). Follows the parts
/// by the camera's frames and by the motions that play.
#[derive(Clone, Debug)]
pub struct MovingPlanner {
    params: PlannerParams,
    model: Arc<MovingModel>,
    parts: Vec<PartFilter>,
    /// Step of the present segment up to which the parts were followed, and its last one.
    step: usize,
    end: usize,
    /// The motion before the present one, the present one, and the one planned after it.
    before: Arc<Motion>,
    present: Arc<Motion>,
    planned: Arc<Motion>,
    is_resting: bool,
    /// A frame of the segment that begins next: time after its beginning, s, and the places of the parts.
    early: Option<(f64, Vec<Option<Vec2>>)>,
    /// The last motion that carried parts.
    last: Option<Arc<Motion>>,
    aims: Aims,
    /// Segments in a row that did not bring the parts nearer, and the root mean square distance that they got to, m.
    slow: usize,
    best_m: f64,
    pool: RolloutPool,
}

impl MovingPlanner {
    /// A planner for one rig's library and parts of these radii; `None` where the library has no fields or no friction.
    pub fn new(library: &Arc<Library>, params: PlannerParams, radii_m: &[f64]) -> Option<Self> {
        let model = MovingModel::of(library, params)?;
        let rest = Arc::new(Motion::rest(&model.basis));
        Some(Self {
            params,
            parts: radii_m.iter().map(|&radius_m| PartFilter::new(radius_m, model.friction)).collect(),
            step: 0,
            end: model.basis.steps_a_period(),
            before: Arc::clone(&rest),
            present: Arc::clone(&rest),
            planned: rest,
            is_resting: true,
            early: None,
            last: None,
            aims: Aims::default(),
            slow: 0,
            best_m: f64::INFINITY,
            pool: RolloutPool::default(),
            model,
        })
    }

    /// Length of a segment, s.
    pub fn period_s(&self) -> f64 {
        self.model.envelope.attack_s
    }

    /// Time from the beginning of a segment to the middle of the period in which its drifts are judged, s.
    pub fn ahead_s(&self) -> f64 {
        AHEAD * self.period_s()
    }

    /// The plate is at rest, and the parts rest at `places_m`.
    pub fn rest(&mut self, places_m: &[Vec2]) {
        let rest = Arc::new(Motion::rest(&self.model.basis));
        self.parts.iter_mut().zip(places_m).for_each(|(part, &place_m)| part.rest(place_m));
        (self.before, self.present, self.planned) = (Arc::clone(&rest), Arc::clone(&rest), rest);
        (self.step, self.is_resting, self.early) = (0, true, None);
    }

    /// The planned segment begins to play.
    pub fn begin(&mut self) {
        if !self.is_resting {
            self.advance(self.end);
        }
        self.before = std::mem::replace(&mut self.present, Arc::clone(&self.planned));
        (self.step, self.end, self.is_resting) = (0, self.model.basis.steps_a_period(), false);
        if let Some((at_s, seen_m)) = self.early.take() {
            self.observe(at_s, &seen_m);
        }
    }

    /// The present segment plays for `time_s`, one period or two, until the next one begins.
    pub fn plays_for(&mut self, time_s: f64) {
        self.end = (time_s / self.period_s()).round().clamp(1.0, 2.0) as usize * self.model.basis.steps_a_period();
    }

    /// Takes a frame exposed `at_s` after the present segment began; `seen_m` are the places of the parts in it, `None`
    /// for those that it does not show. A frame exposed after the segment's end counts once the next one begins.
    pub fn observe(&mut self, at_s: f64, seen_m: &[Option<Vec2>]) {
        let step_s = self.model.basis.step_s();
        let after_s = at_s - self.end as f64 * step_s;
        if after_s > 0.0 {
            self.early = Some((after_s, seen_m.to_vec()));
            return;
        }
        let step = (at_s / step_s).round().max(0.0) as usize;
        self.advance(step);
        let early_s = self.step as f64 * step_s - at_s;
        for (part, seen_m) in self.parts.iter_mut().zip(seen_m) {
            if let Some(seen_m) = seen_m {
                part.correct(seen_m + part.disc().velocity_mps * early_s);
            }
        }
    }

    /// Time of the present segment up to which the parts were followed, s.
    pub fn reached_s(&self) -> f64 {
        self.step as f64 * self.model.basis.step_s()
    }

    /// Time from there until the next segment begins, s.
    pub fn left_s(&self) -> f64 {
        self.end.saturating_sub(self.step) as f64 * self.model.basis.step_s()
    }

    /// Estimated places of the parts, m.
    pub fn places_m(&self) -> Vec<Vec2> {
        self.parts.iter().map(|part| part.disc().position_m).collect()
    }

    /// Follows the parts up to `step` of the present segment.
    fn advance(&mut self, step: usize) {
        if step <= self.step {
            return;
        }
        let after_s = (step - self.step) as f64 * self.model.basis.step_s();
        let rollout = self.rollout(self.step..step);
        self.parts.iter_mut().zip(rollout.last()).for_each(|(part, state)| part.predict(state, after_s));
        self.pool.keep(rollout);
        self.step = step;
    }

    /// The parts over `steps` of the present segment.
    fn rollout(&self, steps: Range<usize>) -> Rollout {
        let discs: Vec<RolloutDisc> = self.parts.iter().map(PartFilter::disc).collect();
        let MovingModel { basis, envelope, .. } = &*self.model;
        let mut rollout = self.pool.take();
        rollout.run_faded(basis, [&self.before.plate, &self.present.plate], (envelope, steps), &discs);
        rollout
    }

    /// Forecast places of the parts at the end of the present segment, m: those for which the next one is planned.
    pub fn next_places_m(&self) -> Vec<Vec2> {
        self.next_states().into_iter().map(|(place_m, ..)| place_m).collect()
    }

    /// Place, velocity and drift of every part at the end of the present segment.
    fn next_states(&self) -> Vec<(Vec2, Vec2, Vec2)> {
        if self.is_resting {
            return self.places_m().into_iter().map(|place_m| (place_m, Vec2::zeros(), Vec2::zeros())).collect();
        }
        if self.step >= self.end {
            let discs = self.parts.iter().map(PartFilter::disc);
            return discs.map(|disc| (disc.position_m, disc.velocity_mps, disc.velocity_mps)).collect();
        }
        let rollout = self.rollout(self.step..self.end);
        let over_s = (self.end - self.step) as f64 * self.model.basis.step_s();
        let state = |((place_m, velocity_mps), part): ((Vec2, Vec2), &PartFilter)| {
            let from = part.disc();
            let drift_mps = (place_m - from.position_m) / over_s + (velocity_mps - from.velocity_mps) * 0.5;
            (place_m, velocity_mps, drift_mps)
        };
        let states = rollout.last().zip(&self.parts).map(state).collect();
        self.pool.keep(rollout);
        states
    }

    /// Where the parts come to rest, m, if no segment follows the present one, which plays once more and fades out;
    /// beside it whether they keep their distances, from each other and from the edge, on the way.
    pub fn fades_out(&self) -> (Vec<Vec2>, bool) {
        let period = self.model.basis.steps_a_period();
        let rollout = self.rollout(self.step..3 * period);
        let is_clear = rollout.places_m(period / 4).all(|places_m| self.are_apart(&places_m));
        let ends_m = rollout.ends_m.clone();
        self.pool.keep(rollout);
        (ends_m, is_clear)
    }

    /// True for places that keep the distances between parts and from the edge.
    fn are_apart(&self, places_m: &[Vec2]) -> bool {
        let PlannerParams { half_side_m, edge_margin_m, separation_m, .. } = self.params;
        places_m.iter().zip(&self.parts).enumerate().all(|(i, (at_m, part))| {
            let radius_m = part.disc().radius_m;
            let mut others = places_m[..i].iter().zip(&self.parts);
            at_m.amax() + radius_m <= half_side_m - edge_margin_m
                && others.all(|(to_m, other)| (at_m - to_m).norm() >= radius_m + other.disc().radius_m + separation_m)
        })
    }

    /// Plans the segment after the present one, or the first one; [`Self::begin`] begins it. Parts that hinder each
    /// other take the way by their subgoals.
    pub fn plan(&mut self, headings: &[Heading]) -> Segment {
        let states = self.next_states();
        let to_rest = states.iter().zip(headings).filter(|(_, heading)| heading.along_mps.is_none());
        let rms_m = rms(to_rest.map(|((place_m, ..), heading)| (heading.target_m - place_m).norm()));
        let is_slow = rms_m > GETS_NEARER * self.best_m;
        self.slow = if is_slow { self.slow + 1 } else { 0 };
        self.best_m = if is_slow { self.best_m.min(rms_m) } else { rms_m };
        let goes_round = self.slow > BLOCKED;
        let part = |(((position_m, velocity_mps, drift_mps), heading), part): ((_, &Heading), &PartFilter)| {
            let Heading { mut target_m, subgoal_m, along_mps } = *heading;
            let disc = RolloutDisc { position_m, velocity_mps, ..part.disc() };
            let mut beyond_m = 0.0;
            if goes_round {
                (target_m, beyond_m) = (subgoal_m, (target_m - subgoal_m).norm());
            }
            MovingPart { disc, drift_mps, target_m, beyond_m, along_mps }
        };
        let parts: Vec<MovingPart> = states.into_iter().zip(headings).zip(&self.parts).map(part).collect();
        let comes_to_rest = rms_m < SET_DOWN_M && headings.iter().all(|heading| heading.along_mps.is_none());
        let set_down = if comes_to_rest { self.set_down(&parts) } else { None };
        let sets_down = set_down.is_some();
        let (motion, ends_m) = set_down.unwrap_or_else(|| self.drift(&parts));
        self.planned = Arc::new(motion);
        if sets_down {
            (self.slow, self.best_m) = (0, f64::INFINITY);
        } else {
            self.last = Some(Arc::clone(&self.planned));
        }
        let wave = self.model.basis.wave(&self.planned.coefficients);
        let sustain_s = if sets_down { 0.0 } else { self.model.envelope.sustain_s };
        Segment { pulse: FieldPulse { wave, follows: Follows::Displacement, sustain_s }, sets_down, ends_m }
    }

    /// The search for the drifts of `wish`, or for a motion after which the parts rest at their targets.
    fn problem<'a>(&'a self, parts: &'a [MovingPart], wish: Option<&'a Wish>) -> SegmentProblem<'a> {
        // where it is at the beginning, and where it drifts in the segment
        let places = parts.iter().flat_map(|part| [0.0, self.period_s()].map(|after_s| (part, after_s)));
        let edges = places.flat_map(|(part, after_s)| {
            let place_m = part.disc.position_m + part.drift_mps * after_s;
            NearEdge::of(place_m, part.disc.radius_m, self.params.half_side_m)
        });
        let (discs, edges) = (parts.iter().map(|part| part.disc).collect(), edges.collect());
        let (model, params, last, pool) = (&self.model, &self.params, &self.present, &self.pool);
        SegmentProblem { model, params, last, parts, discs, edges, wish, pool }
    }

    /// The motion that brings the parts' drifts nearest to what their distances ask, and their places at its end.
    fn drift(&mut self, parts: &[MovingPart]) -> (Motion, Vec<Vec2>) {
        let wish = self.aims.wish(parts, &self.params, self.period_s());
        let problem = self.problem(parts, Some(&wish));
        let better = |a: Shot, b: Shot| {
            let (better, other) = if b.cost < a.cost { (b, a) } else { (a, b) };
            self.pool.keep(other.rollout);
            better
        };
        let rounds = if self.is_resting { FROM_REST_ROUNDS } else { FIRST_ROUNDS };
        let starts = self.starts(&problem.discs, &wish.changes_mps);
        let improved = |start: &Vec<f64>, rounds: usize| problem.improved(problem.shot(start, 0.0), rounds);
        let still = || problem.shot(&self.present.coefficients, 0.0);
        let best = starts.iter().map(|start| improved(start, rounds)).reduce(better).unwrap_or_else(still);
        let mut best = problem.improved(best, ROUNDS);
        if wish.is_clipped && !self.is_resting && wish.left(&best.residual) > MUCH_LEFT {
            let starts = self.bank(&problem.discs, &wish.changes_mps, BANK);
            if let Some(other) = starts.iter().map(|start| improved(start, BANK_FIRST_ROUNDS)).reduce(better) {
                let other = problem.improved(other, BANK_ROUNDS);
                if other.cost < BETTER * best.cost {
                    best = better(best, other);
                } else {
                    self.pool.keep(other.rollout);
                }
            }
        }
        let best = problem.constrained(best);
        let left = wish.left(&best.residual);
        let ends_m = best.rollout.places_at(self.model.basis.steps_a_period());
        self.pool.keep(best.rollout);
        self.aims.learn(wish.is_clipped, left);
        (best.motion, ends_m)
    }

    /// Motions from which the search starts.
    fn starts(&self, discs: &[RolloutDisc], changes_mps: &[Vec2]) -> Vec<Vec<f64>> {
        if self.is_resting {
            let last = self.last.iter().map(|last| last.coefficients.clone());
            return self.bank(discs, changes_mps, BANK_FROM_REST).into_iter().chain(last).collect();
        }
        let even = |j: usize| self.model.basis.harmonic_of(j).is_multiple_of(2);
        let reversed = |(j, c): (usize, &f64)| if even(j) { REVERSED * c } else { *c };
        let present = &self.present.coefficients;
        vec![present.clone(), present.iter().enumerate().map(reversed).collect()]
    }

    fn bank(&self, discs: &[RolloutDisc], steps: &[Vec2], count: usize) -> Vec<Vec<f64>> {
        let places_m: Vec<Vec2> = discs.iter().map(|disc| disc.position_m).collect();
        self.model.seeds.best(&self.model.basis, &places_m, steps, count)
    }

    /// The motion after which the parts rest at their targets, and where they do; `None` where none brings them near
    /// enough.
    fn set_down(&self, parts: &[MovingPart]) -> Option<(Motion, Vec<Vec2>)> {
        let problem = self.problem(parts, None);
        let worst_m = parts.iter().map(|part| part.left_m().norm()).fold(0.0, f64::max);
        let first = if self.is_resting { self.last.as_deref() } else { Some(&*self.present) };
        let mut starts: Vec<Vec<f64>> = first.iter().map(|motion| motion.coefficients.clone()).collect();
        if worst_m < 3.0 * SET_DOWN_M {
            let ahead_s = 0.75 * self.period_s();
            let steps: Vec<Vec2> = parts.iter().map(|part| part.left_m() - part.drift_mps * ahead_s).collect();
            starts.extend(self.bank(&problem.discs, &steps, BANK));
        }
        let mut best: Option<(f64, Motion, Vec<Vec2>)> = None;
        for start in &starts {
            let shot = problem.improved(problem.shot(start, 0.0), BANK_ROUNDS);
            let off_m = shot.worst();
            if best.as_ref().is_none_or(|(best_m, ..)| off_m < *best_m) {
                best = Some((off_m, shot.motion, shot.rollout.ends_m.clone()));
            }
            self.pool.keep(shot.rollout);
            if off_m < 0.5 * SET_DOWN_WITHIN_M {
                break;
            }
        }
        let (off_m, motion, ends_m) = best?;
        let is_worth_it = off_m < SET_DOWN_WITHIN_M
            || (self.is_resting && off_m < NEARER * worst_m)
            || (self.slow > PATIENCE && off_m < FARTHER * worst_m);
        is_worth_it.then_some((motion, ends_m))
    }
}
