//! The job store: jobs, their events, idempotency keys and the audit log in SQLite, and the run folders beside it.
//!
//! One thread writes and answers only after the commit is on the disk; two threads read. Callers never wait for the
//! disk: answers arrive by callback. Only two calls of a plate's worker block, the one before it may move
//! ([`JobStore::claim`]) and the one after it has stopped ([`JobStore::finish`]). Every queue is bounded.

mod ages;
mod columns;
mod connection;
mod deferred_writes;
mod handle;
mod history;
mod ids;
mod job_store;
mod jobs;
mod layout;
#[cfg(test)]
mod memory;
mod open;
mod options;
mod quarantine;
mod reader;
mod recover;
mod retention;
mod run_file;
mod salvage;
mod schema;
#[cfg(test)]
mod tests;
mod types;
mod write_queue;
mod write_tx;
mod writer;

pub use ages::Clocks;
pub use handle::Store;
pub use ids::JobId;
pub use job_store::{JobStore, MakeFolder, Publish};
#[cfg(test)]
pub use memory::InMemoryJobStore;
pub use open::OpenOutcome;
pub use options::StoreLimits;
pub use run_file::{RunFileFault, open_run_file};
pub use types::{
    AuditEntry, AuditRow, CancelOutcome, ClaimedJob, DeleteOutcome, FINISHED, JobEnd, JobPage, JobRow, JobSelection,
    NewEvent, NewJob, RecoveryReport, Replay, StoreFault, StoreHealth, StoredEvent, SubmitOutcome,
};

pub use crate::states::{JobState, RecordingStatus};
pub use upm_core::job::Pace;
