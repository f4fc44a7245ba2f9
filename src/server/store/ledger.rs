use std::fmt;
use std::io;

use super::{AuditEntry, Claimed, JobEnd, JobId, JobRow, NewEvent, NewJob, StoreFault, StoredEvent};

/// Called once with the event after its commit, or with the reason why there was none. Runs on the store's writing
/// thread: it hands on and returns.
pub type Publish = Box<dyn FnOnce(Result<StoredEvent, StoreFault>) + Send>;

/// Makes the run folder of a job and returns its name.
pub type MakeFolder<'a> = &'a dyn Fn(&JobRow) -> io::Result<String>;

/// The store as a plate's worker uses it.
pub trait Ledger: Send + Sync + fmt::Debug {
    /// Takes the oldest job queued for `plate`. Waits for the disk:
    /// a job that this returns is durably `running`, and is returned once.
    fn claim(&self, plate: &str, folder: MakeFolder<'_>) -> Result<Option<Claimed>, StoreFault>;

    /// Begins a run of the standing job `job`, as [`Self::claim`] begins a queued one; `None` while a job waits for its
    /// plate. A job that is queued after this returns finds the run begun.
    fn begin_standing(&self, job: &NewJob, folder: MakeFolder<'_>) -> Result<Option<Claimed>, StoreFault>;

    /// Says how a running job ended, and tells its [`FINISHED`](super::FINISHED) event; `None` when it had ended before,
    /// which is no fault. Waits for the disk. On a fault the caller asks again later, and leaves its plate alone until
    /// then.
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
