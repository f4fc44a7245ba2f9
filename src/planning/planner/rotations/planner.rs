use std::sync::Arc;

use super::displacement_matrix::{DisplacementMatrix, PulseScale};
use super::least_time::{LeastTime, best_paying};
use super::motion_set::{MotionSet, Pulse};
use super::refine::{Refined, SequenceProblem, corridor_excess};
use super::rollout::SequenceRollout;
use super::subgoals::{Clearance, order};
use crate::cor_library::Library;
use crate::planner::cache::Cache;
use crate::planner::types::largest_step_m;
use crate::planner::{Corridor, Limit, PartState, Plan, PlanStatus, PlannedPulse, PlannerParams, Rotation};
use upm_core::geometry::Vec2;

/// Pulses played before the parts are observed and the rest is corrected.
const CHUNK: usize = 4;
/// Least bound of the longest displacement of a part in one sequence, m.
pub(super) const LEAST_REACH_M: f64 = 2e-3;
/// Fraction of the steps that a sequence may leave, for one part and for several.
const LEAVE_ALONE: f64 = 0.05;
const LEAVE: f64 = 0.3;
/// Residual allowed near the goal, root mean square, m, for one part and for several.
const NEAR_ALONE_M: f64 = 0.02e-3;
const NEAR_M: f64 = 0.15e-3;
/// Share of a corridor's half width that a sequence may leave: its end is the beginning of the next.
const END: f64 = 0.3;
/// Largest fraction of the steps that a sequence near the goal may leave.
const NEAREST: f64 = 0.5;
/// Factor of the program's residual to the sequence's, since ordering and rounding add to it.
const TIGHTER: f64 = 0.8;
/// Sequences tried in one cycle, each with finer pulses than the one before. Those beyond the scales have the finest,
/// and go half as far as the one before or, where the steps are small (root mean square), leave less of them.
const ATTEMPTS: usize = 6;
const SCALES: [PulseScale; 3] = [PulseScale::COARSE, PulseScale::MEDIUM, PulseScale::FINE];
const SMALL_M: f64 = 2e-3;
const TIGHTEN: f64 = 0.4;
/// A sequence that leaves more than this fraction is tried again, with finer pulses or over a shorter distance.
const POOR: f64 = 0.55;
/// Factors by which a sequence's distance grows or shrinks, and the residuals below and above which they apply.
const GROW: (f64, f64) = (0.3, 1.15);
const SHRINK: (f64, f64) = (0.4, 0.85);
const SHRINK_FAILED: f64 = 0.8;
/// The rest of a sequence is played while its residual is below this multiple of the forecast one, or below the length
/// in m, and no limit is broken by more than the last.
const KEPT: f64 = 1.4;
const KEPT_M: f64 = 0.25e-3;
const BROKEN_M: f64 = 0.5e-3;
/// Programs of the refinement of a new sequence, after pulses were dropped, and of the rest of one.
const NEW_ROUNDS: usize = 6;
const PRUNED_ROUNDS: usize = 2;
const REST_ROUNDS: usize = 4;
/// Pulses times rounds of refinement, at most: longer sequences get fewer rounds, down to one.
const NEW_PULSES: usize = 400;
const REST_PULSES: usize = 160;
/// Rounds of dropping pulses, their largest product with the number of pulses, and divisor of the first number dropped.
const PRUNED: usize = 6;
const PRUNED_PULSES: usize = 160;
const PRUNED_SHARE: usize = 8;
/// Pulses shorter than this on their typical belts are dropped, m.
const SHORT_M: f64 = 0.03e-3;
/// Bisections for the length of a shortened pulse.
const HALVINGS: usize = 10;
/// Targets that moved by less than this fraction of the steps shift the subgoals; larger moves end the sequence.
const MOVED: f64 = 0.5;

/// Plans sequences of rotations that give every part its step, and corrects them while they are played.
#[derive(Clone, Debug)]
pub struct RotationPlanner {
    library: Arc<Library>,
    pub(super) params: PlannerParams,
    pub(super) motion_set: Arc<MotionSet>,
    /// Prices of the last program, s/mm.
    prices: Vec<f64>,
    /// Longest displacement of a part in the next sequence, m.
    reach_m: Option<f64>,
    running: Option<PlayedSequence>,
    /// Bound of that displacement by the task, m.
    pub(super) stride_m: f64,
}

