use std::sync::Arc;

use nalgebra::DVector;

use super::harmonic_basis::HarmonicBasis;
use super::limits::{Clearances, most_violated};
use super::motor_effort::MotorEffort;
use super::optimizer::{Iterate, RolloutPool, ShootingProblem};
use super::rollout::{Rollout, RolloutDisc};
use super::seeds::SeedLibrary;
use super::separation::SeparationPenalty;
use crate::cor_library::Library;
use crate::planner::cache::Cache;
use crate::planner::friction::friction_of;
use crate::planner::{Corridor, FieldPulse, Limit, PartState, Plan, PlanStatus, PlannedPulse, PlannerParams};
use upm_core::geometry::Vec2;
use upm_core::signal::{Envelope, Follows};

/// Motions of the seed library that are tried beside the last one; rounds of improvement of each, and of the best of
/// them.
const STARTS: usize = 1;
const FIRST_ROUNDS: usize = 4;
const ROUNDS: usize = 5;
/// Rounds of improvement after a penalty is added or raised; attempts at that; distance added by each, m.
const PENALTY_ROUNDS: usize = 2;
const MOST_GUARDED: usize = 4;
const PUSH_M: f64 = 2e-3;
/// Attempts at a plan; each after the first asks for half the steps, or starts from other motions.
const ATTEMPTS: usize = 5;
/// The last plan failed when its error exceeds this fraction of the remaining steps.
const BROKEN_PROMISE: f64 = 0.5;
/// Skipped motions of the seed library after which the best are tried again.
const MOST_PASSED_OVER: usize = 64 * STARTS;
/// Root mean square of the steps aimed at with a pulse of full length: at first and at least, and at most.
const REACH_M: f64 = 20e-3;
const MOST_REACH_M: f64 = 40e-3;
/// Least steps for which a pulse has full length: parts that obstruct each other need long pulses for small steps.
const LEAST_NEAR_M: f64 = 10e-3;
/// Largest step asked of any part, relative to the root mean square.
const LONGEST: f64 = 1.8;
/// Sustain equivalent to both flanks, in attack times.
const FLANK: f64 = 1.2;
/// Amplitude of a shaken part's sway about its path, m.
const SWAY_M: f64 = 0.25e-3;
/// For parts in corridors: factor of the rounds of improvement, starts tried in all, share of the steps left below
/// which no other is tried, and shortest steps for a pulse of full length relative to other tasks. Their speed is
/// given, so pulses need not be as short as possible.
const CAREFUL: usize = 3;
const CAREFUL_STARTS: usize = 12;
const CAREFUL_LEFT: f64 = 0.05;
const CAREFUL_NEAR: f64 = 0.5;
/// Share of its distance from the edge that a part keeps from the edge of the shaken plate.
const LEAST_SHARE: f64 = 0.3;
/// Instants per period at which the limits are checked.
const OBSERVATIONS: usize = 4;

/// Finds, for each cycle, one motion that gives every part its step at once (equation sheet, section 5).
#[derive(Clone, Debug)]
pub struct FieldPlanner {
    params: PlannerParams,
    model: Arc<FieldModel>,
    /// Largest root mean square of the steps aimed at, m.
    reach_m: f64,
    /// Root mean square of the steps from which a pulse has full length, m.
    near_m: f64,
    last: Option<Vec<f64>>,
    /// Final positions forecast by the last plan, m; empty when there was none.
    promised_m: Vec<Vec2>,
    /// Number of the seed library's best motions that are skipped.
    passed_over: usize,
    pool: RolloutPool,
}

/// The tables that the planner computes of a library.
#[derive(Debug)]
struct FieldModel {
    attack_s: f64,
    rest_s: f64,
    basis: HarmonicBasis,
    /// For parts in corridors.
    path_basis: HarmonicBasis,
    effort: MotorEffort,
    seeds: SeedLibrary,
    friction: f64,
}

static COMPUTED: Cache<(Arc<Library>, PlannerParams), Option<Arc<FieldModel>>> = Cache::new();

impl FieldModel {
    fn new((library, params): &(Arc<Library>, PlannerParams)) -> Option<Arc<Self>> {
        let fields = library.fields.as_ref()?;
        let basis = HarmonicBasis::new(fields.base_radps, fields.twist_from_counts.len(), params.half_side_m);
        Some(Arc::new(Self {
            attack_s: fields.attack_s,
            rest_s: fields.rest_s,
            path_basis: basis.for_paths(),
            effort: MotorEffort::new(&basis, library, params.half_side_m)?,
            seeds: SeedLibrary::new(&basis, params.half_side_m),
            basis,
            friction: friction_of(library)?,
        }))
    }
}

