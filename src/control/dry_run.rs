//! Dry run of a job on the library's displacement model, before anything moves: without rig, camera or ground truth.
//!
//! The loop is that of a run: ask the task, plan, play, observe again, learn the parts' gains. Parts move as
//! the run's planner forecasts, with a friction unknown to it; entries, plate motion and end positions are off by as
//! much as in runs (`disturbance.rs`). Observations are exact, and parts that meet only push each other aside.

mod disturbance;
mod kinematic_plate;
mod thinned_path;
mod types;

use std::ops::ControlFlow::{Break, Continue};
use std::sync::Arc;

use super::condition::no_plan_reason;
use super::gain_estimator::{ForecastDeviation, MORE, PulseObservation};
use super::params::ControlParams;
use super::planning::{Planning, STALLED_S};
use super::pulse_planner::FreshPlanner;
use super::run_end::{OrEnd, RunEnd};
use kinematic_plate::KinematicPlate;
use thinned_path::ThinnedPath;
use upm_cor_library::Library;
use upm_core::geometry::Vec2;
use upm_core::job::StopCause;
use upm_core::time::PlateTime;
use upm_planner::{Plan, PlanStatus, PlannedPulse, PlanningMethod};
use upm_task::{Setpoints, Task};

pub use types::{ClosestApproach, DryRun, DryRunParams, LimitMet};

/// Planning and playing a synthesised field, ms per group of parts and second of the pulse, on one core of the
/// reference machine: 24 parts take 2.7 ms a cycle, 8 take 1.1 ms, 3 with short pulses 0.3 ms.
const FIELD_MS: f64 = 3.5;
/// Parts that the field planner moves in one vector.
const GROUP: usize = 8;
/// Planning and playing a cycle of rotations, ms, and the part that grows with the square of the number of parts: most
/// cycles correct a sequence, some plan a new one. On average 8 parts take 10 ms a cycle, 16 take 40 ms.
const CYCLE_MS: f64 = 2.5;
const SQUARE_MS: f64 = 0.15;
/// Evaluating an observation, ms.
const LOOK_MS: f64 = 0.02;

/// Plays `task` to its end by `planner` on the displacement model of `library`. `watch` receives the plate time and the
/// task's progress, 0 to 1, once per observation.
pub fn dry_run(
    library: &Arc<Library>,
    planner: &FreshPlanner,
    task: &mut dyn Task,
    params: &ControlParams,
    dry_run: &DryRunParams,
    watch: &mut dyn FnMut(PlateTime, f64),
) -> DryRun {
    let planner = match planner.plans() {
        Ok(planner) => planner,
        Err(ending) => return DryRun { ending, ..DryRun::default() },
    };
    let mut player = DryRunLoop {
        params,
        planning: Planning::new(params, library, planner, params.planner.half_side_m),
        stage: KinematicPlate::new(Arc::clone(library), params, dry_run),
        continues: false,
        trails: dry_run.starts_m.iter().map(|&start_m| ThinnedPath::from(start_m)).collect(),
        off: MeanSquare::default(),
        cycles: 0,
        pulses: 0,
        work_ms: 0.0,
        most_work_ms: dry_run.most_work_ms,
        limits_met: Vec::new(),
    };
    let (end, wanted) = player.until_end(task, watch);
    let left_off = end.is_none();
    let played_s = player.stage.now().secs();
    // a job without an end is assumed to go on at its pace until its limit
    let goes_on =
        if left_off && params.endless && played_s > 0.0 { (params.time_limit_s / played_s).max(1.0) } else { 1.0 };
    let in_all = |count: u64| (count as f64 * goes_on).round() as u64;
    DryRun {
        left_off,
        ending: end.unwrap_or_else(|| player.left_off(&wanted)),
        progress: wanted.progress,
        work_ms: player.work_ms,
        plate_time_s: played_s * goes_on,
        cycles: in_all(player.cycles),
        pulses: in_all(player.pulses),
        trails_m: player.trails.into_iter().map(ThinnedPath::into_points).collect(),
        targets_m: wanted.targets_m,
        nearest: player.stage.nearest,
        limits_met: player.limits_met,
        prediction_error_m: player.off.rms(),
    }
}