/// A sequence that is being played.
#[derive(Clone, Debug)]
struct PlayedSequence {
    /// Pulses not yet played.
    pulses: Vec<Pulse>,
    subgoals_m: Vec<Vec2>,
    targets_m: Vec<Vec2>,
    /// Allowed residual, root mean square, m.
    want_m: f64,
}

/// A sequence that could be played.
struct Sequence {
    refined: Refined,
    /// Number of pulses from the first that keep the limits.
    safe: usize,
    subgoals_m: Vec<Vec2>,
    want_m: f64,
    /// Distance gained towards the targets per second, m/s.
    gain_mps: f64,
}

impl Sequence {
    /// Of those that gain, the one that leaves the corridors less is better; of those, the one that gains more.
    fn is_better(&self, other: &Self) -> bool {
        let excess_m = |of: &Self| if of.gain_mps > 0.0 { of.refined.excess_m() } else { f64::INFINITY };
        let order = excess_m(other).total_cmp(&excess_m(self));
        order.then(self.gain_mps.total_cmp(&other.gain_mps)).is_gt()
    }
}

static COMPUTED: Cache<(Arc<Library>, PlannerParams), MotionSet> = Cache::new();

impl RotationPlanner {
    /// A planner for one rig's library.
    pub fn new(library: Arc<Library>, params: PlannerParams) -> Self {
        let motion_set =
            COMPUTED.get((Arc::clone(&library), params), |(library, params)| MotionSet::new(library, params));
        Self { library, params, motion_set, prices: Vec::new(), reach_m: None, running: None, stride_m: f64::INFINITY }
    }

    /// Plans one cycle: the next pulses of a sequence that brings every part nearer to its target. Parts with a
    /// corridor keep to it along the whole sequence where they can.
    pub fn plan(&mut self, parts: &[PartState], corridors: &[Option<Corridor>]) -> Plan {
        if let Some(status) = self.params.nothing_to_plan(parts) {
            self.running = None;
            return status.into();
        }
        let targets_m: Vec<Vec2> = parts.iter().map(|part| part.position_m + part.step_m).collect();
        let room = Clearance::of(parts, &targets_m, &self.params, corridors);
        if let Some(candidate) = self.rest(parts, &targets_m, &room) {
            return self.play(candidate, targets_m, &room, true);
        }
        match self.new_sequence(parts, &targets_m, &room) {
            Ok(candidate) => self.play(candidate, targets_m, &room, false),
            Err(limit) => PlanStatus::Infeasible(limit).into(),
        }
    }

    /// Forecast positions of `parts` after `pulse`, m.
    pub fn forecast(&self, parts: &[PartState], pulse: &Rotation) -> Vec<Vec2> {
        let Some(entry) = self.library.entries.get(pulse.entry) else {
            return parts.iter().map(|part| part.position_m).collect();
        };
        let setting = super::motion_set::DialSetting { amplitude: pulse.amplitude, sustain_s: pulse.sustain_s };
        let motion = self.motion_set.motion_of(&entry.pump, setting, pulse.distance_m < 0.0);
        parts.iter().map(|part| motion.carry(part.position_m, part.gain).0).collect()
    }

    /// The rest of the running sequence, corrected; `None` where it no longer does what was forecast.
    fn rest(&mut self, parts: &[PartState], targets_m: &[Vec2], room: &Clearance) -> Option<Sequence> {
        let mut running = self.running.take()?;
        if running.pulses.is_empty() || running.targets_m.len() != parts.len() {
            return None;
        }
        let moved_m = running.targets_m.iter().zip(targets_m).map(|(a, b)| (b - a).norm()).fold(0.0, f64::max);
        if moved_m > 0.0 {
            let steps_sq: f64 =
                running.subgoals_m.iter().zip(parts).map(|(goal, part)| (goal - part.position_m).norm_squared()).sum();
            if moved_m > MOVED * (steps_sq / parts.len() as f64).sqrt() {
                return None;
            }
            let moves = running.targets_m.iter().zip(targets_m).map(|(a, b)| b - a);
            running.subgoals_m.iter_mut().zip(moves).for_each(|(goal, by)| *goal += by);
        }
        let (subgoals_m, want_m) = (running.subgoals_m, running.want_m);
        let problem = SequenceProblem { motion_set: &self.motion_set, parts, goal_m: &subgoals_m, room };
        let refined = Refined::of(&problem, running.pulses);
        let rounds = (REST_PULSES / refined.pulses.len().max(1)).clamp(1, REST_ROUNDS);
        let refined = refined.refined(&problem, (rounds, want_m));
        let left_m = refined.left_m / (parts.len() as f64).sqrt();
        let kept = left_m < (KEPT * want_m).max(KEPT_M) && refined.broken_m().max(refined.excess_m()) < BROKEN_M;
        let safe = safe(&refined, room);
        (kept && safe > 0).then_some(Sequence { refined, safe, subgoals_m, want_m, gain_mps: 0.0 })
    }

