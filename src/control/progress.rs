//! Net progress of a run: a run whose pulses bring no part nearer ends instead of going on to its time limit.

use super::found::finding_of_plan;
use super::hindrance::{dense_places, past};
use super::params::ControlParams;
use super::run_end::RunEnd;
use upm_core::geometry::Vec2;
use upm_core::job::Finding;
use upm_planning::planner::{Limit, PlanStatus};
use upm_planning::task::Setpoints;

/// Plans with pulses in which some measure of progress must improve; cycles that continue a sequence do not count.
/// This and the other numbers of cycles are for at most [`SERVED`] parts; they grow with the number of pairs, which
/// hinder each other.
const FUTILE_CYCLES: u32 = 20;
/// The same where every part is within `NEAR` times the tolerance: each cycle may be the one that brings all of them
/// in, as in a run of 24 coins after twenty cycles that brought them no nearer.
const NEAR_CYCLES: u32 = 100;
const NEAR: f64 = 6.0;
/// Cycles with pulses in which the parts must come nearer to their targets: detours around each other lead away for a
/// while.
const DETOUR_CYCLES: u32 = 200;
/// Parts that one motion brings nearer at a time: where there are more, they take turns.
pub(super) const SERVED: u32 = 8;
/// Relative decrease of a distance that counts as an improvement.
const SHARE: f64 = 0.01;
/// The same for a single part that is not at its target yet: dense sets advance part by part, some of them back for a
/// while.
const PART_SHARE: f64 = 0.05;
/// Displacement above which a subgoal counts as a new one, m.
const NEW_M: f64 = 1e-3;
/// A part creeps that advanced by less than this, m, and by less than this share of the steps asked for meanwhile.
const CREEP_M: f64 = 1e-3;
const CREEP_SHARE: f64 = 0.1;

/// Watches the progress of a run over its cycles with pulses.
///
/// The measures are the distances of all parts from the task's targets and from its subgoals, each the root of a sum of
/// squares, and the least distance of each part from its target. Parts on paths have progressed when one of them has
/// advanced: a reference waits for its part, and its target may be a whole lap ahead. The way to the first points of
/// paths is one to places.
#[derive(Clone, Debug, Default)]
pub(super) struct ProgressWatch {
    follows_paths: bool,
    /// True once the parts are on their paths.
    on_paths: bool,
    tolerance_m: f64,
    targets_m: Vec<Vec2>,
    subgoals_m: Vec<Vec2>,
    /// Least distances of all parts from targets and from subgoals so far, m.
    from_targets_m: f64,
    from_subgoals_m: f64,
    /// For each part the least distance from its target so far, m.
    of_each_m: Vec<f64>,
    /// Number of cycles with pulses since any measure improved, and since the distance from the targets did.
    futile: u32,
    detour: u32,
    creep: StallCounter,
    /// Limit of the last infeasible plan since any measure improved.
    limit: Option<Limit>,
}

/// Counts the cycles in which no part advances.
#[derive(Clone, Debug, Default)]
struct StallCounter {
    /// Positions of the parts when one last advanced, m.
    from_m: Vec<Vec2>,
    /// The sum of the longest steps asked for in each cycle since, m.
    asked_m: f64,
    /// Cycles with pulses since.
    cycles: u32,
}

impl StallCounter {
    /// Takes an observation at rest, after pulses if `played`, at which a step of `step_m` is asked for.
    fn observe(&mut self, seen_m: &[Vec2], step_m: f64, played: bool) {
        let begins = self.from_m.len() != seen_m.len();
        if begins || farthest_m(&self.from_m, seen_m) > CREEP_M.max(CREEP_SHARE * self.asked_m) {
            *self = Self { from_m: seen_m.to_vec(), ..Self::default() };
        } else {
            self.cycles += u32::from(played);
        }
        self.asked_m += step_m;
    }
}

/// Cycles that so many parts are allowed, of those that [`SERVED`] are.
fn allowed(cycles: u32, parts: usize) -> u32 {
    let parts = (parts as u32).max(SERVED);
    cycles * parts * parts / (SERVED * SERVED)
}

impl ProgressWatch {
    /// Watch at the beginning of a run.
    pub fn new(follows_paths: bool, tolerance_m: f64) -> Self {
        Self { follows_paths, tolerance_m, ..Self::default() }
    }

