//! Choice of a planner by runs without pixels, where both could be the faster one.

use std::sync::Arc;

use super::in_memory::InMemoryRun;
use super::planner_selection::PlannerSelection;
use super::setup::RunSetup;
use crate::config::{Diagnostic, JobSpec, PlannerChoice, TaskSpec};
use upm_core::job::CameraMode;
use upm_planning::cor_library::Library;
use upm_planning::planner::PlanningMethod;

/// Most parts for which rotations can be as fast as fields.
const NEAR: usize = 4;

impl RunSetup {
    /// Selects the planner, places the parts and builds rig, task and parameters.
    ///
    /// # Errors
    /// Parts that find no places.
    pub fn new(job: &JobSpec, library: &Arc<Library>) -> Result<Self, Diagnostic> {
        Self::planned_by(job, library, PlannerSelection::with_forecast(job, library))
    }
}

impl PlannerSelection {
    /// Selects the planner of `job`; where several parts could go either way, by a run of each without pixels.
    pub fn with_forecast(job: &JobSpec, library: &Arc<Library>) -> Self {
        let selection = Self::of(job);
        let parts: usize = job.parts.iter().map(|group| group.count).sum();
        let is_open = job.planner == PlannerChoice::Auto && selection.method == PlanningMethod::SynthesizedField;
        let has_targets = matches!(job.task, TaskSpec::Arrange { .. } | TaskSpec::Sort { .. });
        if !is_open || parts > NEAR || !has_targets {
            return selection;
        }
        let time_s = |planner| predicted_time_s(&job.clone().with_planner(planner), library);
        let forecast = |method, time_s: f64, other_s: Option<f64>| {
            let other = other_s.map(|other_s| format!("the other {other_s:.1} s"));
            let other = other.unwrap_or("and the other does not reach the goal".to_owned());
            Self::new(job, method, "forecast", format!("by forecast it takes {time_s:.1} s of plate time, {other}"))
        };
        match (time_s(PlannerChoice::SynthesizedField), time_s(PlannerChoice::CorSequence)) {
            (Some(fields_s), rotations_s) if rotations_s.is_none_or(|rotations_s| fields_s <= rotations_s) => {
                forecast(PlanningMethod::SynthesizedField, fields_s, rotations_s)
            }
            (fields_s, Some(rotations_s)) => forecast(PlanningMethod::CorSequence, rotations_s, fields_s),
            _ => selection,
        }
    }
}

/// Plate time of a run of `job` without pixels, faults and what a run learns only later, s: parts have the friction of
/// the rig, and nothing knocks. `None` where it does not reach the goal.
fn predicted_time_s(job: &JobSpec, library: &Arc<Library>) -> Option<f64> {
    let mut job = job.clone().with_camera(CameraMode::Positions);
    job.faults.clear();
    job.rig.document.friction.spread = 0.0;
    job.rig.document.simulation.knocks = None;
    let report = InMemoryRun::planned_by(&job, Arc::clone(library), PlannerSelection::of(&job)).ok()?.run();
    report.reached_goal().then_some(report.plate_time_s)
}
