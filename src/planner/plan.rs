use std::sync::Arc;

use super::candidates::{Belts, add_best, starting_set, survey};
use super::field::Columns;
use super::limits::most_violated;
use super::program::{self, Solution, Variable};
use super::sequence::{Flow, Sequence, arrange};
use super::task::Task;
use super::{Limit, PartState, Plan, PlanStatus, PlannedPulse, PlannerParams, Rotation, sparsify};
use upm_core::geometry::Vec2;
use upm_library::Library;

/// How much of the steps a smaller set of pulses may leave undone, and below which error nothing is gained.
const LEFT_UNDONE: f64 = 0.15;
const LEFT_UNDONE_M: f64 = 0.15e-3;

/// Ways of several parts beyond this are gone in strides, m, and this is a typical stride.
const FAR_M: f64 = 10e-3;
const STRIDE_M: f64 = 12e-3;

/// A program that leaves less than this part of the error does enough; else it is solved again at a price this many
/// times lower, this often at most.
const ENOUGH: f64 = 0.35;
const CHEAPER: f64 = 0.2;
const CHEAPEST: u32 = 4;

/// A stride that gets on by less than this part of the ways in a second is not worth it where a sequence is found.
const BRISK_PER_S: f64 = 0.06;

/// Fewest candidates, however few parts.
const MIN_CANDIDATES: usize = 12;

/// |d| from which on the program made use of a column, m.
const USED_M: f64 = 1e-5;

/// One pulse that leaves less than this part of the error is enough.
const ALONE: f64 = 0.08;

/// Single pulses that are forecast exactly before the best is taken. One part alone, which a pulse can always serve,
/// goes on until one is good enough: where the first eight centres are all near it, each carries it round an arc.
const FORECASTS: usize = 8;

/// A sequence is worth playing when it leaves less than this part of the error.
const BETTER: f64 = 0.998;

/// Step away from a limit that stopped everything, m.
const ROOM_M: f64 = 2e-3;

/// Parts of the wanted step that are tried when the sequence of the whole does not keep the limits.
const FRACTIONS: [f64; 3] = [1.0, 0.5, 0.25];

/// Turns wanted steps into a sequence of pulses.
#[derive(Clone, Debug)]
pub struct Planner {
    pub(super) library: Arc<Library>,
    pub(super) params: PlannerParams,
    pub(super) columns: Columns,
    /// How often the price was lowered for the last plan.
    cheaper: u32,
}

impl Planner {
    /// A planner for one rig's library.
    pub fn new(library: Arc<Library>, params: PlannerParams) -> Self {
        Self { library, params, columns: Columns::default(), cheaper: 0 }
    }

    /// What it may and wants to do.
    pub fn params(&self) -> &PlannerParams {
        &self.params
    }

    /// Plans one cycle: the pulses that bring every part its step, or as much of it as the limits leave.
    ///
    /// Where no order of pulses gets past a limit that the steps themselves keep, the plan makes room instead: the
    /// parts of that limit go away from it and the steps wait for the next cycle.
    pub fn plan(&mut self, parts: &[PartState]) -> Plan {
        let Some(task) = Task::of(parts, &self.params) else {
            return ended(PlanStatus::SolverFailed("a part is not where numbers are".into()), Vec::new());
        };
        if task.largest_m < 0.5 * self.params.min_distance_m {
            return ended(PlanStatus::NothingToDo, Vec::new());
        }
        let is_far = parts.len() > 1 && task.largest_m > FAR_M;
        let mut slow = None;
        if is_far {
            self.survey(&task, STRIDE_M, Belts::Fast);
            match self.stride(&task) {
                Ok(stride) if stride.share_per_s >= BRISK_PER_S => return solved(stride.sequence, Vec::new()),
                stride => slow = stride.ok(),
            }
        }
        let near = if is_far { task.within(FAR_M, &self.params) } else { task };
        let plan = self.attempt_on_belts(&near);
        let PlanStatus::Infeasible(limit) = plan.status else { return plan };
        if let Some(stride) = slow {
            return solved(stride.sequence, Vec::new());
        }
        if most_violated(&near.half_spaces, &near.wanted_m) == Some(limit) {
            return plan;
        }
        if let Ok(stride) = self.stride(&near) {
            return solved(stride.sequence, Vec::new());
        }
        let room = self.attempt(&near.making_room(limit, ROOM_M));
        if room.status == PlanStatus::Solved { room } else { plan }
    }

