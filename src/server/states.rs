//! States of jobs, recordings, plates and standing jobs, as the store keeps them and the network has them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use upm_core::job::{Outcome, StopCause};

/// How far a job has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum JobState {
    /// Waits for its plate.
    Queued,
    /// Is on its plate.
    Running,
    /// Reached its goal.
    Completed,
    /// Did not.
    Failed,
    /// Somebody stopped it, or took it out of the queue.
    Cancelled,
    /// The daemon ended while it ran.
    Interrupted,
}

impl JobState {
    /// Every state.
    pub const ALL: [Self; 6] =
        [Self::Queued, Self::Running, Self::Completed, Self::Failed, Self::Cancelled, Self::Interrupted];

    /// As it is written: `queued`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Running => "running",
            Self::Completed => "completed",
            Self::Failed => "failed",
            Self::Cancelled => "cancelled",
            Self::Interrupted => "interrupted",
        }
    }

    /// The state of that name.
    pub fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|state| state.name() == name)
    }

    /// The state of a job whose run ended so.
    pub fn of_end(outcome: Outcome, stop: Option<StopCause>) -> Self {
        match (outcome, stop) {
            (Outcome::Completed, _) => Self::Completed,
            (Outcome::Failed, _) => Self::Failed,
            // the daemon's own stops: nobody asked for the end of this run
            (Outcome::Cancelled, None | Some(StopCause::Stopped | StopCause::Shutdown)) => Self::Interrupted,
            (Outcome::Cancelled, Some(stop)) if stop.is_by_watchdog() => Self::Failed,
            (Outcome::Cancelled, Some(_)) => Self::Cancelled,
        }
    }

    /// True for states that no job leaves again.
    pub fn is_final(self) -> bool {
        !matches!(self, Self::Queued | Self::Running)
    }
}

/// What there is of a job's recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(rename = "RecordingState")]
pub enum RecordingStatus {
    /// Nothing: there was none, or the job has not begun.
    None,
    /// A file that is being written, or was not closed.
    Partial,
    /// A whole file.
    Whole,
    /// A file that was not closed and has been repaired.
    Recovered,
    /// A whole file that ends before the run does: the disk ran low.
    Stopped,
    /// Writing it failed.
    Failed,
    /// Deleted to make room.
    Pruned,
}

impl RecordingStatus {
    /// Every one.
    pub const ALL: [Self; 7] =
        [Self::None, Self::Partial, Self::Whole, Self::Recovered, Self::Stopped, Self::Failed, Self::Pruned];

    /// As it is written: `whole`.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Partial => "partial",
            Self::Whole => "whole",
            Self::Recovered => "recovered",
            Self::Stopped => "stopped",
            Self::Failed => "failed",
            Self::Pruned => "pruned",
        }
    }

    /// The one of that name.
    pub fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|status| status.name() == name)
    }
}

/// What a plate is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PlateState {
    /// Nothing, and would take a job.
    Idle,
    /// A job.
    Running,
    /// Nothing until a person resumes it.
    Paused,
    /// Nothing: an emergency stop holds until a person resets it.
    Stopped,
}

impl PlateState {
    /// As it is written: `idle`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::Running => "running",
            Self::Paused => "paused",
            Self::Stopped => "stopped",
        }
    }
}

/// State of a standing job.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum StandingState {
    /// It is on its plate, and gives way to any job that is queued.
    Running,
    /// It runs as soon as its plate may move and nothing is queued.
    Waiting,
    /// It waits for a person to resume the plate.
    Paused,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_on_the_network() {
        for state in JobState::ALL {
            assert_eq!(serde_json::to_value(state).unwrap(), state.name());
        }
        for status in RecordingStatus::ALL {
            assert_eq!(serde_json::to_value(status).unwrap(), status.name());
        }
        for state in [PlateState::Idle, PlateState::Running, PlateState::Paused, PlateState::Stopped] {
            assert_eq!(serde_json::to_value(state).unwrap(), state.name());
        }
    }
}
