//! The words for a run and its end that every room shares: how it ended, and what ended it.

pub mod legacy;
mod pace;
mod stop_cause;

use serde::{Deserialize, Serialize};

pub use pace::Pace;
pub use stop_cause::StopCause;

/// How a run ended. A lost coin or a missing table is an outcome, not an error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// The goal was reached.
    Completed,
    /// It cannot be reached any more, or not in time; or the run never began.
    #[default]
    Failed,
    /// An operator, a client or the end of the program stopped it.
    Cancelled,
}

impl Outcome {
    /// Its name in files and on the network, which never changes.
    pub fn code(self) -> &'static str {
        match self {
            Self::Completed => "completed",
            Self::Failed => "failed",
            Self::Cancelled => "cancelled",
        }
    }
}

/// How a recording ended that does not hold its whole run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RecordingEnd {
    /// Stopped on request, for example for disk space: the file is closed, and whole as far as it goes.
    RecordingStopped,
    /// Something could not be recorded.
    RecordingFailed,
}

impl RecordingEnd {
    /// Its name in files, which never changes.
    pub fn code(self) -> &'static str {
        match self {
            Self::RecordingStopped => "recording_stopped",
            Self::RecordingFailed => "recording_failed",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_the_names_in_files() {
        for outcome in [Outcome::Completed, Outcome::Failed, Outcome::Cancelled] {
            assert_eq!(serde_json::to_value(outcome).unwrap(), outcome.code());
        }
        for end in [RecordingEnd::RecordingStopped, RecordingEnd::RecordingFailed] {
            assert_eq!(serde_json::to_value(end).unwrap(), end.code());
        }
        for pace in Pace::ALL {
            assert_eq!(serde_json::to_value(pace).unwrap(), pace.name());
        }
        for cause in StopCause::ALL {
            assert_eq!(serde_json::to_value(cause).unwrap(), cause.code());
        }
    }
}
