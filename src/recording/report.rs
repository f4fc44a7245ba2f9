use serde::{Deserialize, Serialize};

use super::timings::TimingsReport;
use upm_control as control;

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// The goal was reached.
    Completed,
    /// It was not.
    Failed,
    /// Somebody stopped it.
    Cancelled,
}

impl From<control::Outcome> for Outcome {
    fn from(outcome: control::Outcome) -> Self {
        match outcome {
            control::Outcome::Completed => Self::Completed,
            control::Outcome::Failed => Self::Failed,
            control::Outcome::Cancelled => Self::Cancelled,
        }
    }
}

/// Stable code of the cause that ended a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StopCode {
    /// It gave way to another job, between two cycles.
    GaveWay,
    /// Pulses, or time without one, brought no part nearer to its target.
    NoProgress,
    /// A cycle had no plan that keeps the limits.
    NoFeasibleStep,
    /// Rotations of the library cannot move the parts independently where they were first seen.
    Uncontrollable,
    /// The plate time limit was reached.
    TimeLimit,
    /// A part cannot be seen any more.
    PartLost,
    /// The camera does not see the parts of the job when the run begins.
    PartCount,
    /// The rig failed.
    DeviceFault,
    /// The camera sees no table.
    TableMissing,
    /// The camera sends the same pictures again and again.
    CameraFrozen,
    /// Numbers or stamps of the camera's frames do not fit the present.
    CameraStale,
    /// The camera's frames show no plate.
    CameraDark,
    /// The plate is not where it was in the picture.
    CameraMoved,
    /// The plate moves later in the pictures than it is driven.
    CameraLate,
    /// Something large hides part of the plate.
    ViewHidden,
    /// Something of a part's size lies on the plate that is no part of the job.
    ForeignPart,
    /// Parts are not where they can have got to.
    PartsJumped,
    /// A voice coil does not do what it is sent.
    CoilFault,
    /// An accelerometer channel does not show how the plate moves.
    AccelerometerFault,
    /// The plate does not move as planned.
    MotionOff,
    /// A part hardly moves although pulses should carry it.
    PartStuck,
    /// A part goes the other way than pulses should carry it.
    PartAstray,
    /// This computer was too slow for the plate, under strict deadlines.
    DeadlineMissed,
    /// Control took no frame for a long time.
    Hung,
    /// No part was seen for a long time.
    NoPartSeen,
    /// Events of the run could not be stored.
    EventsBlocked,
    /// The journal could not be written.
    JournalBlocked,
}

impl StopCode {
    /// The code of `cause`; `None` where the outcome says it all.
    pub fn of(cause: control::EndCause) -> Option<Self> {
        match cause {
            control::EndCause::Run => None,
            control::EndCause::GaveWay => Some(Self::GaveWay),
            control::EndCause::NoProgress => Some(Self::NoProgress),
            control::EndCause::NoFeasibleStep => Some(Self::NoFeasibleStep),
            control::EndCause::Uncontrollable => Some(Self::Uncontrollable),
            control::EndCause::TimeLimit => Some(Self::TimeLimit),
            control::EndCause::PartLost => Some(Self::PartLost),
            control::EndCause::PartCount => Some(Self::PartCount),
            control::EndCause::Device => Some(Self::DeviceFault),
            control::EndCause::Guard(condition) => Self::of_guard(condition),
            control::EndCause::DeadlineMissed => Some(Self::DeadlineMissed),
            control::EndCause::Hung => Some(Self::Hung),
            control::EndCause::NoPartSeen => Some(Self::NoPartSeen),
            control::EndCause::EventsBlocked => Some(Self::EventsBlocked),
            control::EndCause::JournalBlocked => Some(Self::JournalBlocked),
        }
    }

