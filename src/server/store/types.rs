use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use jiff::Timestamp;
use serde::Serialize;

use super::JobId;
use crate::states::{JobState, RecordingStatus};
use upm_core::job::{Pace, StopCause};
use upm_core::time::PlateTime;

/// Kind of a job's last event. It is stored in one transaction with the end, so every ended job has it.
pub const FINISHED: &str = "finished";

/// A validated job to be queued.
#[derive(Clone, Debug, PartialEq)]
pub struct NewJob {
    /// Name, valid as a folder name.
    pub name: String,
    /// Plate on which it is to run.
    pub plate: String,
    /// Seed of everything random in its run.
    pub seed: u64,
    /// Pace of its run.
    pub pace: Pace,
    /// The job as JSON, every default written out, the rig left out.
    pub spec_json: String,
    /// Fingerprint of the rig it was checked against.
    pub rig_fingerprint: String,
    /// SHA-256 of the request's body, which a repeated key must match.
    pub body_sha256: [u8; 32],
    /// The request's idempotency key.
    pub key: Option<String>,
}

impl NewJob {
    /// The row of this job when it has just been accepted.
    pub(super) fn row(&self, id: JobId, submitted_at: Timestamp) -> JobRow {
        JobRow {
            id,
            name: self.name.clone(),
            plate: self.plate.clone(),
            state: JobState::Queued,
            seed: self.seed,
            pace: self.pace,
            rig_fingerprint: self.rig_fingerprint.clone(),
            submitted_at,
            started_at: None,
            finished_at: None,
            progress: 0.0,
            reason: String::new(),
            report_json: None,
            folder: None,
            recording: RecordingStatus::None,
            last_event: 0,
            standing: false,
            turn: 0,
        }
    }
}

/// A job in the store, without its text (see [`ClaimedJob`]).
#[derive(Clone, Debug, PartialEq)]
pub struct JobRow {
    /// Id; ids sort by the order in which jobs were accepted.
    pub id: JobId,
    /// Name, valid as a folder name.
    pub name: String,
    /// Plate on which it runs.
    pub plate: String,
    /// State between queue and end.
    pub state: JobState,
    /// Seed of everything random in its run.
    pub seed: u64,
    /// Pace of its run.
    pub pace: Pace,
    /// Fingerprint of the rig it was checked against.
    pub rig_fingerprint: String,
    /// Time at which it was accepted.
    pub submitted_at: Timestamp,
    /// Time at which its plate took it; not before `submitted_at`.
    pub started_at: Option<Timestamp>,
    /// Time of its end, whatever the outcome. Never before it was submitted or began: where the wall clock was set back
    /// in between, it equals that time.
    pub finished_at: Option<Timestamp>,
    /// Share of the job that is done, 0 to 1.
    pub progress: f64,
    /// Reason of its end; empty until then.
    pub reason: String,
    /// `report.json` of its run; `None` until there is one.
    pub report_json: Option<String>,
    /// Name of its run folder within the folder of runs; never a path.
    pub folder: Option<String>,
    /// State of its recording.
    pub recording: RecordingStatus,
    /// Sequence number of its last event; 0 before the first.
    pub last_event: u64,
    /// True for a run of its plate's standing job, which was never queued.
    pub standing: bool,
    /// Turn in its plate's queue: the lowest runs first, equal ones in the order of their ids. Zero unless the job was
    /// moved to the front.
    pub turn: i64,
}

impl JobRow {
    /// Name of the run folder that this job gets when it begins, unique to the job.
    pub fn run_folder(&self) -> String {
        format!("{}-{}", self.name, self.id)
    }
}

/// A job that its plate has claimed.
#[derive(Clone, Debug, PartialEq)]
pub struct ClaimedJob {
    /// The job, `running`, with its run folder.
    pub row: JobRow,
    /// The job as JSON, as it was accepted.
    pub spec_json: String,
}

/// How and when a job ended, with its report and the state of its recording.
#[derive(Clone, Debug, PartialEq)]
pub struct JobEnd {
    /// Plate time of the end; zero when it was not on the plate.
    pub at: PlateTime,
    /// A final state.
    pub state: JobState,
    /// Cause of the stop; `None` where the state says it all.
    pub stop: Option<StopCause>,
    /// Reason, as text.
    pub reason: String,
    /// `report.json` of its run; `None` where it left none.
    pub report_json: Option<String>,
    /// State of its recording.
    pub recording: RecordingStatus,
}

impl JobEnd {
    /// The last event of a job with this end.
    pub(super) fn event(&self) -> NewEvent {
        #[derive(Serialize)]
        struct Finished<'a> {
            at_s: f64,
            state: &'a str,
            #[serde(skip_serializing_if = "Option::is_none")]
            stop: Option<StopCause>,
            reason: &'a str,
        }
        let finished =
            Finished { at_s: self.at.secs(), state: self.state.code(), stop: self.stop, reason: &self.reason };
        let body = serde_json::to_string(&finished).unwrap_or_else(|_| "{}".into());
        NewEvent { plate_time: self.at, kind: FINISHED, body: body.into() }
    }

    /// The end of a job that was taken out of the queue.
    pub(super) fn before_it_began() -> Self {
        Self {
            at: PlateTime::ZERO,
            state: JobState::Cancelled,
            stop: Some(StopCause::Cancelled),
            reason: "cancelled before it began".to_owned(),
            report_json: None,
            recording: RecordingStatus::None,
        }
    }

    /// The end of a job whose run folder belongs to another job.
    pub(super) fn without_a_folder() -> Self {
        Self {
            state: JobState::Interrupted,
            stop: None,
            reason: "it could not begin: its run folder belongs to another job".to_owned(),
            ..Self::before_it_began()
        }
    }
}