    /// A new sequence towards `targets_m`, over the full distance of a sequence or, where that fails, a shorter one.
    fn new_sequence(&mut self, parts: &[PartState], targets_m: &[Vec2], room: &Clearance) -> Result<Sequence, Limit> {
        let usual_m = self.usual_m(parts.len());
        let mut reach_m = self.reach_m.unwrap_or(usual_m).min(usual_m);
        let mut share = (reach_m / largest_step_m(parts)).min(1.0);
        let (mut best, mut limit): (Option<Sequence>, _) = (None, Limit::Unreachable);
        let mut tightened = 1.0;
        for attempt in 0..ATTEMPTS {
            let scale = SCALES[attempt.min(SCALES.len() - 1)];
            let mut subgoals_m: Vec<Vec2> = parts.iter().map(|p| p.position_m + p.step_m * share).collect();
            room.spread_out(&mut subgoals_m, targets_m);
            let rms_m = rms_m(parts.iter().zip(&subgoals_m).map(|(p, goal)| goal - p.position_m));
            let candidate = self.sequence(parts, targets_m, (subgoals_m, tightened, scale), room);
            if let Some(candidate) = candidate {
                let left = candidate.refined.left_m / (parts.len() as f64).sqrt() / rms_m;
                let whole = candidate.safe == candidate.refined.pulses.len();
                if let (false, Some(shortfall)) = (whole, candidate.refined.shortfall) {
                    limit = shortfall.limit;
                }
                let (gains, keeps) = (candidate.gain_mps > 0.0, candidate.refined.excess_m() == 0.0);
                if best.as_ref().is_none_or(|best| candidate.is_better(best)) {
                    best = Some(candidate);
                }
                if whole && left < POOR && gains && keeps {
                    reach_m *= match left {
                        left if left < GROW.0 => GROW.1,
                        left if left > SHRINK.0 => SHRINK.1,
                        _ => 1.0,
                    };
                    break;
                }
            }
            if attempt + 1 < SCALES.len() {
                continue;
            }
            if rms_m < SMALL_M {
                tightened *= TIGHTEN;
            } else {
                share *= 0.5;
                reach_m *= SHRINK_FAILED;
            }
        }
        self.reach_m = Some(reach_m.clamp(LEAST_REACH_M, usual_m));
        best.filter(|best| best.gain_mps > 0.0).ok_or(limit)
    }

    /// A sequence to `subgoals_m`: program, order, refinement, and removal of dispensable pulses.
    fn sequence(
        &mut self,
        parts: &[PartState],
        targets_m: &[Vec2],
        (subgoals_m, tightened, scale): (Vec<Vec2>, f64, PulseScale),
        room: &Clearance,
    ) -> Option<Sequence> {
        let steps_m: Vec<Vec2> = parts.iter().zip(&subgoals_m).map(|(p, goal)| goal - p.position_m).collect();
        let rms_m = rms_m(steps_m.iter().copied());
        let alone = parts.len() == 1;
        let (most, near_m) =
            if alone { (LEAVE_ALONE, NEAR_ALONE_M) } else { (LEAVE * self.stride_share(parts.len()).powi(2), NEAR_M) };
        let want_m = tightened * near_m.min(NEAREST * rms_m).max(most * rms_m);
        let want_m = room.corridors().map(|(_, corridor)| END * corridor.half_width_m).fold(want_m, f64::min);
        let pulses = self.program(parts, &steps_m, room, (want_m, scale))?;
        let motions: Vec<_> = pulses.iter().map(|&pulse| self.motion_set.motion(pulse)).collect();
        let pulses = order(&motions, parts, &steps_m, room).into_iter().map(|k| pulses[k]).collect();
        let problem = SequenceProblem { motion_set: &self.motion_set, parts, goal_m: &subgoals_m, room };
        let first = Refined::of(&problem, pulses);
        let rounds = (NEW_PULSES / first.pulses.len().max(1)).clamp(1, NEW_ROUNDS);
        // a single part can reach its subgoal exactly with its present pulses
        let aim_m = if alone { near_m } else { want_m };
        let refined = pruned(first.refined(&problem, (rounds, aim_m)), &problem, want_m);
        if refined.pulses.is_empty() {
            return None;
        }
        let safe = safe(&refined, room);
        let left_m = refined.left_m / (parts.len() as f64).sqrt();
        let gain_mps = self.gain_mps(&refined, safe, parts, targets_m);
        Some(Sequence { refined, safe, subgoals_m, want_m: want_m.max(left_m), gain_mps })
    }