    /// Notes the reason for an infeasible plan.
    pub fn note(&mut self, status: &PlanStatus) {
        if let PlanStatus::Infeasible(limit) = status {
            self.limit = Some(*limit);
        }
    }

    /// Takes an observation at rest; `played` is true when pulses came before it. Returns true when the run no longer
    /// makes progress.
    pub fn observe(&mut self, wanted: &Setpoints, seen_m: &[Vec2], played: bool) -> bool {
        let (on_paths, rests) = (!wanted.paths.is_empty(), distance_m(seen_m, &wanted.subgoals_m) == 0.0);
        if rests || self.on_paths != (self.follows_paths && on_paths) {
            *self =
                Self { on_paths: self.follows_paths && on_paths, ..Self::new(self.follows_paths, self.tolerance_m) };
        }
        if rests {
            // no part has a target: a hold that succeeds
            return false;
        }
        let (futile, detour) = (self.futile + u32::from(played), self.detour + u32::from(played));
        let (from_targets_m, from_subgoals_m) =
            (distance_m(seen_m, &wanted.targets_m), distance_m(seen_m, &wanted.subgoals_m));
        let begins = self.subgoals_m.len() != wanted.subgoals_m.len();
        let moved = begins || farthest_m(&self.subgoals_m, &wanted.subgoals_m) > NEW_M;
        // new targets are not progress by themselves: they may be exchanged and paths searched again, over and over
        if begins || self.targets_m != wanted.targets_m {
            self.targets_m.clone_from(&wanted.targets_m);
            self.from_targets_m = from_targets_m;
            self.of_each_m = distances_m(seen_m, &wanted.targets_m).collect();
        }
        if moved {
            self.subgoals_m.clone_from(&wanted.subgoals_m);
            self.from_subgoals_m = from_subgoals_m;
        }
        let nearer = improves(&mut self.from_targets_m, from_targets_m);
        self.creep.observe(seen_m, farthest_m(seen_m, &wanted.subgoals_m), played);
        let is_carried_on = self.on_paths && self.creep.cycles == 0;
        let gets_on = improves(&mut self.from_subgoals_m, from_subgoals_m) || is_carried_on;
        let one_gets_on = self.one_is_nearer(seen_m);
        self.detour = if nearer || self.on_paths { 0 } else { detour };
        // on a path a creeping part comes nearer to the end of its lap, too
        let by_targets = (nearer || one_gets_on) && !self.on_paths;
        self.futile = if gets_on || by_targets { 0 } else { futile };
        if self.futile == 0 {
            self.limit = None;
        }
        let is_near = farthest_m(seen_m, &wanted.targets_m) < NEAR * self.tolerance_m;
        let allowed = |cycles| allowed(cycles, seen_m.len());
        self.futile >= allowed(if is_near { NEAR_CYCLES } else { FUTILE_CYCLES })
            || self.detour >= allowed(DETOUR_CYCLES)
    }

    /// True where parts that are to rest somewhere have come no nearer for a quarter of the cycles after which a run
    /// ends.
    pub fn stalls(&self) -> bool {
        !self.on_paths && self.futile >= allowed(FUTILE_CYCLES / 4, self.targets_m.len())
    }

    /// True unless the last cycles brought no, or only negligible, progress.
    pub fn makes_progress(&self) -> bool {
        self.futile.max(self.creep.cycles) < FUTILE_CYCLES / 4
    }

    /// True when a part that is not there yet is clearly nearer to its target than before.
    fn one_is_nearer(&mut self, seen_m: &[Vec2]) -> bool {
        let mut any = false;
        for (least_m, now_m) in self.of_each_m.iter_mut().zip(distances_m(seen_m, &self.targets_m)) {
            if *least_m > self.tolerance_m && now_m < (1.0 - PART_SHARE) * *least_m {
                (*least_m, any) = (now_m, true);
            }
        }
        any
    }

