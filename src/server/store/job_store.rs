use std::fmt;
use std::io;

use super::{AuditEntry, ClaimedJob, JobEnd, JobId, JobRow, NewEvent, NewJob, StoreFault, StoredEvent};

/// Callback that gets the stored event after its commit, or the reason why it was not stored. Runs on the store's
/// writing thread, so it must return at once.
pub type Publish = Box<dyn FnOnce(Result<StoredEvent, StoreFault>) + Send>;

/// Makes the run folder of a job and returns its name.
pub type MakeFolder<'a> = &'a dyn Fn(&JobRow) -> io::Result<String>;

/// The store as seen by a plate's worker.
pub trait JobStore: Send + Sync + fmt::Debug {
    /// Takes the oldest job queued for `plate`. Waits for the disk: a job that this returns is durably `running`, and
    /// is returned once.
    fn claim(&self, plate: &str, folder: MakeFolder<'_>) -> Result<Option<ClaimedJob>, StoreFault>;

    /// Begins a run of the standing job `job`, as [`Self::claim`] begins a queued one; `None` while a job is queued for
    /// its plate. A job queued after this returns finds the run begun.
    fn begin_standing(&self, job: &NewJob, folder: MakeFolder<'_>) -> Result<Option<ClaimedJob>, StoreFault>;

    /// Stores the end of a running job and returns its [`FINISHED`](super::FINISHED) event; `None` when it had ended
    /// before, which is no error. Waits for the disk. On a fault the caller must retry later, and start nothing on its
    /// plate until then.
    fn finish(&self, id: &JobId, end: JobEnd) -> Result<Option<StoredEvent>, StoreFault>;

    /// Stores an event; never waits. False when too many are waiting already: then the event is lost, and `published`
    /// is not called.
    fn append_event(&self, id: &JobId, event: NewEvent, published: Publish) -> bool;

    /// Stores the share of a job that is done, 0 to 1. Never waits; only the last call counts.
    fn progress(&self, id: &JobId, progress: f64);

    /// Stores that a plate has been paused or resumed; never waits.
    fn note_paused(&self, plate: &str, paused: bool);

    /// Adds an entry to the audit log; never waits. On a full disk entries wait in memory for space. False when too
    /// many wait already: then the entry is lost.
    fn audit(&self, entry: AuditEntry) -> bool;

    /// Adds an entry to the audit log, after those noted before, and waits for the disk.
    fn audit_durably(&self, entry: AuditEntry) -> Result<(), StoreFault>;
}
