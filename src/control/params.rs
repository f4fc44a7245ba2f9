use super::eyes::ExpectedPart;
use super::guards::Guards;
use upm_core::rig::PartKind;
use upm_planner::{Method, PlannerParams};

/// Parameters of a run beside the rig's model.
#[derive(Clone, Debug)]
pub struct ControlParams {
    /// Kinds of parts on the plate.
    pub kinds: Vec<PartKind>,
    /// The parts, in the order of the job.
    pub parts: Vec<ExpectedPart>,
    /// Plate time after which the run ends, s.
    pub time_limit_s: f64,
    /// True when the task has no end before the time limit, which then completes it.
    pub endless: bool,
    /// True when parts follow paths: their subgoals move on as they do.
    pub follows_paths: bool,
    /// How near to its target a part has arrived, m.
    pub tolerance_m: f64,
    /// Frames at rest without a part after which it is lost.
    pub lost_after_frames: u32,
    /// How motions are found.
    pub method: Method,
    /// Limits and weights of the planner.
    pub planner: PlannerParams,
    /// Guards that are awake.
    pub guards: Guards,
}

impl ControlParams {
    /// Name of part `part` for people; `?` for one there is not.
    pub(super) fn id(&self, part: usize) -> &str {
        self.parts.get(part).map_or("?", |part| part.id.as_str())
    }

    /// Outline of part `part`, m; 0 for one there is not.
    pub fn radius_m(&self, part: usize) -> f64 {
        let kind = self.parts.get(part).and_then(|part| self.kinds.get(part.kind));
        kind.map_or(0.0, |kind| kind.radius_m)
    }
}