impl FieldPlanner {
    /// A planner for one rig's library; `None` where the library has no synthesised motions or no friction.
    pub fn new(library: &Arc<Library>, params: PlannerParams) -> Option<Self> {
        let model = COMPUTED.get((Arc::clone(library), params), FieldModel::new);
        Some(Self {
            params,
            model: Option::clone(&model)?,
            reach_m: REACH_M,
            near_m: REACH_M,
            last: None,
            promised_m: Vec::new(),
            passed_over: 0,
            pool: RolloutPool::default(),
        })
    }

    /// Plans one cycle: a pulse that gives every part as much of its step as one pulse can, and keeps those with a
    /// corridor near its middle.
    pub fn plan(&mut self, parts: &[PartState], corridors: &[Option<Corridor>]) -> Plan {
        if let Some(status) = self.params.nothing_to_plan(parts) {
            return status.into();
        }
        let rms_m = (parts.iter().map(|p| p.step_m.norm_squared()).sum::<f64>() / parts.len() as f64).sqrt();
        self.judge_last(parts, rms_m);
        let mut wanted_m = rms_m.min(self.reach_m);
        let (mut stopped_by, mut again) = (Limit::Unreachable, None);
        for _ in 0..ATTEMPTS {
            match self.attempt((parts, corridors), rms_m, wanted_m, again.take()) {
                Ok(plan) => return plan,
                Err((Limit::Unreachable, _)) => self.restart_from_seed(),
                Err((by, motion)) => (stopped_by, again, wanted_m) = (by, Some(motion), 0.5 * wanted_m),
            }
        }
        PlanStatus::Infeasible(stopped_by).into()
    }

    /// Decides whether the last motion is a good start: not when most of the remaining distance is that motion's own
    /// error. Small steps would stall with a motion that does not move the parts as forecast, because it would be
    /// planned again and again.
    fn judge_last(&mut self, parts: &[PartState], rms_m: f64) {
        let promised = std::mem::take(&mut self.promised_m);
        if promised.len() != parts.len() {
            return;
        }
        let off_sq: f64 = promised.iter().zip(parts).map(|(p, part)| (p - part.position_m).norm_squared()).sum();
        if (off_sq / parts.len() as f64).sqrt() > BROKEN_PROMISE * rms_m {
            self.restart_from_seed();
        } else {
            self.passed_over = 0;
        }
    }

    /// Drops the last motion and advances to the next start motions of the seed library.
    fn restart_from_seed(&mut self) {
        self.last = None;
        self.passed_over = (self.passed_over + STARTS) % MOST_PASSED_OVER;
    }

    /// Pushes of all start motions on parts at rest at `positions_m`: for each motion the mean direction of the slip, a
    /// vector of length at most 1.
    pub fn mean_forces(&self, positions_m: &[Vec2]) -> impl Iterator<Item = Vec<Vec2>> {
        self.model.seeds.all_mean_forces(positions_m)
    }

    /// Forecast positions of `parts` after `pulse`, m.
    pub fn forecast(&self, parts: &[PartState], pulse: &FieldPulse) -> Vec<Vec2> {
        let mut rollout = self.pool.take();
        let basis = if pulse.follows == Follows::Velocity { &self.model.basis } else { &self.model.path_basis };
        let coefficients = basis.coefficients(&pulse.wave);
        rollout.run(basis, &coefficients, &self.envelope(pulse.sustain_s), &self.discs(parts));
        let ends_m = rollout.ends_m.clone();
        self.pool.keep(rollout);
        ends_m
    }

    /// Number of a motion's coefficients.
    pub fn coefficients(&self) -> usize {
        self.model.basis.len()
    }

    /// The pulse whose coefficients are these shares, -1 to 1, of their spans. A motion beyond the motors' limit, as
    /// those with a share of 1 are, is scaled down to it.
    pub fn pulse_of(&self, shares: &[f64], sustain_s: f64) -> FieldPulse {
        let FieldModel { basis, effort, .. } = &*self.model;
        let mut coefficients: Vec<f64> = effort.spans().zip(shares).map(|(span, share)| span * share).collect();
        coefficients.resize(basis.len(), 0.0);
        effort.scale(basis, &mut coefficients, 1.0);
        FieldPulse { wave: basis.wave(&coefficients), follows: basis.follows, sustain_s }
    }