/// Root mean square of lengths, m.
#[derive(Clone, Copy, Debug, Default)]
struct MeanSquare {
    count: u64,
    sum_m2: f64,
}

impl MeanSquare {
    fn push(&mut self, length_m: f64) {
        self.count += 1;
        self.sum_m2 += length_m * length_m;
    }

    fn rms(self) -> Option<f64> {
        (self.count > 0).then(|| (self.sum_m2 / self.count as f64).sqrt())
    }
}

struct DryRunLoop<'a> {
    params: &'a ControlParams,
    planning: Planning<'a>,
    stage: KinematicPlate,
    trails: Vec<ThinnedPath>,
    off: MeanSquare,
    cycles: u64,
    pulses: u64,
    work_ms: f64,
    most_work_ms: f64,
    limits_met: Vec<LimitMet>,
    /// True when the last plan continued a sequence.
    continues: bool,
}

impl DryRunLoop<'_> {
    /// The ending, `None` when the dry run is broken off, and the task's last request.
    fn until_end(&mut self, task: &mut dyn Task, watch: &mut dyn FnMut(PlateTime, f64)) -> (Option<RunEnd>, Setpoints) {
        let (mut went_on_at, mut furthest) = (self.stage.now(), 0.0);
        let (mut observed_once, mut played) = (false, false);
        loop {
            let now = self.stage.now();
            let wanted = task.next(now, &self.stage.positions_m);
            watch(now, wanted.progress);
            if wanted.done {
                return (Some(RunEnd::completed(wanted.phase.clone())), wanted);
            }
            if !std::mem::replace(&mut observed_once, true)
                && let Break(ending) = self.planning.check_controllable(&self.stage.positions_m, &wanted)
            {
                return (Some(ending), wanted);
            }
            if self.work_ms > self.most_work_ms {
                return (None, wanted);
            }
            if wanted.progress > furthest || self.planning.rests_without_end(&wanted, &self.stage.positions_m) {
                (furthest, went_on_at) = (wanted.progress, now);
            }
            if self.planning.watch.observe(&wanted, &self.stage.positions_m, played) {
                return (Some(self.planning.no_progress(&wanted, &self.stage.positions_m)), wanted);
            }
            let once = self.once(&wanted);
            played = matches!(once, Continue(true)) && !self.continues;
            match once {
                Continue(true) => went_on_at = self.stage.now(),
                Continue(false) if self.stage.now() - went_on_at > STALLED_S => {
                    let blocking_part = self.planning.blocking_part(&wanted, &self.stage.positions_m);
                    let reason =
                        format!("stalled: no pulse for {STALLED_S} s of plate time, {}; {blocking_part}", wanted.phase);
                    return (Some(RunEnd::failed_because(StopCause::NoProgress, reason)), wanted);
                }
                Continue(false) => {}
                Break(ending) => return (Some(ending), wanted),
            }
        }
    }

    /// The ending of a dry run that is broken off. A job without an end counts as completed.
    fn left_off(&self, wanted: &Setpoints) -> RunEnd {
        // rounded down: a dry run that is broken off is never at 100 %
        let (plate_s, percent) = (self.stage.now().secs(), (100.0 * wanted.progress).floor());
        if self.params.endless {
            let limit_s = self.params.time_limit_s;
            return RunEnd::completed(format!(
                "left off after {plate_s:.0} s of plate time; it goes on to its {limit_s} s"
            ));
        }
        RunEnd::failed(format!("left off after {plate_s:.0} s of plate time, {percent:.0} % of the way"))
    }

    /// One cycle from an observation to the next; true when it had a pulse.
    fn once(&mut self, wanted: &Setpoints) -> OrEnd<bool> {
        self.check_time()?;
        let plan = self.plan(wanted)?;
        self.continues = plan.continues;
        self.work_ms += LOOK_MS;
        for pulse in &plan.pulses {
            self.check_time()?;
            let before_m = self.stage.positions_m.clone();
            let gain = |part: usize, at_m: Vec2| self.planning.gains.get(part, at_m);
            let forecast_m = self.planning.forecast(&before_m, pulse, gain);
            let with_more_m = self.planning.forecast(&before_m, pulse, |part, at_m| gain(part, at_m) + MORE);
            self.stage.play(pulse, self.planning.planner.as_ref());
            self.pulses += 1;
            if let (Some(forecast_m), Some(with_more_m)) = (forecast_m, with_more_m) {
                let ends = forecast_m.iter().zip(&self.stage.positions_m);
                ends.for_each(|(forecast_m, after_m)| self.off.push((after_m - forecast_m).norm()));
                self.planning.gains.learn(&PulseObservation {
                    before_m: &before_m,
                    forecast_m: &forecast_m,
                    with_more_m: &with_more_m,
                    measured_m: &self.stage.positions_m,
                    scatter: ForecastDeviation::of(pulse),
                });
            }
            for (trail, &position_m) in self.trails.iter_mut().zip(&self.stage.positions_m) {
                trail.push(position_m);
            }
            self.check_on_plate()?;
        }
        self.stage.observe();
        let moved = !plan.pulses.is_empty();
        self.cycles += u64::from(moved);
        Continue(moved)
    }

    fn check_time(&self) -> OrEnd {
        let limit_s = self.params.time_limit_s;
        if self.stage.now().secs() < limit_s {
            return Continue(());
        }
        let reason = format!("plate time limit of {limit_s} s reached");
        Break(if self.params.endless { RunEnd::completed(reason) } else { RunEnd::failed(reason) })
    }

    fn check_on_plate(&self) -> OrEnd {
        let half_side_m = self.params.planner.half_side_m;
        match self.stage.positions_m.iter().position(|p| p.amax() > half_side_m) {
            Some(part) => Break(RunEnd::failed(format!("{} would fall off the plate", self.params.id(part)))),
            None => Continue(()),
        }
    }

    /// Plans the wanted steps, or the feasible share of them, as a run does.
    fn plan(&mut self, wanted: &Setpoints) -> OrEnd<Plan> {
        let whole = self.planning.states(&self.stage.positions_m, wanted, |step_m| step_m);
        let (params, library, limits_met) = (self.params, self.planning.library, &mut self.limits_met);
        self.planning.plan(self.cycles, wanted, &whole, |plan, _| {
            let ControlParams { method, planner, parts, .. } = params;
            // every planner checks first whether there is anything to do
            if plan.status != PlanStatus::NothingToDo {
                self.work_ms += attempt_ms(library, *method, planner.max_sustain_s, plan, parts.len());
            }
            if let PlanStatus::Infeasible(_) | PlanStatus::SolverFailed(_) = plan.status {
                note(limits_met, no_plan_reason(&plan.status, *method, |part| params.id(part)));
            }
            Continue(())
        })
    }
}

/// Modelled time of one attempt at a plan for `parts` parts and of playing it, ms: a real clock would give equal jobs
/// different dry runs. A plan without pulses counts as one for the longest pulse.
fn attempt_ms(library: &Library, method: PlanningMethod, longest_s: f64, plan: &Plan, parts: usize) -> f64 {
    match method {
        PlanningMethod::SynthesizedField => {
            let sustain_s = plan.pulses.iter().map(PlannedPulse::sustain_s).reduce(f64::max).unwrap_or(longest_s);
            let flanks_s = library.fields.as_ref().map_or(0.0, |fields| 2.0 * fields.attack_s);
            FIELD_MS * parts.div_ceil(GROUP) as f64 * (flanks_s + sustain_s)
        }
        PlanningMethod::CorSequence | PlanningMethod::PseudoInverse => CYCLE_MS + SQUARE_MS * (parts as f64).powi(2),
    }
}

/// Counts one more plan that `limit` made infeasible.
fn note(limits_met: &mut Vec<LimitMet>, limit: String) {
    match limits_met.iter_mut().find(|met| met.limit == limit) {
        Some(met) => met.times += 1,
        None => limits_met.push(LimitMet { limit, times: 1 }),
    }
}

#[cfg(test)]
mod tests;
