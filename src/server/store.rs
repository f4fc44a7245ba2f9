//! What the daemon must not forget: jobs, their events, idempotency keys, the audit log, and the run folders on disk.
//!
//! One thread writes, into SQLite, and answers only after the commit is on the disk; two read. Nobody who asks waits
//! for the disk: answers come by a callback. Only what a plate's worker needs before it may move ([`Ledger::claim`])
//! and after it has stopped ([`Ledger::ended`]) blocks. Every queue is bounded.

mod ages;
mod aside;
mod audit;
mod ballast;
mod books;
mod columns;
mod events;
mod handle;
mod held;
mod idempotency;
mod ids;
mod jobs;
mod ledger;
mod limits;
mod memory;
mod migrate;
mod open;
mod orders;
mod peek;
mod pending;
mod places;
mod private;
mod reader;
mod recover;
mod retention;
mod run_file;
mod salvage;
mod schema;
mod task;
#[cfg(test)]
mod tests;
mod types;
mod writer;

pub use ages::Clocks;
pub use handle::Store;
pub use held::{Displaced, Found, HeldPath};
pub use ids::JobId;
pub use ledger::{Claimed, FINISHED, JobEnd, Ledger, NewEvent, Publish, StoredEvent};
pub use limits::Limits;
pub use memory::MemoryLedger;
pub use open::{Opened, RepairRecording};
pub use peek::{PeekMost, Peeked, peek};
pub use retention::Swept;
pub use run_file::{RunFileFault, open_run_file};
pub use types::{
    Accepted, AuditEntry, AuditRow, Cancelled, JobPage, JobRow, Mended, NewJob, Page, Recovery, Replay, StoreFault,
    StoreHealth,
};

pub use crate::states::{JobState, RecordingStatus};
pub use upm_core::job::Pace;