    /// The inverse of [`Self::pulse_of`] for a pulse at the motors' limit, as plans have: the largest share is 1.
    pub fn shares_of(&self, pulse: &FieldPulse) -> Vec<f64> {
        let coefficients = self.model.basis.coefficients(&pulse.wave);
        let shares = coefficients.iter().zip(self.model.effort.spans()).map(|(c, span)| c / span);
        let largest = shares.clone().fold(f64::MIN_POSITIVE, |largest, share| largest.max(share.abs()));
        shares.map(|share| share / largest).collect()
    }

    /// A pulse for steps of `wanted_m` root mean square that keeps the limits, found from `again` or from scratch; else
    /// the limit that prevents it, and the motion found before limits were applied, a start for the next attempt.
    fn attempt(
        &mut self,
        (parts, corridors): (&[PartState], &[Option<Corridor>]),
        rms_m: f64,
        wanted_m: f64,
        again: Option<Vec<f64>>,
    ) -> Result<Plan, (Limit, Vec<f64>)> {
        let shorter = |p: &PartState| p.step_m * ((LONGEST * rms_m / p.step_m.norm()).min(1.0) * wanted_m / rms_m);
        let steps: Vec<Vec2> =
            parts.iter().map(|p| if p.step_m == Vec2::zeros() { p.step_m } else { shorter(p) }).collect();
        let steps_m = DVector::from_iterator(2 * steps.len(), steps.iter().flat_map(|s| [s.x, s.y]));
        let discs = self.discs(parts);
        let envelope = self.envelope(self.sustain_s(wanted_m));
        let near = SeparationPenalty::of_near(parts, self.params.separation_m, steps_m.as_slice());
        let free = ShootingProblem {
            basis: if corridors.is_empty() { &self.model.basis } else { &self.model.path_basis },
            effort: &self.model.effort,
            discs: &discs,
            steps_m: &steps_m,
            envelope: &envelope,
            penalties: &near,
            corridors,
            pool: &self.pool,
        };
        let iterate = match again {
            Some(motion) => free.improved(free.regularized_step(&motion), ROUNDS),
            None => self.best_iterate(&free, parts, &steps),
        };
        let motion = iterate.coefficients.clone();
        let iterate = self.cleared(iterate, &free, parts).map_err(|by| (by, motion))?;
        let left = iterate.left(&steps_m);
        let predicted_m = vec![iterate.rollout.ends_m.clone()];
        self.promised_m.clone_from(&iterate.rollout.ends_m);
        let wave = self.model.basis.wave(&iterate.coefficients);
        let pulse =
            PlannedPulse::Field(FieldPulse { wave, follows: free.basis.follows, sustain_s: envelope.sustain_s });
        let corridor_excess = iterate.corridor_excess(corridors);
        self.learn_reach(wanted_m, left, !corridors.is_empty());
        self.last = Some(iterate.coefficients.clone());
        self.pool.keep(iterate.rollout);
        Ok(Plan { status: PlanStatus::Solved, pulses: vec![pulse], predicted_m, corridor_excess, ..Plan::default() })
    }

    /// `iterate`, changed until it keeps the limits, with penalties where necessary.
    fn cleared(&self, mut iterate: Iterate, free: &ShootingProblem<'_>, parts: &[PartState]) -> Result<Iterate, Limit> {
        let mut penalties = free.penalties.to_vec();
        for tried in 0.. {
            let Some(limit) = self.broken(free.basis, &iterate.rollout, parts) else { break };
            if tried == MOST_GUARDED {
                return Err(limit);
            }
            match penalties.iter_mut().find(|penalty| penalty.limit == limit) {
                Some(penalty) => penalty.push(PUSH_M),
                None => penalties.extend(SeparationPenalty::of_limit(limit, parts, free.steps_m.as_slice())),
            }
            let penalised = ShootingProblem { penalties: &penalties, ..*free };
            iterate = penalised.improved(penalised.iterate(&iterate.coefficients), PENALTY_ROUNDS);
        }
        if iterate.left(free.steps_m) < 1.0 {
            return Ok(iterate);
        }
        // a detour is acceptable only when the destination itself is allowed
        match most_violated(parts, &self.params, free.steps_m.as_slice()) {
            Some(limit) => Err(limit),
            None if penalties.is_empty() => Err(Limit::Unreachable),
            None => Ok(iterate),
        }
    }