    fn of_guard(condition: control::Condition) -> Option<Self> {
        use control::Condition;
        match condition {
            Condition::TableMissing => Some(Self::TableMissing),
            Condition::CameraFrozen => Some(Self::CameraFrozen),
            Condition::CameraStale => Some(Self::CameraStale),
            Condition::CameraDark => Some(Self::CameraDark),
            Condition::CameraMoved => Some(Self::CameraMoved),
            Condition::CameraLate => Some(Self::CameraLate),
            Condition::ViewHidden => Some(Self::ViewHidden),
            Condition::ForeignPart => Some(Self::ForeignPart),
            Condition::PartsJumped => Some(Self::PartsJumped),
            Condition::CoilFault { .. } => Some(Self::CoilFault),
            Condition::AccelerometerFault { .. } => Some(Self::AccelerometerFault),
            Condition::MotionOff => Some(Self::MotionOff),
            Condition::PartStuck { .. } => Some(Self::PartStuck),
            Condition::PartAstray { .. } => Some(Self::PartAstray),
            Condition::StepsMeetEdge
            | Condition::StepsMeetParts
            | Condition::StepsUnreachable
            | Condition::SolverFails
            | Condition::PartBlocked { .. }
            | Condition::PartSlow { .. } => None,
        }
    }

    /// Its name in files, which never changes.
    pub fn code(self) -> &'static str {
        match self {
            Self::GaveWay => "gave_way",
            Self::NoProgress => "no_progress",
            Self::NoFeasibleStep => "no_feasible_step",
            Self::Uncontrollable => "uncontrollable",
            Self::TimeLimit => "time_limit",
            Self::PartLost => "part_lost",
            Self::PartCount => "part_count",
            Self::DeviceFault => "device_fault",
            Self::TableMissing => "table_missing",
            Self::CameraFrozen => "camera_frozen",
            Self::CameraStale => "camera_stale",
            Self::CameraDark => "camera_dark",
            Self::CameraMoved => "camera_moved",
            Self::CameraLate => "camera_late",
            Self::ViewHidden => "view_hidden",
            Self::ForeignPart => "foreign_part",
            Self::PartsJumped => "parts_jumped",
            Self::CoilFault => "coil_fault",
            Self::AccelerometerFault => "accelerometer_fault",
            Self::MotionOff => "motion_off",
            Self::PartStuck => "part_stuck",
            Self::PartAstray => "part_astray",
            Self::DeadlineMissed => "deadline_missed",
            Self::Hung => "hung",
            Self::NoPartSeen => "no_part_seen",
            Self::EventsBlocked => "events_blocked",
            Self::JournalBlocked => "journal_blocked",
        }
    }

    /// True for an end by a guard or the time limit: a person looks what is wrong before the plate takes another job.
    pub fn pauses_plate(self) -> bool {
        !matches!(self, Self::GaveWay | Self::NoFeasibleStep | Self::Uncontrollable)
    }
}

/// The cause that ended a run: a code for programs, a text for people.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct StopReport {
    /// Stable code.
    pub code: StopCode,
    /// The same in words, with the remedy.
    pub text: String,
    /// What the operator should check or change; `None` where there is nothing, and in reports from before it was told.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remedy: Option<String>,
}

impl StopReport {
    /// The report of an end by `cause`, for the reason `text`; `None` where the outcome says it all.
    pub fn of(cause: control::EndCause, text: &str) -> Option<Self> {
        let remedy = cause.remedy().map(str::to_owned);
        Some(Self { code: StopCode::of(cause)?, text: text.to_owned(), remedy })
    }
}

