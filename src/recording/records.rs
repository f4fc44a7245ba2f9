use upm_control::{CycleFacts, EventLevel, MilestoneFacts, PulseFacts};
use upm_core::geometry::Vec2;
use upm_core::signal::{AccelTrace, Drive};
use upm_core::time::PlateTime;
use upm_perception::estimation::{FitFault, PlateFit};
use upm_planning::planner::{Plan, PlannedPulse};
use upm_planning::task::Setpoints;

/// An owned copy of [`PulseFacts`].
#[derive(Clone, Debug)]
pub struct PulseRecord {
    /// Number of the cycle.
    pub cycle: u64,
    /// Time of its start.
    pub started_at: PlateTime,
    /// The pulse as planned.
    pub planned: PlannedPulse,
    /// The signal sent to the motors.
    pub drive: Drive,
    /// The accelerometers' trace.
    pub trace: AccelTrace,
    /// The plate's motion fitted to the trace.
    pub fit: Result<PlateFit, FitFault>,
}

impl From<&PulseFacts<'_>> for PulseRecord {
    fn from(facts: &PulseFacts<'_>) -> Self {
        Self {
            cycle: facts.cycle,
            started_at: facts.started_at,
            planned: facts.planned.clone(),
            drive: facts.drive.clone(),
            trace: facts.trace.clone(),
            fit: facts.fit.clone(),
        }
    }
}

/// An owned copy of [`CycleFacts`].
#[derive(Clone, Debug)]
pub struct CycleRecord {
    /// Number of the cycle, from 0.
    pub index: u64,
    /// Time of the observation that the plan is based on.
    pub observed_at: PlateTime,
    /// Positions measured then, m.
    pub observed_m: Vec<Vec2>,
    /// The task's request.
    pub wanted: Setpoints,
    /// Pulses planned from that observation.
    pub plan: Plan,
    /// Time of the next observation.
    pub ended_at: PlateTime,
    /// Positions measured then, m.
    pub result_m: Vec<Vec2>,
    /// Wall time planning took, µs.
    pub plan_us: f64,
    /// Wall time the whole cycle took, µs.
    pub cycle_us: f64,
}

impl From<&CycleFacts<'_>> for CycleRecord {
    fn from(facts: &CycleFacts<'_>) -> Self {
        Self {
            index: facts.index,
            observed_at: facts.observed_at,
            observed_m: facts.observed_m.to_vec(),
            wanted: facts.wanted.clone(),
            plan: facts.plan.clone(),
            ended_at: facts.ended_at,
            result_m: facts.result_m.to_vec(),
            plan_us: facts.plan_us,
            cycle_us: facts.cycle_us,
        }
    }
}

/// An event of a run with its time and severity.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EventRecord {
    /// Plate time of the event.
    pub at: PlateTime,
    /// Severity.
    pub level: EventLevel,
    /// The message.
    pub text: String,
}

impl EventRecord {
    /// The event `text` at `at`.
    pub fn new(at: PlateTime, level: EventLevel, text: &str) -> Self {
        Self { at, level, text: text.to_owned() }
    }
}

impl From<&MilestoneFacts<'_>> for EventRecord {
    fn from(facts: &MilestoneFacts<'_>) -> Self {
        Self::new(facts.at, facts.level, facts.text)
    }
}