    /// Pulses that make `steps_m` in the least time: the relaxed program rounded to whole pulses, then both again over
    /// these and the half-length pulses that pay best.
    fn program(
        &mut self,
        parts: &[PartState],
        steps_m: &[Vec2],
        room: &Clearance,
        (want_m, scale): (f64, PulseScale),
    ) -> Option<Vec<Pulse>> {
        let rms_m = rms_m(steps_m.iter().copied());
        let steps_mm: Vec<f64> = steps_m.iter().flat_map(|step| [1e3 * step.x, 1e3 * step.y]).collect();
        let leave_mm = TIGHTER * 1e3 * want_m * (parts.len() as f64).sqrt();
        let columns = DisplacementMatrix::all(&self.motion_set, parts, room, (rms_m, scale));
        let first = LeastTime::solve(&columns, &steps_mm, leave_mm, &self.prices)?;
        self.prices.clone_from(&first.prices);
        let (mut whole, mut counts) = self.whole(parts, &columns, &first.counts);
        let more = best_paying(&columns, &first.prices, 3 * steps_mm.len(), 0.0).into_iter();
        let halves = more.map(|j| Pulse { distance_m: 0.5 * columns.pulses[j].distance_m, ..columns.pulses[j] });
        let second = DisplacementMatrix::of(&self.motion_set, parts, whole.iter().copied().chain(halves));
        let all: Vec<usize> = (0..second.len()).collect();
        if let Some(found) = LeastTime::over(&second, &all, &steps_mm, leave_mm) {
            (whole, counts) = self.whole(parts, &second, &found.counts);
        }
        let pulses = whole.into_iter().zip(counts).filter(|(pulse, _)| pulse.distance_m.abs() > SHORT_M);
        let pulses: Vec<Pulse> = pulses.flat_map(|(pulse, count)| std::iter::repeat_n(pulse, count)).collect();
        (!pulses.is_empty()).then_some(pulses)
    }

    /// Whole pulses for relaxed counts: below one a shorter pulse, above it several equal pulses, never a longer one.
    fn whole(&self, parts: &[PartState], columns: &DisplacementMatrix, counts: &[f64]) -> (Vec<Pulse>, Vec<usize>) {
        let used = counts.iter().enumerate().filter(|(_, count)| **count > 0.02);
        let whole = used.map(|(j, &count)| {
            let copies = (count - 0.05).ceil().max(1.0);
            (self.shortened(parts, columns, j, count / copies), copies as usize)
        });
        whole.unzip()
    }

    /// The pulse of column `j`, shortened until its displacement projects to `share` of the column. Its length on the
    /// typical belt is no measure of that, since parts on the slowest belts of a weak pulse stick.
    fn shortened(&self, parts: &[PartState], columns: &DisplacementMatrix, j: usize, share: f64) -> Pulse {
        let (pulse, column) = (columns.pulses[j], columns.column(j));
        let with_distance = |distance_m: f64| Pulse { distance_m: distance_m.copysign(pulse.distance_m), ..pulse };
        let does = |distance_m: f64| {
            let motion = self.motion_set.motion(with_distance(distance_m));
            let moves = parts.iter().map(|part| 1e3 * (motion.carry(part.position_m, part.gain).0 - part.position_m));
            moves.zip(column.chunks_exact(2)).map(|(by, c)| by.x * c[0] + by.y * c[1]).sum::<f64>()
        };
        let wanted = share * column.iter().map(|v| v * v).sum::<f64>();
        let (mut low_m, mut high_m) = self.motion_set.range_m(pulse.dial);
        high_m = high_m.min(pulse.distance_m.abs());
        for _ in 0..HALVINGS {
            let middle_m = 0.5 * (low_m + high_m);
            if does(middle_m) < wanted { low_m = middle_m } else { high_m = middle_m }
        }
        with_distance(high_m)
    }

