use re_sdk_types::archetypes::TextLog;
use re_sdk_types::components::TextLogLevel;

use super::run_stream::{LogResult, RunStream};
use crate::types::RunContext;
use upm_control::{CycleFacts, EventFacts, EventLevel};
use upm_core::document::counted;
use upm_core::units::mm_from_m;
use upm_perception::vision::Table;
use upm_planning::planner::PlanStatus;

/// The log of a run as text.
#[derive(Default)]
pub(super) struct LogView {
    phase: String,
}

impl LogView {
    pub(super) fn localised(&self, stream: &RunStream, table: &Table, found: usize, context: &RunContext) -> LogResult {
        let (parts, side_px, turned_deg) = (context.parts.len(), table.side_px, table.rotation_rad.to_degrees());
        let table = format!("the table found, side {side_px:.1} px, turned by {turned_deg:.2}°");
        let text = format!("{found} of {parts} parts and {table}");
        log_line(stream, TextLogLevel::INFO, text)
    }

    pub(super) fn planned(&mut self, stream: &RunStream, cycle: &CycleFacts) -> LogResult {
        if cycle.wanted.phase != self.phase {
            self.phase.clone_from(&cycle.wanted.phase);
            log_line(stream, TextLogLevel::INFO, self.phase.clone())?;
        }
        let (level, plan) = match &cycle.plan.status {
            PlanStatus::Solved => (TextLogLevel::DEBUG, counted(cycle.plan.pulses.len(), "pulse")),
            PlanStatus::NothingToDo => (TextLogLevel::DEBUG, "nothing to do".to_owned()),
            PlanStatus::Infeasible(limit) => (TextLogLevel::WARN, format!("no plan ({limit:?})")),
            PlanStatus::SolverFailed(reason) => (TextLogLevel::WARN, format!("no plan ({reason})")),
        };
        let errors = cycle.result_m.iter().zip(&cycle.wanted.subgoals_m).map(|(at, subgoal)| (at - subgoal).norm());
        let worst_mm = mm_from_m(errors.fold(0.0, f64::max));
        log_line(stream, level, format!("{worst_mm:.2} mm from subgoals at most, {plan}, cycle {}", cycle.index))
    }

    pub(super) fn event(&self, stream: &RunStream, event: &EventFacts) -> LogResult {
        let level = match event.level {
            EventLevel::Info => TextLogLevel::INFO,
            EventLevel::Warning => TextLogLevel::WARN,
            EventLevel::Error => TextLogLevel::ERROR,
        };
        log_line(stream, level, event.text.clone())
    }
}

/// Logs a line at the time of the last fact.
pub(super) fn log_line(stream: &RunStream, level: &str, text: String) -> LogResult {
    stream.log("log", &TextLog::new(text).with_level(level))
}
