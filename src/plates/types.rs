use std::time::Duration;

use crate::geometry::Vec2;
use crate::store::JobId;
use crate::time::PlateTime;

/// What a plate is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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

/// The newest that is known of the parts on a plate.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sight {
    /// Plate time of the frame, from the start of its job.
    pub at: PlateTime,
    /// Where each part is, m.
    pub positions_m: Vec<Vec2>,
    /// Where each part shall end, m.
    pub targets_m: Vec<Vec2>,
    /// Share of the job that is done, 0 to 1.
    pub progress: f64,
    /// What is being done, in words.
    pub phase: String,
}

/// A plate at one moment.
#[derive(Clone, Debug, PartialEq)]
pub struct PlateSnapshot {
    /// Its name.
    pub name: String,
    /// What it is doing.
    pub state: PlateState,
    /// Why it does nothing; empty when it does something or could.
    pub why: String,
    /// The job it has.
    pub job: Option<JobId>,
    /// The parts as last seen.
    pub sight: Sight,
    /// Wall time since they were; `None` before anything was.
    pub age: Option<Duration>,
}

/// Why a plate was not reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ResetFault {
    /// No emergency stop holds.
    #[error("the plate is not stopped")]
    NotStopped,
    /// The stopped job has not ended.
    #[error("the plate is still stopping")]
    StillStopping,
}
