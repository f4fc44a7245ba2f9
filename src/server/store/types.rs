use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use jiff::Timestamp;
use serde::Serialize;

use super::JobId;
use crate::states::{JobState, RecordingStatus};
use upm_core::job::{Pace, StopCause};
use upm_core::time::PlateTime;

/// Kind of the event that a job ends with: it is kept in one with the end, so that a job which has ended has it.
pub const FINISHED: &str = "finished";

/// A validated job that asks to be queued.
#[derive(Clone, Debug, PartialEq)]
pub struct NewJob {
    /// Name, fit for a folder.
    pub name: String,
    /// Plate that it is for.
    pub plate: String,
    /// Seed of everything random in its run.
    pub seed: u64,
    /// How fast plate time passes.
    pub pace: Pace,
    /// The job as JSON, every default written out, the rig left out.
    pub spec_json: String,
    /// Fingerprint of the rig it was checked against.
    pub rig_fingerprint: String,
    /// SHA-256 of the library it was checked against, in hex.
    pub library_sha256: String,
    /// SHA-256 of the request's body: what a repeated key must come with again.
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
            library_sha256: self.library_sha256.clone(),
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
        }
    }
}

/// A job in the store, without its text (see [`Claimed`]).
#[derive(Clone, Debug, PartialEq)]
pub struct JobRow {
    /// Identifier, by which jobs are listed in the order in which they came.
    pub id: JobId,
    /// Name, fit for a folder.
    pub name: String,
    /// Plate that it is for.
    pub plate: String,
    /// Where it is between the queue and its end.
    pub state: JobState,
    /// Seed of everything random in its run.
    pub seed: u64,
    /// How fast plate time passes.
    pub pace: Pace,
    /// Fingerprint of the rig it was checked against.
    pub rig_fingerprint: String,
    /// SHA-256 of the library it was checked against, in hex.
    pub library_sha256: String,
    /// When it was accepted.
    pub submitted_at: Timestamp,
    /// When its plate took it; not before `submitted_at`.
    pub started_at: Option<Timestamp>,
    /// When it ended, however it did. Never before it was submitted or began: where the wall clock was set back
    /// meanwhile, the same as that.
    pub finished_at: Option<Timestamp>,
    /// Share of it that is done, 0 to 1.
    pub progress: f64,
    /// Why it ended as it did; empty until then.
    pub reason: String,
    /// `report.json` of its run; `None` until there is one.
    pub report_json: Option<String>,
    /// Name of its run folder within the folder of runs; never a path.
    pub folder: Option<String>,
    /// Whether it has a recording, and how whole that is.
    pub recording: RecordingStatus,
    /// Sequence number of its last event; 0 before the first.
    pub last_event: u64,
    /// True for a run of its plate's standing job, which was never queued.
    pub standing: bool,
}

impl JobRow {
    /// Name of the run folder this job gets when it begins; no other job's is called so.
    pub fn run_folder(&self) -> String {
        format!("{}-{}", self.name, self.id)
    }
}

/// A job whose plate has taken it.
#[derive(Clone, Debug, PartialEq)]
pub struct Claimed {
    /// The job, `running`, with its run folder.
    pub row: JobRow,
    /// The job as JSON, as it was accepted.
    pub spec_json: String,
}

/// How a job ended.
#[derive(Clone, Debug, PartialEq)]
pub struct JobEnd {
    /// When, of the plate's own time; zero when it was not on the plate.
    pub at: PlateTime,
    /// A final state.
    pub state: JobState,
    /// Its cause; `None` where the state says it all.
    pub stop: Option<StopCause>,
    /// Why, in words.
    pub reason: String,
    /// `report.json` of its run; `None` where it left none.
    pub report_json: Option<String>,
    /// Whether it has a recording, and how whole that is.
    pub recording: RecordingStatus,
}

impl JobEnd {
    /// The last event of the job that ended so.
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

    /// That of a job which was taken out of the queue.
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

    /// That of a job whose run folder is another one's.
    pub(super) fn without_a_folder() -> Self {
        Self {
            state: JobState::Interrupted,
            stop: None,
            reason: "it could not begin: its run folder belongs to another job".to_owned(),
            ..Self::before_it_began()
        }
    }
}

/// Something that happened to a job, to be kept for those who come later.
#[derive(Clone, Debug, PartialEq)]
pub struct NewEvent {
    /// When, of the plate's own time.
    pub plate_time: PlateTime,
    /// Kind: `state`, `cycle`, `warning`, `recording`.
    pub kind: &'static str,
    /// JSON.
    pub body: Arc<str>,
}

/// An event that is on the disk.
#[derive(Clone, Debug, PartialEq)]
pub struct StoredEvent {
    /// Its number in its job, from 1 on without a gap.
    pub seq: u64,
    /// When it was told.
    pub at: Timestamp,
    /// When, of the plate's own time.
    pub plate_time: PlateTime,
    /// Kind: `state`, `cycle`, `warning`, `recording`, [`FINISHED`].
    pub kind: String,
    /// JSON.
    pub body: Arc<str>,
}

/// Outcome of a submission.
#[derive(Clone, Debug, PartialEq)]
pub enum Accepted {
    /// It is queued, and on the disk.
    New(JobRow),
    /// The same key and body came before: the job of then, as it is now.
    Replayed(JobRow),
    /// The same key came before with another body.
    KeyReused,
    /// As many jobs wait for the plate as may.
    QueueFull {
        /// How many wait.
        queued: usize,
    },
}

