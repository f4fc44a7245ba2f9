//! The cause that ended a run, as reports have it.

use serde::{Deserialize, Serialize};

use upm_control as control;

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_the_names_in_files() {
        for code in [
            StopCode::GaveWay,
            StopCode::NoProgress,
            StopCode::NoFeasibleStep,
            StopCode::Uncontrollable,
            StopCode::TimeLimit,
            StopCode::PartLost,
            StopCode::PartCount,
            StopCode::DeviceFault,
            StopCode::TableMissing,
            StopCode::CameraFrozen,
            StopCode::CameraStale,
            StopCode::CameraDark,
            StopCode::CameraMoved,
            StopCode::CameraLate,
            StopCode::ViewHidden,
            StopCode::ForeignPart,
            StopCode::PartsJumped,
            StopCode::CoilFault,
            StopCode::AccelerometerFault,
            StopCode::MotionOff,
            StopCode::PartStuck,
            StopCode::PartAstray,
            StopCode::DeadlineMissed,
            StopCode::Hung,
            StopCode::NoPartSeen,
            StopCode::EventsBlocked,
            StopCode::JournalBlocked,
        ] {
            assert_eq!(serde_json::to_value(code).unwrap(), code.code());
        }
    }
}
