use super::found::{Found, Reason};
use upm_core::geometry::Vec2;
use upm_core::job::{EventLevel, Outcome, StopCause};
use upm_core::signal::{AccelTrace, Drive, Frame};
use upm_core::time::PlateTime;
use upm_perception::estimation::{FitError, PlateFit};
use upm_perception::vision::{Detection, Table, Track};
use upm_planning::planner::{Plan, PlannedPulse};
use upm_planning::task::Setpoints;

/// The first observation: table and parts located without prior knowledge.
#[derive(Clone, Copy, Debug)]
pub struct LocalisedFacts<'a> {
    /// The frame looked at.
    pub frame: &'a Frame,
    /// The table in it.
    pub table: &'a Table,
    /// The parts in it, in the order of the job.
    pub detections: &'a [Detection],
    /// Wall time the search took, µs; 0 when no clock runs.
    pub localise_us: f64,
}

/// An observation before a task counts as completed: table and parts located without prior knowledge, at the places
/// where they were tracked.
#[derive(Clone, Copy, Debug)]
pub struct ConfirmedFacts<'a> {
    /// Exposure time of the frame.
    pub at: PlateTime,
    /// Largest distance between the table's corners as located and as tracked, px.
    pub corner_px: f64,
    /// Largest such distance for the parts, m.
    pub part_m: f64,
    /// Positions located in the frame, m, in the order of the job.
    pub parts_m: &'a [Vec2],
}

/// One tracked frame.
#[derive(Clone, Copy, Debug)]
pub struct FrameFacts<'a> {
    /// Picture in which the parts were tracked.
    pub frame: &'a Frame,
    /// The parts in it.
    pub tracks: &'a [Track],
    /// True while the plate vibrates or parts may still coast.
    pub driving: bool,
    /// True while the pictures are unreliable and control waits for that to end; control ends the run when it has
    /// waited for too long.
    pub blind: bool,
    /// True for the frame that starts a cycle, taken with everything at rest; in motion for some that do.
    pub starts_cycle: bool,
    /// Wall time tracking took, µs; 0 when no clock runs.
    pub track_us: f64,
}

/// One pulse after it was played.
#[derive(Clone, Debug)]
pub struct PulseFacts {
    /// Number of the cycle.
    pub cycle: u64,
    /// Time of its start.
    pub started_at: PlateTime,
    /// Rotation or field that was to be played.
    pub planned: PlannedPulse,
    /// True for the small probe at the beginning, which moves no part.
    pub is_probe: bool,
    /// The signal sent to the motors.
    pub drive: Drive,
    /// The accelerometers' trace.
    pub trace: AccelTrace,
    /// The plate's motion fitted to the trace.
    pub fit: Result<PlateFit, FitError>,
    /// The positions of the parts; `None` when one of them was out of sight.
    pub positions: Option<PulsePositions>,
}

/// Positions of the parts before and after a pulse, by the camera and by forecast. Each m, in the order of the job.
#[derive(Clone, Debug)]
pub struct PulsePositions {
    /// Positions before the pulse.
    pub before_m: Vec<Vec2>,
    /// Measured positions after it.
    pub after_m: Vec<Vec2>,
    /// Positions after it as forecast by the library alone.
    pub by_library_m: Vec<Vec2>,
    /// After it by the library and the gains learned until then.
    pub by_learning_m: Vec<Vec2>,
}

/// One cycle, after its last pulse and the observation that follows it.
#[derive(Clone, Debug)]
pub struct CycleFacts {
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
    /// True for a cycle that ends with all parts at rest; they may still move after a segment without a pause.
    pub ends_at_rest: bool,
    /// Wall time planning took, µs; 0 when no clock runs.
    pub plan_us: f64,
    /// Wall time the whole cycle took, µs; 0 when no clock runs.
    pub cycle_us: f64,
}

/// Something worth a line in the log.
#[derive(Clone, Debug, PartialEq)]
pub struct EventFacts {
    /// Plate time of the event.
    pub at: PlateTime,
    /// Severity; a warning for every finding.
    pub level: EventLevel,
    /// The event for people; for a finding the reason and a remedy at its beginning, the reason and the number of
    /// cycles in which it held at its end.
    pub text: String,
    /// The event for programs.
    pub kind: EventKind,
}

/// Meaning of an event for programs.
#[derive(Clone, Debug, PartialEq)]
pub enum EventKind {
    /// None: it is for people alone.
    Note,
    /// A lasting finding of the run began or ended.
    Finding {
        /// The finding, and what it is about.
        found: Found,
        /// Number of cycles in which it held, once it no longer holds or the run has ended; `None` when it begins.
        ended_after: Option<u64>,
        /// The reason alone.
        reason: Reason,
    },
    /// The run ended. A stopped run may have a second such event, with the cause of the stop.
    RunEnded {
        /// Completed, failed or cancelled.
        outcome: Outcome,
        /// The cause; `None` where the outcome says it all.
        cause: Option<StopCause>,
    },
    /// The recording ended before the run did.
    RecordingEnded,
}

impl EventFacts {
    /// An event for people alone.
    pub fn note(at: PlateTime, level: EventLevel, text: impl Into<String>) -> Self {
        Self { at, level, text: text.into(), kind: EventKind::Note }
    }
}

/// Receives the facts that the control loop reports. A sink has no effect on the run: runs with and without it are
/// equal.
pub trait Sink {
    /// Table and parts were found.
    fn localised(&mut self, _facts: &LocalisedFacts<'_>) {}
    /// An observation confirmed the table and the parts.
    fn confirmed(&mut self, _facts: &ConfirmedFacts<'_>) {}
    /// A cycle begins with the observation at `at` and these setpoints.
    fn setpoints(&mut self, _at: PlateTime, _wanted: &Setpoints) {}
    /// A frame was tracked.
    fn frame(&mut self, _facts: &FrameFacts<'_>) {}
    /// A pulse was played.
    fn pulse(&mut self, _facts: &PulseFacts) {}
    /// A cycle ended.
    fn cycle(&mut self, _facts: &CycleFacts) {}
    /// An event: a lasting finding that began or ended, the end of the run or of its recording, a note.
    fn event(&mut self, _event: &EventFacts) {}
}