    /// Improves the last motion and a few of the seed library, then the best of them further; for parts in corridors
    /// one after another, the last motion first, until one leaves little of the steps.
    fn best_iterate(&self, problem: &ShootingProblem<'_>, parts: &[PartState], steps: &[Vec2]) -> Iterate {
        let positions: Vec<Vec2> = parts.iter().map(|part| part.position_m).collect();
        let is_careful = !problem.corridors.is_empty();
        let count = if is_careful { CAREFUL_STARTS } else { STARTS };
        let starts = self.model.seeds.best(&self.model.basis, &positions, steps, self.passed_over + count);
        let starts = self.last.iter().chain(starts.iter().skip(self.passed_over));
        let better = |a: Iterate, b: Iterate| {
            let (better, other) = if b.left(problem.steps_m) < a.left(problem.steps_m) { (b, a) } else { (a, b) };
            self.pool.keep(other.rollout);
            better
        };
        let first = |start: &Vec<f64>| problem.improved(problem.regularized_step(start), FIRST_ROUNDS);
        let still = || problem.iterate(&vec![0.0; self.model.basis.len()]);
        if !is_careful {
            return problem.improved(starts.map(first).reduce(better).unwrap_or_else(still), ROUNDS);
        }
        let mut best = still();
        for start in starts {
            best = better(best, problem.improved(first(start), CAREFUL * ROUNDS));
            if best.left(problem.steps_m) < CAREFUL_LEFT {
                break;
            }
        }
        best
    }

    /// The first limit broken along the rollout, or at its end, where sway no longer applies.
    fn broken(&self, basis: &HarmonicBasis, rollout: &Rollout, parts: &[PartState]) -> Option<Limit> {
        let clearances = Clearances::of(parts, &self.params);
        let start_m: Vec<Vec2> = parts.iter().map(|part| part.position_m).collect();
        let mut before_m = start_m.clone();
        let every = basis.steps_a_period() / OBSERVATIONS;
        for places_m in rollout.places_m(every) {
            if let Some(limit) = clearances.broken_after(&start_m, &before_m, &places_m, SWAY_M) {
                return Some(limit);
            }
            before_m = places_m;
        }
        let at_end = clearances.broken_after(&start_m, &rollout.ends_m, &rollout.ends_m, 0.0);
        at_end.or_else(|| {
            let part = rollout.edge_shares(self.params.half_side_m).iter().position(|share| *share < LEAST_SHARE)?;
            Some(Limit::Edge { part })
        })
    }

    /// Sustain for steps of `wanted_m`, s: distance grows with the square of the time.
    fn sustain_s(&self, wanted_m: f64) -> f64 {
        let flanks_s = FLANK * self.model.attack_s;
        let longest_s = self.params.max_sustain_s;
        ((longest_s + flanks_s) * (wanted_m / self.near_m).min(1.0).sqrt() - flanks_s).clamp(0.0, longest_s)
    }

    /// Adapts the reach: farther after pulses that made nearly the whole step, nearer after those that left much of it.
    /// Close to the goal it adapts the pulse length instead.
    fn learn_reach(&mut self, wanted_m: f64, left: f64, is_careful: bool) {
        let factor = |(enough, longer): (f64, f64), (poor, shorter): (f64, f64)| match left {
            left if left < enough => longer,
            left if left > poor => shorter,
            _ => 1.0,
        };
        if wanted_m >= self.reach_m {
            self.reach_m = (factor((0.3, 1.5), (0.6, 0.75)) * self.reach_m).clamp(REACH_M, MOST_REACH_M);
            self.near_m = self.reach_m;
        } else {
            let (enough, poor) = if is_careful { (0.5 * CAREFUL_LEFT, CAREFUL_LEFT) } else { (0.2, 0.5) };
            let least_m = if is_careful { CAREFUL_NEAR * LEAST_NEAR_M } else { LEAST_NEAR_M };
            self.near_m = (factor((enough, 1.1), (poor, 0.8)) * self.near_m).clamp(least_m, self.reach_m);
        }
    }

    fn envelope(&self, sustain_s: f64) -> Envelope {
        Envelope { attack_s: self.model.attack_s, sustain_s, rest_s: self.model.rest_s }
    }

    fn discs(&self, parts: &[PartState]) -> Vec<RolloutDisc> {
        let disc = |part: &PartState| RolloutDisc {
            position_m: part.position_m,
            velocity_mps: Vec2::zeros(),
            radius_m: part.radius_m,
            friction: self.model.friction * part.gain,
        };
        parts.iter().map(disc).collect()
    }
}
