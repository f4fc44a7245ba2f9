//! The job store: jobs and the audit log in SQLite, and the run folders beside it.
//!
//! One connection behind a mutex; every call waits for its turn and for the disk. A job is accepted when its row is
//! committed. A plate's worker calls it while its plate is at rest, clients on threads of their own.

mod columns;
mod ids;
mod jobs;
mod recover;
mod run_folders;
mod schema;
#[cfg(test)]
pub(crate) mod tests;
mod types;

use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use jiff::Timestamp;
use parking_lot::Mutex;
use rusqlite::{Connection, Transaction, TransactionBehavior};

use columns::text_of_time;
use schema::open_database;
use types::VERSION;
use upm_runner::config::KeepSpec;

pub use ids::JobId;
pub(crate) use run_folders::low_disk;
pub use run_folders::open_run_file;
pub use types::{AuditEntry, Job, JobRow, RecoveryReport, StoreError, SubmitOutcome};

pub use crate::states::{JobState, RecordingStatus};
pub use upm_core::job::Pace;

/// The job store of one data folder.
#[derive(Debug)]
pub struct Store {
    /// The connection, and the exclusive lock of the data folder, which is released on drop. `None` once the store is
    /// closed.
    opened: Mutex<Option<(Connection, File)>>,
    runs: PathBuf,
    /// Most jobs queued for one plate.
    queue: usize,
    pub(crate) keep: KeepSpec,
    now: fn() -> Timestamp,
    /// Fault of the last write; `None` when it succeeded.
    fault: Mutex<Option<StoreError>>,
    /// Bytes in run folders of ended jobs.
    runs_bytes: AtomicU64,
}

/// A write under way.
struct Write<'a> {
    tx: Transaction<'a>,
    now: Timestamp,
    /// The same as text.
    at: String,
}

impl Store {
    /// Opens the store in the folder `data`, creating it if needed, and recovers the state that a crash left, with a
    /// report. It holds at most `queue` jobs for one plate, and of ended jobs what `keep` says. Fails when another
    /// process has the store open, when the folder is not writable, when its disk is full, and, with nothing changed,
    /// when SQLite cannot read the store or it is of another version.
    pub fn open(
        data: &Path,
        plates: &[String],
        queue: usize,
        keep: KeepSpec,
        now: fn() -> Timestamp,
    ) -> Result<(Self, RecoveryReport), StoreError> {
        let runs = data.join("runs");
        fs::create_dir_all(data).map_err(|error| with_path(data, error))?;
        let lock = lock(data)?;
        let file = data.join("upm.db");
        let connection = open_database(&file).map_err(|fault| with_path(&file, fault))?;
        fs::create_dir_all(&runs).map_err(|error| with_path(&runs, error))?;
        let opened = Mutex::new(Some((connection, lock)));
        let (fault, runs_bytes) = (Mutex::default(), AtomicU64::new(0));
        let store = Self { opened, runs, queue, keep, now, fault, runs_bytes };
        let recovery = store.recover(plates).map_err(|fault| with_path(&file, fault))?;
        store.sweep();
        Ok((store, recovery))
    }

    /// The folder of run folders.
    pub fn runs(&self) -> &Path {
        &self.runs
    }

    /// Bytes in run folders of ended jobs.
    pub fn runs_bytes(&self) -> u64 {
        self.runs_bytes.load(Ordering::Relaxed)
    }

    /// Fault of the last write; `None` when it succeeded.
    pub fn fault(&self) -> Option<StoreError> {
        self.fault.lock().clone()
    }

    /// Writes again after a fault: only a write shows whether it is over.
    pub fn retry(&self) {
        if self.fault().is_some() {
            // the outcome is noted
            let _ = self.write(|write| Ok(write.tx.pragma_update(None, "user_version", VERSION)?));
        }
    }

    /// Records an orderly shutdown and closes the store; later calls are refused. False when that failed or took longer
    /// than `within`: then the next start recovers as after a crash.
    pub fn close(&self, within: Duration) -> bool {
        let Some(mut opened) = self.opened.try_lock_for(within) else { return false };
        let ended = self.write_in(&mut opened, |write| write.audit(&AuditEntry::of_daemon(AuditEntry::ENDED)));
        *opened = None;
        ended.is_ok()
    }

    fn read<T>(&self, read: impl FnOnce(&Connection) -> rusqlite::Result<T>) -> Result<T, StoreError> {
        let opened = self.opened.lock();
        let (connection, _) = opened.as_ref().ok_or(StoreError::Closed)?;
        Ok(read(connection)?)
    }

    /// Runs `act` in a transaction; what it wrote is on the disk when this returns.
    fn write<T>(&self, act: impl FnOnce(&Write<'_>) -> Result<T, StoreError>) -> Result<T, StoreError> {
        self.write_in(&mut self.opened.lock(), act)
    }

    fn write_in<T>(
        &self,
        opened: &mut Option<(Connection, File)>,
        act: impl FnOnce(&Write<'_>) -> Result<T, StoreError>,
    ) -> Result<T, StoreError> {
        let (connection, _) = opened.as_mut().ok_or(StoreError::Closed)?;
        let written = (|| {
            let tx = connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
            let now = (self.now)();
            let write = Write { tx, now, at: text_of_time(now) };
            let made = act(&write)?;
            write.tx.commit()?;
            Ok(made)
        })();
        *self.fault.lock() = written.as_ref().err().cloned();
        written
    }
}

/// The exclusive lock of the data folder.
fn lock(data: &Path) -> Result<File, StoreError> {
    let path = data.join("lock");
    let file = File::options().write(true).create(true).truncate(false).open(&path);
    let file = file.map_err(|error| with_path(&path, error))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => {
            Err(StoreError::Io(format!("{} belongs to another daemon that is running", data.display())))
        }
        Err(TryLockError::Error(error)) => Err(with_path(&path, error)),
    }
}

/// The fault of an operation on `path`.
fn with_path(path: &Path, fault: impl Into<StoreError>) -> StoreError {
    let file = path.display();
    match fault.into() {
        StoreError::Io(reason) => StoreError::Io(format!("{file}: {reason}")),
        StoreError::Corrupt(reason) => StoreError::Corrupt(format!("{file}: {reason}")),
        other => other,
    }
}