    /// Several parts on fast belts alone, if that will do.
    fn attempt_on_belts(&mut self, task: &Task<'_>) -> Plan {
        if task.parts.len() > 1 {
            self.survey(task, task.largest_m, Belts::Fast);
            let plan = self.attempt(task);
            if plan.status == PlanStatus::Solved {
                return plan;
            }
        }
        self.survey(task, task.largest_m, Belts::InGear);
        self.attempt(task)
    }

    /// Looks up the flows of all entries for steps of up to `largest_m`.
    fn survey(&mut self, task: &Task<'_>, largest_m: f64, belts: Belts) {
        let sustain_s = self.typical_sustain_s(largest_m);
        survey(&mut self.columns, &self.library, task.parts, sustain_s, largest_m, belts);
    }

    fn attempt(&mut self, task: &Task<'_>) -> Plan {
        let (candidates, relaxed) = match self.relax_enough(task) {
            Ok(found) => found,
            Err(words) => return ended(PlanStatus::SolverFailed(words), Vec::new()),
        };
        let alone = self.single_pulse(task);
        let found = match alone {
            Some(alone) if task.left_by(&alone) < ALONE => Ok(alone),
            alone => {
                let support = self.sparsify(task, &candidates, &relaxed);
                self.sequence(task, &support).or_else(|limit| alone.ok_or(limit))
            }
        };
        let limit = match found {
            Ok(sequence) => return solved(sequence, candidates),
            Err(limit) => most_violated(&task.half_spaces, &task.wanted_m).or(limit),
        };
        ended(PlanStatus::Infeasible(limit.unwrap_or(Limit::Unreachable)), candidates)
    }

    /// The sustain of a pulse that makes the largest step on a fast belt, s.
    fn typical_sustain_s(&self, largest_m: f64) -> f64 {
        let model = &self.library.displacement;
        let fast = model.speed_mps.last().copied().unwrap_or(0.0);
        let typical_m = (0.7 * largest_m).clamp(model.min_distance(fast), model.max_distance(fast));
        model.sustain_for(fast, typical_m).unwrap_or(0.0)
    }

    /// The sparse program at the highest price at which it does most of what is wanted: steps that are hard to make
    /// together are not worth it at a price that suits easy ones. Starts one price above the last one that did.
    fn relax_enough(&mut self, task: &Task<'_>) -> Result<(Vec<usize>, Solution), String> {
        self.cheaper = self.cheaper.saturating_sub(1);
        loop {
            let cost_m = self.params.sparsity * task.largest_m * CHEAPER.powi(self.cheaper as i32);
            let found = self.relax(task, cost_m)?;
            let left_m = task.wanted_m.iter().zip(&found.1.moved_m).map(|(w, m)| (w - m) * (w - m)).sum::<f64>().sqrt();
            if left_m < ENOUGH * task.error_m(&task.wanted_m, None) || self.cheaper >= CHEAPEST {
                return Ok(found);
            }
            self.cheaper += 1;
        }
    }

    /// The sparse program over candidates out of the whole library: solved over a starting set, then again over
    /// the columns that were used and those that its prices ask for.
    fn relax(&self, task: &Task<'_>, cost_m: f64) -> Result<(Vec<usize>, Solution), String> {
        let count = (self.params.candidates_per_part * task.parts.len()).max(MIN_CANDIDATES);
        let started = starting_set(&self.columns, &task.wanted_m, count / 2);
        let first = self.relax_over(task, &started, cost_m)?;
        let used = |&(_, d): &(&usize, &f64)| d.abs() > USED_M;
        let mut candidates: Vec<usize> = started.iter().zip(&first.distance_m).filter(used).map(|(&j, _)| j).collect();
        let already = candidates.len();
        add_best(&self.columns, &mut candidates, &first.prices_m, cost_m, count);
        if candidates.len() == already {
            return Ok((started, first));
        }
        let relaxed = self.relax_over(task, &candidates, cost_m)?;
        Ok((candidates, relaxed))
    }

    fn relax_over(&self, task: &Task<'_>, candidates: &[usize], cost_m: f64) -> Result<Solution, String> {
        let variable = |&entry: &usize| {
            let (_, high_m) = self.distance_bounds_m(entry, &task.positions_m);
            Variable { cost_m, low_m: -high_m, high_m }
        };
        let variables: Vec<Variable> = candidates.iter().map(variable).collect();
        program::solve(&self.columns.select(candidates), &variables, &[], &task.wanted_m, &task.half_spaces)
    }

