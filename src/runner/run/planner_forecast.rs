//! Choice of a planner by dry runs, where both could be the faster one.

use std::sync::Arc;

use super::dry_run::{WORK_MS, is_completed, named};
use super::planner_selection::{PlannerSelection, SelectionReason};
use super::setup::{self, RunSetup};
use crate::config::{Diagnostic, JobSpec, PlannerChoice, TaskSpec};
use upm_control::{self as control, DryRunParams, FreshPlanner};
use upm_cor_library::Library;
use upm_core::random::Streams;

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
    /// Selects the planner of `job`; where several parts could go either way, by a dry run of each.
    pub fn with_forecast(job: &JobSpec, library: &Arc<Library>) -> Self {
        let selection = Self::of(job);
        let SelectionReason::SeveralParts { parts } = selection.reason else { return selection };
        let has_targets = matches!(job.task, TaskSpec::Arrange { .. } | TaskSpec::Sort { .. });
        if parts > NEAR || !has_targets {
            return selection;
        }
        let time_s = |planner| predicted_time_s(&job.clone().with_planner(planner), library);
        let by_fields_s = time_s(PlannerChoice::SynthesizedField).unwrap_or(f64::INFINITY);
        match time_s(PlannerChoice::CorSequence) {
            Some(time_s) if time_s < by_fields_s => {
                let reason = SelectionReason::Forecast { plate_time_s: [time_s, by_fields_s] };
                let named = Self::of(&job.clone().with_planner(PlannerChoice::CorSequence));
                Self { reason, ..named }
            }
            _ => selection,
        }
    }
}

/// Plate time of `job` by one dry run, s; `None` where it does not reach the goal.
fn predicted_time_s(job: &JobSpec, library: &Arc<Library>) -> Option<f64> {
    let RunSetup { params, placed, model, .. } = RunSetup::planned_by(job, library, PlannerSelection::of(job)).ok()?;
    let planner = FreshPlanner::new(params.method, library, params.planner);
    let dry_run = DryRunParams {
        starts_m: named(&placed, &params),
        frame_hz: model.frame_hz,
        friction_spread: 0.0,
        streams: Streams::new(job.seed()),
        number: 0,
        most_work_ms: WORK_MS,
    };
    let mut task = setup::task(job, library, &placed, params.method);
    let done = control::dry_run(library, &planner, task.as_mut(), &params, &dry_run, &mut |_, _| {});
    is_completed(&done).then_some(done.plate_time_s)
}
