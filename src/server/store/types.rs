use std::ops::Deref;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::JobId;
use crate::states::{JobState, PauseCause, RecordingStatus};
use upm_core::job::Pace;

/// A job with its state and result.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Job {
    /// Id of the job: 32 hex digits, which sort by the time of submission.
    #[schemars(with = "String", extend("pattern" = "^[0-9a-f]{32}$"))]
    pub id: JobId,
    /// Name of the job; several jobs may have the same.
    pub name: String,
    /// Stage between submission and end, at the time of the answer.
    pub state: JobState,
    /// Plate on which it runs.
    pub plate: String,
    /// Time at which it was accepted (UTC).
    #[schemars(extend("format" = "date-time"))]
    pub submitted_at: String,
    /// Time at which its plate took it (UTC).
    #[schemars(extend("format" = "date-time"))]
    pub started_at: Option<String>,
    /// Time of its end, whatever the outcome (UTC).
    #[schemars(extend("format" = "date-time"))]
    pub finished_at: Option<String>,
    /// Share of the job that is done, 0 to 1.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub progress: f64,
    /// Its `report.json`, once it has ended.
    pub report: Option<Map<String, Value>>,
    /// Reason of its end; empty until then.
    pub reason: String,
    /// Seed of everything random in its run.
    pub seed: u64,
    /// Pace of its run.
    pub pace: Pace,
    /// State of its recording.
    pub recording: RecordingStatus,
    /// True for a run of its plate's standing job, which no client submitted.
    pub standing: bool,
    /// Turn in its plate's queue: the lowest runs first, equal ones in the order of their ids. Zero unless the job was
    /// moved to the front.
    pub turn: i64,
}

impl Job {
    /// Sets how the job ended.
    pub(crate) fn set_end(&mut self, state: JobState, reason: impl Into<String>) {
        (self.state, self.reason) = (state, reason.into());
    }
}

/// A job in the store.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct JobRow {
    /// The job as clients see it. Its times rise: where the wall clock was set back in between, they are equal.
    pub job: Job,
    /// Fingerprint of the rig it was checked against.
    pub rig_fingerprint: String,
    /// SHA-256 of the request's body, which a repeated key must match.
    pub body_sha256: [u8; 32],
    /// The request's idempotency key.
    pub key: Option<String>,
    /// Name of its run folder within the folder of runs; never a path.
    pub folder: Option<String>,
    /// Bytes in its run folder, once it has ended.
    pub bytes: u64,
    /// The job as JSON, every default written out, the rig left out. The store gives it back only to run the job.
    #[serde(skip)]
    pub spec_json: String,
}

impl Deref for JobRow {
    type Target = Job;

    fn deref(&self) -> &Job {
        &self.job
    }
}

impl JobRow {
    /// Name of the run folder that this job gets when it begins, unique to the job.
    pub fn run_folder(&self) -> String {
        // 64 letters may have 256 bytes, more than the name of a folder
        format!("{}-{}", &self.name[..self.name.floor_char_boundary(200)], self.id)
    }
}

/// Outcome of a submission.
#[derive(Clone, Debug, PartialEq)]
pub enum SubmitOutcome {
    /// The job is queued, and on the disk.
    New(JobRow),
    /// The same key and body were used before: the job of that request, in its present state.
    Replayed(JobRow),
    /// The same key was used before with another body.
    KeyReused,
    /// The plate's queue is full.
    QueueFull {
        /// Number of jobs in it.
        queued: usize,
    },
}

/// An entry for the audit log.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AuditEntry {
    /// Plate that the operation was applied to; `None` for one on the daemon.
    pub plate: Option<String>,
    /// Name of the operation: `estop`, `reset`, or one of the constants below.
    pub act: String,
    /// Name that the caller gave.
    pub operator: String,
    /// Reason that the caller gave; of a deletion the idempotency key of the job.
    pub reason: String,
    /// Address from which the request came.
    pub remote: String,
    /// Name of the token presented, never the token itself.
    pub token_name: String,
}

impl AuditEntry {
    /// The daemon opened the store.
    pub(super) const STARTED: &str = "start";
    /// The daemon was shut down in order.
    pub(super) const ENDED: &str = "end";
    /// The plate was paused.
    pub const PAUSE: &str = "pause";
    /// A job was deleted.
    pub const DELETE: &str = "delete";
    /// The plate may go on.
    pub const RESUME: &str = "resume";

    /// An operation of the daemon on itself.
    pub(super) fn of_daemon(act: &str) -> Self {
        Self { act: act.to_owned(), ..Self::default() }
    }

    /// An operation of the daemon on a plate.
    pub fn of_plate(plate: &str, act: &str, reason: &str) -> Self {
        Self { plate: Some(plate.to_owned()), reason: reason.to_owned(), ..Self::of_daemon(act) }
    }
}

/// Schema version; a store of another one is refused.
pub(super) const VERSION: i32 = 4;

/// Why the store did not fulfil a request.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StoreError {
    /// The disk is full.
    #[error("the disk of the job store is full")]
    Full,
    /// The disk or SQLite failed, with its message.
    #[error("the job store cannot be read or written: {0}")]
    Io(String),
    /// The database is damaged.
    #[error("the job store is damaged: {0}")]
    Corrupt(String),
    /// The file is no job store of this version; it is left untouched.
    #[error("{file}: expected a job store of version {}, found {found}: choose another data folder", VERSION)]
    Other {
        /// The database.
        file: String,
        /// Its kind or version.
        found: String,
    },
    /// The store was closed; it no longer reads or writes.
    #[error("the job store is closed")]
    Closed,
}

/// Report of a store's recovery at start.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RecoveryReport {
    /// Jobs that were running and are interrupted now.
    pub interrupted: Vec<JobId>,
    /// Jobs that were running and had ended: their run folder holds a report.
    pub ended: Vec<JobId>,
    /// Plates that the store knew before this start.
    pub known: Vec<String>,
    /// Plates that must not move until an operator resumes them, with the causes.
    pub paused: Vec<(String, PauseCause)>,
    /// True when the daemon had been shut down in order, and had left no job on a plate.
    pub clean: bool,
}
