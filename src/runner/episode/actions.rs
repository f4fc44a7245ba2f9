use std::collections::VecDeque;
use std::sync::Arc;

use super::types::ActionKind;
use upm_control::fallbacks;
use upm_core::geometry::Vec2;
use upm_core::units::{m_from_mm, mm_from_m};
use upm_planning::cor_library::Library;
use upm_planning::planner::{FieldPlanner, PartState, PlanStatus, PlannedPulse, PlannerParams, RotationPlanner};

/// From actions to pulses, and from the planner's pulses to actions.
pub(super) enum ActionPlanner {
    /// Actions are steps, or else motions.
    Fields { planner: FieldPlanner, by_steps: bool, max_sustain_s: f64 },
    /// `planned` has the expert's next actions.
    Rotations { planner: RotationPlanner, planned: VecDeque<Vec<f64>> },
}

impl ActionPlanner {
    /// `None` where the library lacks the response to synthesised fields that the actions need.
    pub fn new(action: ActionKind, library: &Arc<Library>, params: PlannerParams) -> Option<Self> {
        if action == ActionKind::Pulse {
            let planner = RotationPlanner::new(Arc::clone(library), params);
            return Some(Self::Rotations { planner, planned: VecDeque::new() });
        }
        let (by_steps, max_sustain_s) = (action == ActionKind::Steps, params.max_sustain_s);
        Some(Self::Fields { planner: FieldPlanner::new(library, params)?, by_steps, max_sustain_s })
    }

    /// Least and largest value of each number of an action for `parts` parts.
    pub fn bounds(&self, parts: usize, side_m: f64) -> Vec<[f64; 2]> {
        let within = |most: f64| [-most, most];
        match self {
            Self::Fields { by_steps: true, .. } => vec![within(mm_from_m(side_m)); 2 * parts],
            Self::Fields { planner, .. } => vec![within(1.0); planner.coefficients() + 1],
            Self::Rotations { planner, .. } => {
                vec![[0.0, planner.rotations().saturating_sub(1) as f64], within(mm_from_m(planner.longest_m()))]
            }
        }
    }

    /// The pulse of a valid `action` on `parts`; `None` where the plate rests.
    pub fn pulse(&mut self, action: &[f64], parts: &[PartState]) -> Option<PlannedPulse> {
        match self {
            Self::Fields { planner, by_steps: true, .. } => {
                let steps_m = action.chunks_exact(2).map(|step| Vec2::new(m_from_mm(step[0]), m_from_mm(step[1])));
                let parts = parts.iter().zip(steps_m).map(|(part, step_m)| PartState { step_m, ..*part });
                plan_fields(planner, &parts.collect::<Vec<_>>())
            }
            Self::Fields { planner, max_sustain_s, .. } => {
                let (sustain, shares) = action.split_last().filter(|(_, shares)| shares.iter().any(|c| *c != 0.0))?;
                Some(PlannedPulse::Field(planner.pulse_of(shares, 0.5 * (1.0 + sustain) * *max_sustain_s)))
            }
            Self::Rotations { planner, planned } => {
                if planned.pop_front().is_some_and(|next| next != action) {
                    planned.clear();
                }
                let (number, distance_m) = (action[0] as usize, m_from_mm(action[1]));
                let rotation = planner.rotation(number, distance_m, parts).filter(|_| distance_m != 0.0)?;
                Some(PlannedPulse::Rotation(rotation))
            }
        }
    }

    /// Forecast places of `parts` after `pulse`, m; `None` for a pulse of a kind that it does not plan.
    pub fn forecast(&self, parts: &[PartState], pulse: &PlannedPulse) -> Option<Vec<Vec2>> {
        match (self, pulse) {
            (Self::Fields { planner, .. }, PlannedPulse::Field(pulse)) => Some(planner.forecast(parts, pulse)),
            _ => None,
        }
    }

    /// Action of the planner for the steps of `parts`, whose sequence of rotations goes at most `stride_m` at once.
    pub fn expert(&mut self, parts: &[PartState], stride_m: Option<f64>) -> Vec<f64> {
        match self {
            Self::Fields { by_steps: true, .. } => {
                parts.iter().flat_map(|part| [part.step_m.x, part.step_m.y].map(mm_from_m)).collect()
            }
            Self::Fields { planner, max_sustain_s, .. } => {
                let Some(PlannedPulse::Field(pulse)) = plan_fields(planner, parts) else {
                    return vec![0.0; planner.coefficients() + 1];
                };
                let sustain = (2.0 * pulse.sustain_s / *max_sustain_s - 1.0).clamp(-1.0, 1.0);
                planner.shares_of(&pulse).into_iter().chain([sustain]).collect()
            }
            Self::Rotations { planner, planned } => {
                if planned.is_empty() {
                    planner.limit_stride(stride_m);
                    let pulses = fallbacks(parts, true).map(|(steps, _)| planner.plan(&steps, &[]).pulses);
                    let pulses = pulses.into_iter().find(|pulses| !pulses.is_empty()).unwrap_or_default();
                    planned.extend(pulses.iter().filter_map(|pulse| match pulse {
                        PlannedPulse::Rotation(rotation) => {
                            Some(vec![planner.number_of(rotation)? as f64, mm_from_m(rotation.distance_m)])
                        }
                        PlannedPulse::Field(_) => None,
                    }));
                }
                planned.front().cloned().unwrap_or_else(|| vec![0.0; 2])
            }
        }
    }
}

/// The pulse for the steps of `parts`, or where they are infeasible for one part at a time, the farthest first.
fn plan_fields(planner: &mut FieldPlanner, parts: &[PartState]) -> Option<PlannedPulse> {
    for (steps, _) in fallbacks(parts, true) {
        let plan = planner.plan(&steps, &[]);
        if plan.status == PlanStatus::NothingToDo || !plan.pulses.is_empty() {
            return plan.pulses.into_iter().next();
        }
    }
    None
}