    /// The ending of a run without progress. Where parts wait for each other it says which; otherwise it names the part
    /// that hinders it, its vector to the target, and the limit that made plans infeasible.
    pub fn ending(&self, wanted: &Setpoints, seen_m: &[Vec2], params: &ControlParams) -> RunEnd {
        let cycles = if self.futile >= FUTILE_CYCLES { self.futile } else { self.detour };
        let (ends_m, part) = (self.ends_m(wanted), self.blocking_part(wanted, seen_m).map(|(part, _)| part));
        let by_others = match (self.limit, part.filter(|part| wanted.blocked.contains(part))) {
            (Some(Limit::Separation { parts: [a, b] }), _) => Some(format!("{} and {}", params.id(a), params.id(b))),
            (_, Some(part)) => Some(format!("{} has no way{}", params.id(part), past(params, part, seen_m, ends_m))),
            _ => None,
        };
        let blocking_part = self.blocking_part_description(wanted, seen_m, params);
        let few = format!("less than {:.0} % nearer in {cycles} plans; {blocking_part}", 100.0 * SHARE);
        let dense = part.and_then(|part| dense_places(params, part, ends_m));
        if by_others.is_some() || dense.is_some() {
            let path = wanted.paths.iter().flatten().find(|path| !path.is_over);
            let wider = path.map(|path| format!("a `corridor_mm` above {:.1} may help", 1e3 * path.corridor_m));
            let told = [by_others, dense, wider].into_iter().flatten().collect::<Vec<_>>().join("; ");
            let reason = format!("parts wait for each other: {told}; {few}");
            return RunEnd::failed_because(Finding::PartsHinder, reason);
        }
        let limit =
            self.limit.and_then(|limit| finding_of_plan(&PlanStatus::Infeasible(limit), |part| params.id(part)));
        let limit = limit.map(|(_, why)| format!("; plans were cut short because {why}")).unwrap_or_default();
        RunEnd::failed_because(Finding::NoProgress, format!("no progress: {few}{limit}"))
    }

    /// For people: the part that hinders progress, its distance from its place and the direction.
    pub fn blocking_part_description(&self, wanted: &Setpoints, seen_m: &[Vec2], params: &ControlParams) -> String {
        let Some((part, way_m)) = self.blocking_part(wanted, seen_m) else {
            return "there are no parts".into();
        };
        let direction_deg = libm::atan2(way_m.y, way_m.x).to_degrees();
        let blocked = if wanted.blocked.contains(&part) { ", and blocked by other parts" } else { "" };
        let way_mm = 1e3 * way_m.norm();
        format!(
            "{} is {way_mm:.2} mm from its place, which is towards {direction_deg:.0} deg{blocked}",
            params.id(part)
        )
    }

    /// Where the parts go: on paths to their subgoals, else to their targets, m.
    fn ends_m<'a>(&self, wanted: &'a Setpoints) -> &'a [Vec2] {
        if self.on_paths { &wanted.subgoals_m } else { &wanted.targets_m }
    }

    /// The part that is farthest from where it should be, among those that are blocked if there are any, and its way to
    /// its target, or on a path to its subgoal, m; `None` without parts.
    fn blocking_part(&self, wanted: &Setpoints, seen_m: &[Vec2]) -> Option<(usize, Vec2)> {
        let ways = seen_m.iter().zip(self.ends_m(wanted)).map(|(seen, end)| end - seen).enumerate();
        let limiting = ways.filter(|(part, _)| wanted.blocked.is_empty() || wanted.blocked.contains(part));
        limiting.max_by(|a, b| a.1.norm_squared().total_cmp(&b.1.norm_squared()))
    }
}

/// Root of the sum of squared distances, m.
fn distance_m(from_m: &[Vec2], to_m: &[Vec2]) -> f64 {
    distances_m(from_m, to_m).map(|distance_m| distance_m * distance_m).sum::<f64>().sqrt()
}

/// The largest distance, m.
pub(super) fn farthest_m(from_m: &[Vec2], to_m: &[Vec2]) -> f64 {
    distances_m(from_m, to_m).fold(0.0, f64::max)
}

fn distances_m(from_m: &[Vec2], to_m: &[Vec2]) -> impl Iterator<Item = f64> {
    from_m.iter().zip(to_m).map(|(from, to)| (to - from).norm())
}

/// True when `now_m` is clearly less than `least_m`, which is then set to it.
fn improves(least_m: &mut f64, now_m: f64) -> bool {
    let better = now_m < (1.0 - SHARE) * *least_m;
    if better {
        *least_m = now_m;
    }
    better
}

#[cfg(test)]
mod tests;
