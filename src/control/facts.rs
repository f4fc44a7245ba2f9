use super::condition::{Condition, ConditionChange};
use upm_core::geometry::Vec2;
use upm_core::job::{Outcome, RecordingEnd, StopCause};
use upm_core::signal::{AccelTrace, Drive, Frame};
use upm_core::time::PlateTime;
use upm_goal::Wanted;
use upm_perception::estimation::{FitFault, PlateFit};
use upm_perception::vision::{Detection, Stages, Table, Track};
use upm_planner::{Plan, PlannedPulse};

/// The first look: table and parts from nothing.
#[derive(Clone, Copy, Debug)]
pub struct LocalisedFacts<'a> {
    /// The frame looked at.
    pub frame: &'a Frame,
    /// The table in it.
    pub table: &'a Table,
    /// The parts in it, in the order of the job.
    pub detections: &'a [Detection],
    /// What the search went through.
    pub stages: &'a Stages,
    /// Wall time the search took, µs; 0 when no clock runs.
    pub localise_us: f64,
}

/// A look before a goal counts as reached: table and parts located from nothing, and found where they were tracked.
#[derive(Clone, Copy, Debug)]
pub struct ConfirmedFacts<'a> {
    /// When the frame was exposed.
    pub at: PlateTime,
    /// Largest distance between the table's corners as located and as tracked, px.
    pub corner_px: f64,
    /// The same for the parts, m.
    pub part_m: f64,
    /// Where the parts were located, m, in the order of the job.
    pub parts_m: &'a [Vec2],
}

/// One tracked frame.
#[derive(Clone, Copy, Debug)]
pub struct FrameFacts<'a> {
    /// The frame.
    pub frame: &'a Frame,
    /// The parts in it.
    pub tracks: &'a [Track],
    /// True while the plate vibrates or parts may still coast.
    pub sounding: bool,
    /// True while nothing can be relied on in the pictures, and control waits for that to end; it ends the run itself when
    /// it has waited for too long.
    pub blind: bool,
    /// True for the frame a cycle starts from, taken with everything at rest.
    pub starts_cycle: bool,
    /// Wall time tracking took, µs; 0 when no clock runs.
    pub track_us: f64,
}

/// One pulse, after it was played.
#[derive(Clone, Copy, Debug)]
pub struct PulseFacts<'a> {
    /// Number of the cycle.
    pub cycle: u64,
    /// When it started.
    pub started_at: PlateTime,
    /// What was planned.
    pub planned: &'a PlannedPulse,
    /// True for the small pulse at the beginning, which is to move no part.
    pub is_probe: bool,
    /// What was sent to the motors.
    pub drive: &'a Drive,
    /// What the accelerometers saw.
    pub trace: &'a AccelTrace,
    /// What they say of the plate's motion.
    pub fit: &'a Result<PlateFit, FitFault>,
    /// What it did to the parts; `None` when one of them was out of sight.
    pub carried: Option<Carried<'a>>,
}

/// What a pulse did to the parts, as the camera saw it, beside what was forecast. Each m, in the order of the job.
#[derive(Clone, Copy, Debug)]
pub struct Carried<'a> {
    /// Before it.
    pub before_m: &'a [Vec2],
    /// After it.
    pub after_m: &'a [Vec2],
    /// After it by the library alone.
    pub by_library_m: &'a [Vec2],
    /// After it by the library and what the run had learned until then.
    pub by_learning_m: &'a [Vec2],
}

/// One cycle, after its last pulse and the look that follows it.
#[derive(Clone, Copy, Debug)]
pub struct CycleFacts<'a> {
    /// Number of the cycle, from 0.
    pub index: u64,
    /// When the look was taken that the plan rests on.
    pub observed_at: PlateTime,
    /// Measured positions then, m.
    pub observed_m: &'a [Vec2],
    /// What the goal wanted.
    pub wanted: &'a Wanted,
    /// What was planned.
    pub plan: &'a Plan,
    /// When the next look was taken.
    pub ended_at: PlateTime,
    /// Measured positions then, m.
    pub result_m: &'a [Vec2],
    /// Wall time planning took, µs; 0 when no clock runs.
    pub plan_us: f64,
    /// Wall time the whole cycle took, µs; 0 when no clock runs.
    pub cycle_us: f64,
}

/// A condition of the run that began or ended.
#[derive(Clone, Copy, Debug)]
pub struct ConditionFacts<'a> {
    /// Plate time.
    pub at: PlateTime,
    /// Which.
    pub condition: Condition,
    /// Whether it began or ended.
    pub change: ConditionChange,
    /// For people: the reason alone.
    pub reason: &'a str,
    /// For people: the reason and a remedy at its begin, the reason and how often it held at its end.
    pub text: &'a str,
}

/// The run, or its recording, came to its end.
#[derive(Clone, Copy, Debug)]
pub struct MilestoneFacts<'a> {
    /// Plate time.
    pub at: PlateTime,
    /// How loud.
    pub level: EventLevel,
    /// Which, for programs.
    pub milestone: Milestone,
    /// The same for people.
    pub text: &'a str,
}

/// An event that programs tell from others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Milestone {
    /// The run ended. A run that was stopped may have a second one, with the cause of the stop.
    RunEnded {
        /// How.
        outcome: Outcome,
        /// By what; `None` where the outcome says it all.
        cause: Option<StopCause>,
    },
    /// The recording ended before the run did.
    RecordingEnded(RecordingEnd),
}

/// How loud an event is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EventLevel {
    /// The run goes on as it should.
    Info,
    /// Something was mended.
    Warning,
    /// The run ends because of it.
    Error,
}

impl EventLevel {
    /// Its name in files and on the network.
    pub fn name(self) -> &'static str {
        match self {
            Self::Info => "info",
            Self::Warning => "warning",
            Self::Error => "error",
        }
    }
}

/// Takes what the control loop tells. A sink changes nothing: runs with and without it are the same.
pub trait Sink {
    /// Table and parts were found.
    fn localised(&mut self, _facts: &LocalisedFacts<'_>) {}
    /// A look confirmed the table and the parts.
    fn confirmed(&mut self, _facts: &ConfirmedFacts<'_>) {}
    /// A frame was tracked.
    fn frame(&mut self, _facts: &FrameFacts<'_>) {}
    /// A pulse was played.
    fn pulse(&mut self, _facts: &PulseFacts<'_>) {}
    /// A cycle ended.
    fn cycle(&mut self, _facts: &CycleFacts<'_>) {}
    /// Something worth a line happened.
    fn event(&mut self, _at: PlateTime, _level: EventLevel, _text: &str) {}
    /// The run, or its recording, came to its end. A sink that does not tell it from others gets it as an event.
    fn milestone(&mut self, facts: &MilestoneFacts<'_>) {
        self.event(facts.at, facts.level, facts.text);
    }
    /// A lasting condition began or ended. A sink that does not tell them apart gets them as warnings.
    fn condition(&mut self, facts: &ConditionFacts<'_>) {
        self.event(facts.at, EventLevel::Warning, facts.text);
    }
}
