use super::guards::Guards;
use super::perception::ExpectedPart;
use upm_core::rig::PartKind;
use upm_planning::planner::{PlannerParams, PlanningMethod};

/// Parameters of a run in addition to the rig's model.
#[derive(Clone, Debug, Default)]
pub struct ControlParams {
    /// Kinds of parts on the plate.
    pub kinds: Vec<PartKind>,
    /// The parts, in the order of the job.
    pub parts: Vec<ExpectedPart>,
    /// Plate time after which the run ends, s.
    pub time_limit_s: f64,
    /// True when the task has no end before the time limit, which then completes it.
    pub endless: bool,
    /// True when parts follow paths: their subgoals advance with them.
    pub follows_paths: bool,
    /// Distance to its target at which a part has arrived, m.
    pub tolerance_m: f64,
    /// Number of frames at rest without a part after which it is lost.
    pub lost_after_frames: u32,
    /// The planner's method.
    pub method: PlanningMethod,
    /// Limits and weights of the planner.
    pub planner: PlannerParams,
    /// Active guards.
    pub guards: Guards,
}

impl ControlParams {
    /// Name of part `part` for people; `?` for an unknown index.
    pub(super) fn id(&self, part: usize) -> &str {
        self.parts.get(part).map_or("?", |part| part.id.as_str())
    }

    /// Mass of all parts as if of solid metal, kg: it is not in the files of kinds.
    pub(super) fn parts_mass_kg(&self) -> f64 {
        const DENSITY_KG_M3: f64 = 8.5e3;
        let kinds = self.parts.iter().filter_map(|part| self.kinds.get(part.kind));
        kinds.map(|kind| DENSITY_KG_M3 * std::f64::consts::PI * kind.radius_m.powi(2) * kind.thickness_m).sum()
    }

    /// Outline of part `part`, m; 0 for an unknown index.
    pub fn radius_m(&self, part: usize) -> f64 {
        let kind = self.parts.get(part).and_then(|part| self.kinds.get(part.kind));
        kind.map_or(0.0, |kind| kind.radius_m)
    }
}