/// Outcome of taking a job out of the queue.
#[derive(Clone, Debug, PartialEq)]
pub enum Cancelled {
    /// It was queued and is cancelled; its last event says so.
    Now(JobRow, StoredEvent),
    /// It is in another state, and stays so.
    Not(JobRow),
    /// There is no such job.
    Unknown,
}

/// Outcome of deleting a job.
#[derive(Clone, Debug, PartialEq)]
pub enum Deleted {
    /// The store has no trace of it but its key. The event that ended it, when it was queued.
    Now(JobRow, Option<StoredEvent>),
    /// It runs, and stays.
    Not(JobRow),
    /// There is no such job.
    Unknown,
}

/// Which jobs to list: newest first.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Page {
    /// Only jobs in this state; `None` for all.
    pub state: Option<JobState>,
    /// Most jobs in the answer; at least 1 and at most [`Page::MOST`] are given.
    pub limit: usize,
    /// Only jobs older than this one, which need not exist.
    pub cursor: Option<JobId>,
}

impl Page {
    /// Most jobs in one answer.
    pub const MOST: usize = 200;
}

/// Jobs, newest first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JobPage {
    /// The jobs.
    pub rows: Vec<JobRow>,
    /// Cursor of the next page; `None` on the last.
    pub next: Option<JobId>,
}

/// Events of a job from some number on.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Replay {
    /// Number of the oldest event still kept; one past `last` when none is.
    pub oldest: u64,
    /// Number of the newest event ever told; 0 before the first.
    pub last: u64,
    /// The events, oldest first.
    pub events: Vec<StoredEvent>,
}

/// One act for the audit log.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AuditEntry {
    /// Plate that it was done to; `None` for an act on the daemon.
    pub plate: Option<String>,
    /// The act: `estop`, `reset`, `resume`.
    pub act: String,
    /// Name that the caller gave.
    pub operator: String,
    /// Reason that the caller gave.
    pub reason: String,
    /// Address that the request came from.
    pub remote: String,
    /// Name of the token it came with, never the token.
    pub token_name: String,
}

/// One line of the audit log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AuditRow {
    /// Its number, in the order of the log.
    pub id: i64,
    /// When it was done.
    pub at: Timestamp,
    /// The act.
    pub entry: AuditEntry,
}

/// Why the store did not do what it was asked.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StoreFault {
    /// Nothing more fits on the disk.
    #[error("the disk of the job store is full")]
    Full,
    /// More is waiting for the disk than is allowed to: ask again later.
    #[error("the job store is busy")]
    Busy,
    /// The disk or SQLite failed, in its words.
    #[error("the job store cannot be read or written: {0}")]
    Io(String),
    /// The database is not what the store wrote.
    #[error("the job store is damaged: {0}")]
    Corrupt(String),
    /// A newer release wrote the store.
    #[error("{file}: found a job store of version {found}, expected version {known} or older: start a newer release")]
    Newer {
        /// The database.
        file: String,
        /// Its version.
        found: i32,
        /// The newest version that this release knows.
        known: i32,
    },
    /// The store was closed; nothing is read or written any more.
    #[error("the job store is closed")]
    Closed,
}

/// Repair of a recording that had not been closed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mended {
    /// Messages that the recording holds now.
    pub messages: u64,
    /// Bytes at its end that could not be kept.
    pub cut_bytes: u64,
    /// True when nothing was wrong with it but its name.
    pub was_whole: bool,
}

/// Report of a start.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recovery {
    /// Jobs that were running and are interrupted now.
    pub interrupted: Vec<JobId>,
    /// Jobs that were running and had ended: their run folder holds a report.
    pub ended: Vec<JobId>,
    /// Plates that the store knew before this start; all of them when it was damaged, since it may have known them.
    pub known: Vec<String>,
    /// Plates that must not move until a person resumes them.
    pub paused: Vec<String>,
    /// The newest job that had ended on each of those that were paused already.
    pub paused_after: Vec<JobRow>,
    /// Where a damaged store was moved to.
    pub moved_aside: Option<PathBuf>,
    /// Why it was.
    pub damage: Option<String>,
    /// True when the daemon had been shut down in order, and had left no job on a plate.
    pub clean: bool,
    /// Run folders that belong to no job.
    pub orphans: Vec<PathBuf>,
    /// Recordings that had not been closed, and what became of them.
    pub repaired: Vec<(PathBuf, Result<Mended, String>)>,
}

/// How the store is.
#[derive(Clone, Debug, PartialEq)]
pub struct StoreHealth {
    /// Time since the writing thread last went round its loop.
    pub heartbeat: Duration,
    /// Why the last commit failed; `None` when it did not.
    pub fault: Option<StoreFault>,
    /// Commands that wait to be written.
    pub waiting: usize,
    /// Lines of the audit log that wait to be written.
    pub audit_waiting: usize,
    /// False while the reserve is released because the disk is full.
    pub reserve: bool,
    /// Longest time that a reading thread has been at one question.
    pub reader_busy: Duration,
    /// True while nothing is deleted by age, since the wall clock has jumped.
    pub deletion_suspended: bool,
}