/// An event of a job, to be stored.
#[derive(Clone, Debug, PartialEq)]
pub struct NewEvent {
    /// Plate time of the event.
    pub plate_time: PlateTime,
    /// Kind: `state`, `cycle`, `warning`, `recording`.
    pub kind: &'static str,
    /// Content as JSON.
    pub body: Arc<str>,
}

/// An event on the disk.
#[derive(Clone, Debug, PartialEq)]
pub struct StoredEvent {
    /// Number within its job, from 1 on without a gap.
    pub seq: u64,
    /// Wall time at which it was stored.
    pub at: Timestamp,
    /// Plate time of the event.
    pub plate_time: PlateTime,
    /// Kind: `state`, `cycle`, `warning`, `recording`, [`FINISHED`].
    pub kind: String,
    /// Content as JSON.
    pub body: Arc<str>,
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

/// Outcome of taking a job out of the queue.
#[derive(Clone, Debug, PartialEq)]
pub enum CancelOutcome {
    /// The job was queued and is cancelled; with its last event.
    Now(JobRow, StoredEvent),
    /// The job is in another state, and stays so.
    Not(JobRow),
    /// There is no such job.
    Unknown,
}

/// Outcome of deleting a job.
#[derive(Clone, Debug, PartialEq)]
pub enum DeleteOutcome {
    /// The store has no trace of the job except its key. The event that ended it, if it was queued.
    Now(JobRow, Option<StoredEvent>),
    /// The job runs, and stays.
    Not(JobRow),
    /// There is no such job.
    Unknown,
}

/// Selection of jobs to list, newest first.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct JobSelection {
    /// Only jobs in this state; `None` for all.
    pub state: Option<JobState>,
    /// Most jobs in the answer; clamped to 1 to [`JobSelection::MOST`].
    pub limit: usize,
    /// Only jobs older than this one, which need not exist.
    pub cursor: Option<JobId>,
}

impl JobSelection {
    /// Most jobs in one answer.
    pub const MOST: usize = 200;
}

/// A page of jobs, newest first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JobPage {
    /// Selected jobs, at most [`JobSelection::MOST`].
    pub rows: Vec<JobRow>,
    /// Cursor of the next page; `None` on the last.
    pub next: Option<JobId>,
}

/// Events of a job above some number.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Replay {
    /// Number of the oldest event still stored; one past `last` when none is.
    pub oldest: u64,
    /// Number of the newest event ever stored; 0 before the first.
    pub last: u64,
    /// The events, oldest first.
    pub events: Vec<StoredEvent>,
}

/// An entry for the audit log.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AuditEntry {
    /// Plate that the operation was applied to; `None` for one on the daemon.
    pub plate: Option<String>,
    /// Name of the operation: `estop`, `reset`, `resume`.
    pub act: String,
    /// Name that the caller gave.
    pub operator: String,
    /// Reason that the caller gave.
    pub reason: String,
    /// Address from which the request came.
    pub remote: String,
    /// Name of the token presented, never the token itself.
    pub token_name: String,
}

/// A stored entry of the audit log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AuditRow {
    /// Number of the entry, in the order of the log.
    pub id: i64,
    /// Wall time of the operation.
    pub at: Timestamp,
    /// Operation, caller and reason, as they were written.
    pub entry: AuditEntry,
}

/// Why the store did not fulfil a request.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StoreFault {
    /// The disk is full.
    #[error("the disk of the job store is full")]
    Full,
    /// Too many requests wait for the disk: try again later.
    #[error("the job store is busy")]
    Busy,
    /// The disk or SQLite failed, with its message.
    #[error("the job store cannot be read or written: {0}")]
    Io(String),
    /// The database is damaged.
    #[error("the job store is damaged: {0}")]
    Corrupt(String),
    /// The store has another schema version.
    #[error("{file}: expected a job store of version {expected}, found version {found}: choose another data folder")]
    OtherVersion {
        /// The database.
        file: String,
        /// Its version.
        found: i32,
        /// The version of this program.
        expected: i32,
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
    /// Plates that the store knew before this start; all of them when it was damaged, since it may have known them.
    pub known: Vec<String>,
    /// Plates that must not move until an operator resumes them.
    pub paused: Vec<String>,
    /// The newest ended job of each plate that was paused already.
    pub paused_after: Vec<JobRow>,
    /// Where a damaged store was moved to.
    pub moved_aside: Option<PathBuf>,
    /// The damage found.
    pub damage: Option<String>,
    /// True when the daemon had been shut down in order, and had left no job on a plate.
    pub clean: bool,
    /// Run folders that belong to no job.
    pub orphans: Vec<PathBuf>,
}

/// Load and faults of the store's threads and disk.
#[derive(Clone, Debug, PartialEq)]
pub struct StoreHealth {
    /// Time since the writing thread last completed a round of its loop.
    pub heartbeat: Duration,
    /// Fault of the last commit; `None` when it succeeded.
    pub fault: Option<StoreFault>,
    /// Tasks that wait to be written.
    pub waiting: usize,
    /// Audit entries that wait to be written.
    pub audit_waiting: usize,
    /// Free bytes on the disk of the run folders; `None` when unknown.
    pub free_bytes: Option<u64>,
    /// Longest time that a reading thread has spent on its current read.
    pub reader_busy: Duration,
}
