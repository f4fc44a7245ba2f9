use std::fmt;
use std::io;
use std::sync::Arc;

use jiff::Timestamp;
use serde::Serialize;

use super::{AuditEntry, JobId, JobRow, JobState, NewJob, RecordingStatus, StoreFault};
use upm_core::job::StopCause;
use upm_core::time::PlateTime;

/// Kind of the event that a job ends with: it is kept in one with the end, so that a job which has ended has it.
pub const FINISHED: &str = "finished";

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
    /// Its `report.json`, if it came to one.
    pub report_json: Option<String>,
    /// What there is of its recording.
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
            Finished { at_s: self.at.secs(), state: self.state.name(), stop: self.stop, reason: &self.reason };
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
    /// What kind: `state`, `cycle`, `warning`, `recording`.
    pub kind: &'static str,
    /// What, as JSON.
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
    /// What kind.
    pub kind: String,
    /// What, as JSON.
    pub body: Arc<str>,
}

/// Called once with the event after its commit, or with the reason why there was none. Runs on the store's writing
/// thread: it hands on and returns.
pub type Publish = Box<dyn FnOnce(Result<StoredEvent, StoreFault>) + Send>;

/// What a plate's worker needs of the store.
pub trait Ledger: Send + Sync + fmt::Debug {
    /// Takes the oldest job queued for `plate`. `folder` makes its run folder and tells its name. Waits for the disk:
    /// when this returns a job, it is `running` for good, and nobody gets it again.
    fn claim(&self, plate: &str, folder: &dyn Fn(&JobRow) -> io::Result<String>)
    -> Result<Option<Claimed>, StoreFault>;

    /// Begins a run of the standing job `job`, as [`Self::claim`] begins a queued one; `None` while a job waits for its
    /// plate. A job that is queued after this returns finds the run begun.
    fn begin_standing(
        &self,
        job: &NewJob,
        folder: &dyn Fn(&JobRow) -> io::Result<String>,
    ) -> Result<Option<Claimed>, StoreFault>;

    /// Says how a running job ended, and tells its [`FINISHED`] event; `None` when it had ended before, which is no
    /// fault. Waits for the disk. On a fault the caller asks again later, and leaves its plate alone until then.
    fn ended(&self, id: &JobId, end: JobEnd) -> Result<Option<StoredEvent>, StoreFault>;

    /// Keeps an event; never waits. False when too many are waiting already: the event is lost, `published` not called.
    fn tell(&self, id: &JobId, event: NewEvent, published: Publish) -> bool;

    /// Notes the share of a job that is done, 0 to 1. Never waits; only the last one counts.
    fn progress(&self, id: &JobId, progress: f64);

    /// Notes that a plate has been paused or resumed; never waits.
    fn note_paused(&self, plate: &str, paused: bool);

    /// Writes a line into the audit log; never waits. Lines outlive a full disk: they wait for room in memory. False
    /// when too many wait already: the line is lost.
    fn note_act(&self, entry: AuditEntry) -> bool;

    /// Writes a line into the audit log, behind those noted before, and waits for the disk.
    fn write_act(&self, entry: AuditEntry) -> Result<(), StoreFault>;
}