    /// Distance that all parts together gain towards their targets, per second of the playable pulses, m/s.
    fn gain_mps(&self, refined: &Refined, safe: usize, parts: &[PartState], targets_m: &[Vec2]) -> f64 {
        let away_m = |places_m: &[Vec2]| -> f64 {
            places_m.iter().zip(targets_m).map(|(p, target)| (target - p).norm_squared()).sum::<f64>().sqrt()
        };
        let before_m: Vec<Vec2> = parts.iter().map(|part| part.position_m).collect();
        let duration_s = |k: usize| self.motion_set.duration_s(refined.motions[k].setting, refined.rollout.coasts_s[k]);
        let time_s: f64 = (0..safe).map(duration_s).sum();
        if safe == 0 { -1.0 } else { (away_m(&before_m) - away_m(refined.rollout.at(safe))) / time_s }
    }

    /// Plan of the first pulses of `candidate`; keeps the rest.
    fn play(&mut self, candidate: Sequence, targets_m: Vec<Vec2>, room: &Clearance, continues: bool) -> Plan {
        let Sequence { refined, safe, subgoals_m, want_m, .. } = candidate;
        let count = if 2 * safe > 3 * CHUNK { CHUNK } else { safe };
        let rotation = |k: usize| {
            let (pulse, setting) = (refined.pulses[k], refined.motions[k].setting);
            PlannedPulse::Rotation(self.motion_set.rotation(pulse, setting, refined.rollout.coasts_s[k]))
        };
        let pulses: Vec<PlannedPulse> = (0..count).map(rotation).collect();
        let predicted_m = (1..=count).map(|stage| refined.rollout.at(stage).to_vec()).collect();
        let left = refined.pulses[count..].to_vec();
        let corridor_excess = corridor_excess(&refined.rollout, room, count);
        self.running = Some(PlayedSequence { pulses: left, subgoals_m, targets_m, want_m });
        let candidates = refined.pulses.iter().map(|pulse| self.motion_set.dials[pulse.dial].entry).collect();
        Plan { status: PlanStatus::Solved, pulses, candidates, predicted_m, continues, corridor_excess }
    }
}

/// Drops the shortest pulses while the sequence stays as good.
fn pruned(mut best: Refined, problem: &SequenceProblem<'_>, want_m: f64) -> Refined {
    best.pulses.retain(|pulse| pulse.distance_m.abs() > SHORT_M);
    if best.pulses.len() < best.motions.len() {
        best = Refined::of(problem, best.pulses);
    }
    let enough_m = (1.1 * want_m * (problem.parts.len() as f64).sqrt()).max(1.02 * best.left_m);
    let tolerated_m = best.broken_m().max(0.3e-3);
    let mut dropped = (best.pulses.len() / PRUNED_SHARE).max(1);
    let times = (PRUNED_PULSES / best.pulses.len().max(1)).clamp(1, PRUNED);
    for _ in 0..times {
        if best.pulses.len() <= dropped {
            break;
        }
        let mut by_length: Vec<usize> = (0..best.pulses.len()).collect();
        let length_m = |k: usize| best.pulses[k].distance_m.abs();
        by_length.sort_by(|&a, &b| length_m(a).total_cmp(&length_m(b)).then(a.cmp(&b)));
        let short = &by_length[..dropped];
        let kept = best.pulses.iter().enumerate().filter(|(k, _)| !short.contains(k)).map(|(_, &pulse)| pulse);
        let next = Refined::of(problem, kept.collect()).refined(problem, (PRUNED_ROUNDS, want_m));
        if next.left_m < enough_m && next.broken_m() <= tolerated_m && next.excess_m() <= best.excess_m() {
            best = next;
        } else if dropped == 1 {
            break;
        } else {
            dropped /= 2;
        }
    }
    best
}

/// Number of pulses from the first that keep the limits.
fn safe(refined: &Refined, room: &Clearance) -> usize {
    let (rollout, played): (&SequenceRollout, Clearance) = (&refined.rollout, room.for_playing());
    let breaks = |k: &usize| played.shortfall(rollout.at(*k), rollout.at(k + 1)).is_some();
    (0..rollout.pulses()).find(breaks).unwrap_or(rollout.pulses())
}

fn rms_m(steps_m: impl ExactSizeIterator<Item = Vec2>) -> f64 {
    let count = steps_m.len().max(1) as f64;
    (steps_m.map(|step| step.norm_squared()).sum::<f64>() / count).sqrt()
}
