use re_sdk_types::archetypes::TextLog;
use re_sdk_types::components::TextLogLevel;

use super::field::strongest_speed_mps;
use super::run_stream::{LogResult, RunStream};
use crate::types::RunContext;
use upm_control::EventLevel;
use upm_core::units::mm_from_m;
use upm_perception::vision::Table;
use upm_planning::cor_library::Library;
use upm_planning::planner::{FieldPulse, PlanStatus, PlannedPulse, Rotation};
use upm_recording::{CycleRecord, EventRecord, MotionRecord};

/// The log of a run as text.
#[derive(Default)]
pub(super) struct LogView {
    phase: String,
}

impl LogView {
    pub(super) fn localised(&self, stream: &RunStream, table: &Table, found: usize, context: &RunContext) -> LogResult {
        let text = format!(
            "found the table, side {:.1} px, turned by {:.2}°, and {} of {} parts",
            table.side_px,
            table.rotation_rad.to_degrees(),
            found,
            context.parts.len()
        );
        log_line(stream, TextLogLevel::INFO, text)
    }

    pub(super) fn planned(&mut self, stream: &RunStream, cycle: &CycleRecord, context: &RunContext) -> LogResult {
        if cycle.wanted.phase != self.phase {
            self.phase.clone_from(&cycle.wanted.phase);
            log_line(stream, TextLogLevel::INFO, self.phase.clone())?;
        }
        let (level, plan) = match &cycle.plan.status {
            PlanStatus::Solved => (TextLogLevel::DEBUG, sequence(&cycle.plan.pulses, context)),
            PlanStatus::NothingToDo => (TextLogLevel::DEBUG, "nothing to do".to_owned()),
            PlanStatus::Infeasible(limit) => (TextLogLevel::WARN, format!("no plan: {limit:?}")),
            PlanStatus::SolverFailed(reason) => (TextLogLevel::WARN, format!("no plan: {reason}")),
        };
        let errors = cycle.result_m.iter().zip(&cycle.wanted.subgoals_m).map(|(at, subgoal)| (at - subgoal).norm());
        let worst_mm = mm_from_m(errors.fold(0.0, f64::max));
        log_line(stream, level, format!("cycle {}: {plan}; ends within {worst_mm:.2} mm of the subgoals", cycle.index))
    }

    pub(super) fn event(&self, stream: &RunStream, event: &EventRecord) -> LogResult {
        let level = match event.level {
            EventLevel::Info => TextLogLevel::INFO,
            EventLevel::Warning => TextLogLevel::WARN,
            EventLevel::Error => TextLogLevel::ERROR,
        };
        log_line(stream, level, event.text.clone())
    }

    /// Logs a warning at the time of the last fact.
    pub(super) fn warn(&self, stream: &RunStream, text: String) -> LogResult {
        log_line(stream, TextLogLevel::WARN, text)
    }
}

fn log_line(stream: &RunStream, level: &str, text: String) -> LogResult {
    stream.log("log", &TextLog::new(text).with_level(level))
}

/// The pulses in playing order, as text.
fn sequence(pulses: &[PlannedPulse], context: &RunContext) -> String {
    let words = pulses.iter().map(|pulse| match pulse {
        PlannedPulse::Rotation(pulse) => rotation(pulse, &context.library),
        PlannedPulse::Field(pulse) => field(pulse, 0.5 * context.model.plate_side_m),
    });
    words.collect::<Vec<_>>().join(", ")
}

/// A rotation as text: `4.0 mm about (10, -35)` or `-2.1 mm along (0.00, 1.00)`.
fn rotation(pulse: &Rotation, library: &Library) -> String {
    let distance_mm = mm_from_m(pulse.distance_m);
    match library.entries.get(pulse.entry).and_then(|entry| MotionRecord::of(&entry.pump)) {
        Some(MotionRecord::About { center_m, .. }) => {
            format!("{distance_mm:.1} mm about ({:.0}, {:.0})", mm_from_m(center_m.x), mm_from_m(center_m.y))
        }
        Some(MotionRecord::Along { direction }) => {
            format!("{distance_mm:.1} mm along ({:.2}, {:.2})", direction.x, direction.y)
        }
        None => format!("{distance_mm:.1} mm"),
    }
}

/// A synthesised motion as text: `a field of 8 harmonics of 30.0 Hz for 120 ms, up to 0.85 m/s`.
fn field(pulse: &FieldPulse, half_side_m: f64) -> String {
    format!(
        "a field of {} harmonics of {:.1} Hz for {:.0} ms, up to {:.2} m/s",
        pulse.wave.harmonics.len(),
        pulse.wave.base_radps / std::f64::consts::TAU,
        pulse.sustain_s * 1e3,
        strongest_speed_mps(&pulse.wave, half_side_m)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use upm_core::geometry::{Twist, Vec2};
    use upm_core::signal::TwistWave;

    #[test]
    fn field_is_described_by_harmonics_sustain_and_strongest_speed() {
        // ½ + 1 of the amplitude at the corner farthest from the centre, half a period after the start
        let wave = TwistWave::pump(Twist::about(Vec2::new(0.1, 0.1), 2.0), std::f64::consts::TAU * 30.0);
        let words = field(&FieldPulse { wave, follows: Default::default(), sustain_s: 0.12 }, 0.1);
        assert_eq!(words, "a field of 2 harmonics of 30.0 Hz for 120 ms, up to 0.85 m/s");
    }
}