/// `report.json`. Lengths in mm, to 1e-4.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Name of the job.
    pub name: String,
    /// Its seed.
    pub seed: u64,
    /// Version of this program.
    pub version: String,
    /// The planner that ran and why; `None` in reports from before it was told.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub planner: Option<PlannerReport>,
    /// How the run ended.
    pub outcome: Outcome,
    /// Why, in words.
    pub reason: String,
    /// Whether the truth agrees that the goal was reached; only on a simulated rig.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verdict: Option<Verdict>,
    /// The cause that ended it, where programs tell it apart.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stop: Option<StopReport>,
    /// The experiment's own time, s.
    pub plate_time_s: f64,
    /// Least plate time by rotations, s: the relaxed program over the library at the flows of the start, no strict bound.
    /// `None` for tasks without final targets, for more than 16 parts and for runs without a pulse.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bound_s: Option<f64>,
    /// Time on the wall, s.
    pub wall_time_s: f64,
    /// Frames tracked.
    pub frames: u64,
    /// Cycles ended.
    pub cycles: u64,
    /// Pulses played.
    pub pulses: u64,
    /// Laps completed.
    pub laps: u32,
    /// Touches between parts; `None` on a rig that does not tell.
    pub collisions: Option<u64>,
    /// Parts lost.
    pub lost_parts: usize,
    /// Deadlines missed; only where plate time kept to the clock.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub deadline_misses: Option<u64>,
    /// Whole frames by which the worst of them was missed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub worst_late_frames: Option<u64>,
    /// How far plate time fell behind the clock in all, s: a plate that waited for this computer. Only where plate time
    /// kept to the clock; `None` in reports from before it was measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub behind_s: Option<f64>,
    /// Largest distance of a part from its target at the end, from truth where there is one; `None` without targets.
    pub max_error_mm: Option<f64>,
    /// Root mean square of those distances.
    pub rms_error_mm: Option<f64>,
    /// Measured against true positions over every frame that shows the part, root mean square; `None` without truth.
    pub sensing_rms_error_mm: Option<f64>,
    /// The same over frames taken at rest alone.
    pub sensing_rms_error_at_rest_mm: Option<f64>,
    /// Measured distance from the path over all cycles in which a part had one, root mean square; `None` without paths.
    pub cross_track_rms_mm: Option<f64>,
    /// Its maximum.
    pub cross_track_max_mm: Option<f64>,
    /// Largest difference of a part's phase from the common one, as a part of a period; `None` without phases to keep.
    pub phase_error_max: Option<f64>,
    /// Where pulses were forecast to carry parts against where they did; `None` without a pulse.
    pub prediction_error_mm: Option<PredictionError>,
    /// Every part, in the order of the job.
    pub parts: Vec<PartReport>,
    /// How long things took, µs of wall time.
    pub timing_us: TimingsReport,
    /// Guards that fired, in the order in which they did.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub guards: Vec<GuardReport>,
    /// Faults of the simulated rig that began within the run.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub faults: Vec<FaultReport>,
    /// What went wrong beside the run itself: a recording that does not hold all of it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
}

/// What the truth says of an outcome.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The outcome is true.
    True,
    /// The run counts as completed, and a part is farther from its target, or from where it is believed to be on a path
    /// without a last place, than the tolerance and 0.1 mm.
    FalseSuccess,
}

/// A guard that fired.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GuardReport {
    /// Stable code.
    pub code: String,
    /// When, s of plate time.
    pub at_s: f64,
    /// What it found and what to check.
    pub text: String,
}

/// A fault of the simulated rig.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaultReport {
    /// Where.
    pub component: String,
    /// What.
    pub kind: String,
    /// How much.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub value: Vec<f64>,
    /// From when, s of plate time.
    pub from_s: f64,
    /// Until when, s; `None` for good.
    pub to_s: Option<f64>,
}

/// The planner of a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlannerReport {
    /// Its name in a job file.
    pub name: String,
    /// Who named it.
    pub chosen: SelectedBy,
    /// Why it was this one, for programs.
    pub code: String,
    /// The same for people.
    pub why: String,
    /// The others that the rig could run, by their names in a job file.
    pub alternatives: Vec<String>,
}

/// Who named the planner of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SelectedBy {
    /// The program, for a job that leaves it open or says `auto`.
    Auto,
    /// The job.
    Job,
}

/// Distances of forecast places from measured ones over every pulse and part, root mean square, mm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PredictionError {
    /// Forecast by the library alone.
    pub library: f64,
    /// Forecast with what the run had learned of friction and regions until then.
    pub learned: f64,
}

/// One part at the end of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PartReport {
    /// Name in this run: `penny-1`.
    pub id: String,
    /// Its kind.
    pub kind: String,
    /// Where it should be; `None` when nothing was wanted of it.
    pub target_mm: Option<[f64; 2]>,
    /// Where it was last seen; `None` when it never was.
    pub measured_mm: Option<[f64; 2]>,
    /// Where it truly is; `None` on a rig that does not tell.
    pub true_mm: Option<[f64; 2]>,
    /// Distance to the target, from truth where there is one.
    pub error_mm: Option<f64>,
}
