//! States of jobs, recordings, plates and standing jobs, as the store keeps them and the network has them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use upm_core::coded_enum;
use upm_core::job::{Outcome, StopCause};

coded_enum! {
    /// How far a job has come.
    #[derive(JsonSchema)]
    pub enum JobState {
        /// Waits for its plate.
        Queued = "queued",
        /// Is on its plate.
        Running = "running",
        /// Reached its goal.
        Completed = "completed",
        /// Did not.
        Failed = "failed",
        /// Stopped, or taken out of the queue, on request.
        Cancelled = "cancelled",
        /// The daemon ended while it ran.
        Interrupted = "interrupted",
    }
}

impl JobState {
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

coded_enum! {
    /// What there is of a job's recording.
    #[derive(JsonSchema)]
    #[schemars(rename = "RecordingState")]
    pub enum RecordingStatus {
        /// Nothing: there was none, or the job has not begun.
        None = "none",
        /// A file that is being written, or was not closed.
        Partial = "partial",
        /// A whole file.
        Whole = "whole",
        /// A file that was not closed and has been repaired.
        Recovered = "recovered",
        /// A whole file that ends before the run does: the disk ran low.
        Stopped = "stopped",
        /// Writing it failed.
        Failed = "failed",
        /// Deleted to make room.
        Pruned = "pruned",
    }
}

coded_enum! {
    /// What a plate is doing.
    #[derive(JsonSchema)]
    pub enum PlateState {
        /// Nothing, and would take a job.
        Idle = "idle",
        /// A job.
        Running = "running",
        /// Nothing until a person resumes it.
        Paused = "paused",
        /// Nothing: an emergency stop holds until a person resets it.
        Stopped = "stopped",
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
            assert_eq!(serde_json::to_value(state).unwrap(), state.code());
        }
        for status in RecordingStatus::ALL {
            assert_eq!(serde_json::to_value(status).unwrap(), status.code());
        }
        for state in PlateState::ALL {
            assert_eq!(serde_json::to_value(state).unwrap(), state.code());
        }
    }
}
