//! Planning of one cycle.

use super::ControlCycle;
use crate::found::finding_of_plan;
use crate::run_end::{OrEnd, RunEnd};
use upm_core::geometry::Vec2;
use upm_core::job::Finding;
use upm_planning::planner::{Corridor, Independence, PartState, Plan, PlanStatus, PlanningMethod};
use upm_planning::task::{PathStretch, Setpoints};

/// Shares of the steps that are tried for all parts together.
const FRACTIONS: [f64; 4] = [1.0, 0.5, 0.25, 0.125];
/// Least displacement of the hardest joint motion of all parts, as a share of the best one. The shipped jobs by
/// rotations have 5e-4 (24 coins) or more; a library that lacks a direction, or has too few centres for the parts, has
/// less than 1e-6.
const LEAST_SHARE: f64 = 1e-4;

impl ControlCycle<'_, '_> {
    /// Plans the wanted steps; where they are infeasible, half of them, and half again; then one part at a time, the
    /// one farthest from its subgoal first, while the others stay.
    ///
    /// # Errors
    /// The ending of a run without a feasible step.
    pub(super) fn plan(&mut self, seen_m: &[Vec2], wanted: &Setpoints) -> OrEnd<Plan> {
        let _span = tracing::trace_span!("plan").entered();
        self.check_stop()?;
        let (params, places) = (self.params, seen_m.iter().zip(&wanted.subgoals_m).enumerate());
        let state = |(part, (&position_m, subgoal_m)): (usize, (&Vec2, &Vec2))| PartState {
            position_m,
            step_m: self.cautious(subgoal_m - position_m),
            radius_m: params.radius_m(part),
            gain: self.gains.get(part, position_m),
        };
        let whole: Vec<PartState> = places.map(state).collect();
        let corridor = |path: &PathStretch| Corridor { line: path.line.clone(), half_width_m: path.corridor_m };
        let corridors: Vec<_> = wanted.paths.iter().map(|path| path.as_ref().map(corridor)).collect();
        let mut stopped_by = String::new();
        self.planner.limit_stride(wanted.stride_m);
        for (steps, is_part) in fallbacks(&whole, self.planner.tries_smaller()) {
            let plan = self.planner.plan(&steps, &corridors);
            let found = finding_of_plan(&plan.status, |part| params.id(part));
            if let Some((finding, why)) = found.as_ref().filter(|_| !is_part) {
                self.warn(*finding, format!("steps are cut short or made one part at a time, because {why}"));
            }
            self.check_stop()?;
            match found {
                None if is_part && plan.status == PlanStatus::NothingToDo => continue,
                None => return Ok(plan),
                Some((_, why)) => stopped_by = why,
            }
            self.watch.note(&plan.status);
        }
        let blocking_part = self.watch.blocking_part_description(wanted, seen_m, params);
        let cycle = self.index;
        let reason = format!("no feasible step in cycle {cycle}, {}: {stopped_by}; {blocking_part}", wanted.phase);
        Err(RunEnd::failed_because(Finding::NoFeasibleStep, reason))
    }

    /// Ends the run where rotations are played, a part is to be moved, and the library cannot move the parts at
    /// `seen_m` independently. The ending names the part that moves farthest in the hardest joint motion, its direction
    /// there and the bound.
    pub(super) fn check_controllable(&self, seen_m: &[Vec2], wanted: &Setpoints) -> OrEnd {
        let by_rotations = match self.params.method {
            PlanningMethod::CorSequence | PlanningMethod::PseudoInverse => true,
            PlanningMethod::SynthesizedField | PlanningMethod::MovingField => false,
        };
        if !by_rotations || wanted.subgoals_m == seen_m {
            return Ok(());
        }
        let independence = Independence::of_rotations(self.library, seen_m);
        let (share, Some((part, direction))) = (independence.share(), independence.weakest) else {
            return Ok(());
        };
        if share >= LEAST_SHARE {
            return Ok(());
        }
        let direction_deg = libm::atan2(direction.y, direction.x).to_degrees().rem_euclid(180.0);
        let part = self.params.id(part);
        let reason = format!(
            "rotations cannot move the parts independently: {part} towards {direction_deg:.0} deg with {share:.1e} of the \
             best joint motion, at least {LEAST_SHARE:.0e} is needed; calibrate again, take another planner or move fewer \
             parts"
        );
        Err(RunEnd::failed_because(Finding::Uncontrollable, reason))
    }

    /// True if a run that only its time limit ends has nothing to do: every part is at its place.
    pub(super) fn rests_without_end(&self, wanted: &Setpoints, seen_m: &[Vec2]) -> bool {
        let is_there = |(seen, subgoal): (&Vec2, &Vec2)| (subgoal - seen).norm() <= self.params.tolerance_m;
        self.params.endless && seen_m.iter().zip(&wanted.subgoals_m).all(is_there)
    }
}

/// The attempts at a plan in order of preference: the parts with the steps to try, and whether these are a share of the
/// wanted steps only. Without smaller steps of all parts for a planner that tries them itself.
pub fn fallbacks(whole: &[PartState], tries_smaller: bool) -> impl Iterator<Item = (Vec<PartState>, bool)> + '_ {
    let fractions = if tries_smaller { &FRACTIONS[..1] } else { &FRACTIONS };
    let together = fractions.iter().map(|&part| {
        let shorter = whole.iter().map(|state| PartState { step_m: part * state.step_m, ..*state });
        (shorter.collect::<Vec<_>>(), part < 1.0)
    });
    let mut longest_first: Vec<usize> = (0..whole.len()).collect();
    longest_first.sort_by(|&a, &b| whole[b].step_m.norm().total_cmp(&whole[a].step_m.norm()).then(a.cmp(&b)));
    let alone = longest_first.into_iter().map(|moving| {
        let step_m = |part: usize| if part == moving { whole[part].step_m } else { Vec2::zeros() };
        let parts = whole.iter().enumerate().map(|(part, state)| PartState { step_m: step_m(part), ..*state });
        (parts.collect::<Vec<_>>(), true)
    });
    let several = whole.len() > 1;
    together.chain(alone.filter(move |_| several))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_together_in_ever_smaller_steps_then_the_farthest_alone() {
        let state =
            |x: f64| PartState { position_m: Vec2::zeros(), step_m: Vec2::new(x, 0.0), radius_m: 0.01, gain: 1.0 };
        let whole = [state(0.002), state(0.008)];
        let tried: Vec<(Vec<PartState>, bool)> = fallbacks(&whole, false).collect();
        let steps: Vec<[f64; 2]> = tried.iter().map(|(a, _)| [a[0].step_m.x, a[1].step_m.x]).collect();
        let expected = [[0.002, 0.008], [0.001, 0.004], [0.0005, 0.002], [0.00025, 0.001], [0.0, 0.008], [0.002, 0.0]];
        assert_eq!(steps, expected);
        assert_eq!(
            tried.iter().map(|(_, is_part)| *is_part).collect::<Vec<_>>(),
            [false, true, true, true, true, true]
        );
        assert_eq!(fallbacks(&whole[..1], false).count(), 4, "one part is always alone");
        let steps: Vec<f64> = fallbacks(&whole, true).map(|(a, _)| a[1].step_m.x).collect();
        assert_eq!(steps, [0.008, 0.008, 0.0], "the planner has tried the smaller ones");
    }
}
