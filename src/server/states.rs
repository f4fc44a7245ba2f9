//! States of jobs, recordings, plates and standing jobs, as stored in the database and as sent over the network, with
//! the causes of pauses and the findings of runs.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use upm_core::coded_enum;
use upm_core::job::{Outcome, RunnerUp, StopCause, StopRequest};

coded_enum! {
    /// Stage of a job between submission and end; all but `queued` and `running` are final.
    #[derive(Default, JsonSchema)]
    pub enum JobState {
        /// Queued for its plate.
        #[default]
        Queued = "queued",
        /// Running on its plate.
        Running = "running",
        /// Ended, with its goal reached.
        Completed = "completed",
        /// Ended without reaching its goal.
        Failed = "failed",
        /// Stopped, or taken out of the queue, on request.
        Cancelled = "cancelled",
        /// Ended by a stop, restart or crash of the daemon.
        Interrupted = "interrupted",
    }
}

impl JobState {
    /// The final state for a run's outcome and the cause of its stop.
    pub fn of_end(outcome: Outcome, stop: Option<StopCause>) -> Self {
        match (outcome, stop) {
            (Outcome::Completed, _) => Self::Completed,
            (Outcome::Failed, _) => Self::Failed,
            // the daemon's own stops: the end of this run was not requested
            (Outcome::Cancelled, None | Some(StopCause::Asked(StopRequest::Stopped | StopRequest::Shutdown))) => {
                Self::Interrupted
            }
            (Outcome::Cancelled, Some(stop)) if stop.is_by_watchdog() => Self::Failed,
            (Outcome::Cancelled, Some(_)) => Self::Cancelled,
        }
    }

    /// True for final states: a job never leaves them.
    pub fn is_final(self) -> bool {
        !matches!(self, Self::Queued | Self::Running)
    }
}

coded_enum! {
    /// State of a job's recording.
    #[derive(Default, JsonSchema)]
    #[schemars(rename = "RecordingState")]
    pub enum RecordingStatus {
        /// No recording: none was made, or the job has not begun.
        #[default]
        None = "none",
        /// A file that was not closed: it opens up to its last whole message.
        Partial = "partial",
        /// A complete file.
        Whole = "whole",
        /// Writing the recording failed.
        Failed = "failed",
        /// The recording was deleted to make room.
        Pruned = "pruned",
    }
}

coded_enum! {
    /// Whether a plate is free, runs a job or is held.
    #[derive(Default, JsonSchema)]
    pub enum PlateState {
        /// Idle, and able to take a job.
        #[default]
        Idle = "idle",
        /// Running a job.
        Running = "running",
        /// Paused until an operator resumes it.
        Paused = "paused",
        /// Held by an emergency stop until an operator resets it.
        Stopped = "stopped",
    }
}

/// State of a standing job.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum StandingState {
    /// Running on its plate; gives way to any job that is queued.
    Running,
    /// Waiting; runs as soon as its plate may move and the queue is empty.
    Waiting,
    /// Paused until an operator resumes the plate.
    Paused,
}

/// The standing job of a plate.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct StandingJob {
    /// Name of the job.
    pub name: String,
    /// Whether it runs, waits for its turn or is paused.
    pub state: StandingState,
    /// Why it does not run; empty when it does, or only waits for its turn.
    pub why: String,
}

/// Cause of a plate's pause.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct PauseCause {
    /// Stable code for programs: that of `stop` in the job's report where the end of a job paused the plate, otherwise
    /// `reset`, `between_jobs`, `restarted`, `crashed` or `stopped`.
    pub code: String,
    /// The operator's checks or actions before the plate goes on.
    pub remedy: String,
    /// True where `why` of the plate ends with the remedy, so that it need not be shown again.
    pub remedy_in_why: bool,
    /// The cause in words, which is `why` of the plate, too.
    pub why: String,
}

impl PauseCause {
    /// A pause for the cause with this code, in words, and the operator's checks or actions.
    pub(crate) fn new(code: &str, why: &str, remedy: &str) -> Self {
        Self { code: code.to_owned(), remedy: remedy.to_owned(), remedy_in_why: false, why: why.to_owned() }
    }

    /// The pause of a plate on which jobs waited when the daemon was shut down.
    pub(crate) fn restarted() -> Self {
        Self::new("restarted", "jobs waited when the daemon ended: resume to go on", "resume to go on")
    }

    /// The pause of every plate after a daemon that was not shut down in order.
    pub(crate) fn crashed() -> Self {
        let remedy = "look at the plate, then resume";
        Self::new("crashed", &format!("the daemon did not end in order: {remedy}"), remedy)
    }
}

/// A lasting finding of the run on a plate that an operator should know of.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct PlateFinding {
    /// Stable code for programs.
    pub code: String,
    /// The finding in words.
    pub reason: String,
    /// The operator's checks or changes.
    pub remedy: String,
    /// The explanation that the senses can tell least from it; left out where no other was weighed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub runner_up: Option<RunnerUp>,
}