    /// Entries that are enough, with the distance the relaxed program gave them, m.
    fn sparsify(&self, task: &Task<'_>, candidates: &[usize], relaxed: &Solution) -> Vec<(usize, f64)> {
        let found: Vec<(usize, f64)> = candidates.iter().copied().zip(relaxed.distance_m.iter().copied()).collect();
        let large = |&(_, d): &(usize, f64)| d.abs() >= 0.5 * self.params.min_distance_m;
        let large: Vec<(usize, f64)> = found.into_iter().filter(large).collect();
        let entries: Vec<usize> = large.iter().map(|&(entry, _)| entry).collect();
        let per_part_m = LEFT_UNDONE_M.max(LEFT_UNDONE * task.largest_m);
        let tolerance_m = per_part_m * (task.parts.len() as f64).sqrt();
        let columns = self.columns.select(&entries);
        let kept = sparsify::keep(&columns, &relaxed.moved_m, tolerance_m, self.params.max_pulses);
        kept.into_iter().map(|k| large[k]).collect()
    }

    /// A sequence of the supporting entries that keeps the limits all the way, for the whole step or a part of it.
    fn sequence(&self, task: &Task<'_>, support: &[(usize, f64)]) -> Result<Sequence, Option<Limit>> {
        let mut stopped_by = None;
        for fraction in FRACTIONS {
            let wanted: Vec<f64> = task.wanted_m.iter().map(|w| fraction * w).collect();
            let Some(pulses) = self.fitted(task, &wanted, support) else { continue };
            match arrange(self.flow(task), &task.clearances, &pulses) {
                Ok(first) => {
                    let best = self.refined(task, &wanted, first);
                    if task.left_by(&best) < BETTER {
                        return Ok(best);
                    }
                }
                Err(limit) => stopped_by = stopped_by.or(limit),
            }
        }
        Err(stopped_by)
    }

    /// The one pulse that lowers the error most within the limits; `None` when none does.
    fn single_pulse(&self, task: &Task<'_>) -> Option<Sequence> {
        let gain = |entry: usize| {
            let along = self.columns.dot(entry, &task.wanted_m);
            let length_sq = self.columns.dot(entry, self.columns.column(entry));
            let (low_m, high_m) = self.distance_bounds_m(entry, &task.positions_m);
            if length_sq <= 0.0 || high_m <= 0.0 {
                return (0.0, entry, 0.0);
            }
            let distance_m = (along.abs() / length_sq).clamp(low_m, high_m);
            (2.0 * distance_m * along.abs() - distance_m * distance_m * length_sq, entry, distance_m.copysign(along))
        };
        let mut gains: Vec<(f64, usize, f64)> = (0..self.columns.len()).map(gain).filter(|g| g.0 > 0.0).collect();
        gains.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        gains.truncate(64);
        let forecast = |(_, entry, distance_m)| {
            let found = arrange(self.flow(task), &task.clearances, &[(entry, distance_m)]).ok()?;
            let left = task.left_by(&found);
            (left < BETTER).then_some((left, found))
        };
        let mut best: Option<(f64, Sequence)> = None;
        for (count, (left, found)) in gains.into_iter().filter_map(forecast).enumerate() {
            let suffices = task.parts.len() > 1 || best.as_ref().is_some_and(|(least, _)| *least < ALONE);
            if count >= FORECASTS && suffices {
                break;
            }
            if best.as_ref().is_none_or(|(least, _)| left < *least) {
                best = Some((left, found));
            }
        }
        let (_, found) = best?;
        Some(self.refined(task, &task.wanted_m, found))
    }

    /// Where `parts` are forecast to be after `pulse`.
    pub fn forecast(&self, parts: &[PartState], pulse: &Rotation) -> Vec<Vec2> {
        let positions_m: Vec<Vec2> = parts.iter().map(|part| part.position_m).collect();
        Flow { library: &self.library, parts }.after(pulse, &positions_m)
    }

    pub(super) fn flow<'a>(&'a self, task: &Task<'a>) -> Flow<'a> {
        Flow { library: &self.library, parts: task.parts }
    }
}

fn solved(sequence: Sequence, candidates: Vec<usize>) -> Plan {
    let Sequence { pulses, predicted_m } = sequence;
    let pulses = pulses.into_iter().map(PlannedPulse::Rotation).collect();
    Plan { status: PlanStatus::Solved, pulses, candidates, predicted_m }
}

fn ended(status: PlanStatus, candidates: Vec<usize>) -> Plan {
    Plan { status, pulses: Vec::new(), candidates, predicted_m: Vec::new() }
}
