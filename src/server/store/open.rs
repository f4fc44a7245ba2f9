use std::fs::{self, File, TryLockError};
use std::io;
use std::path::Path;
use std::sync::atomic::AtomicU64;

use jiff::Timestamp;
use parking_lot::Mutex;
use rusqlite::OptionalExtension;

use super::ids::Ids;
use super::schema::open_database;
use super::{Opened, RecoveryReport, Store, StoreFault, StoreLimits};

/// An open store with the report of its recovery.
#[derive(Debug)]
pub struct OpenOutcome {
    /// Store in the state that recovery left.
    pub store: Store,
    /// Findings of the start.
    pub recovery: RecoveryReport,
}

impl Store {
    /// Opens the store in the folder `data`, creating it if needed, and recovers the state that a crash left. Fails
    /// when another process has the store open, when the folder is not writable, when its disk is full, and, with
    /// nothing changed, when SQLite cannot read the store or it is of another version.
    pub fn open(
        data: &Path,
        plates: &[String],
        limits: StoreLimits,
        now: fn() -> Timestamp,
    ) -> Result<OpenOutcome, StoreFault> {
        let runs = data.join("runs");
        fs::create_dir_all(data).map_err(|error| named(data, error))?;
        let lock = lock(data)?;
        let connection = open_database(&data.join("upm.db"))?;
        fs::create_dir_all(&runs).map_err(|error| named(&runs, error))?;
        let last = "SELECT id FROM jobs ORDER BY id DESC LIMIT 1";
        let ids = Ids::above(connection.query_row(last, [], |row| row.get(0)).optional()?);
        let opened = Mutex::new(Some(Opened { connection, ids, _lock: lock }));
        let (fault, runs_bytes) = (Mutex::default(), AtomicU64::new(0));
        let store = Self { opened, runs, limits, now, fault, runs_bytes };
        let recovery = store.recover(plates)?;
        store.sweep();
        Ok(OpenOutcome { store, recovery })
    }
}

/// The exclusive lock of the data folder.
fn lock(data: &Path) -> Result<File, StoreFault> {
    let path = data.join("lock");
    let file = File::options().write(true).create(true).truncate(false).open(&path);
    let file = file.map_err(|error| named(&path, error))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => {
            Err(StoreFault::Io(format!("{} belongs to another daemon that is running", data.display())))
        }
        Err(TryLockError::Error(error)) => Err(named(&path, error)),
    }
}

/// The fault of an operation on `path`.
fn named(path: &Path, error: io::Error) -> StoreFault {
    match StoreFault::from(error) {
        StoreFault::Io(reason) => StoreFault::Io(format!("{}: {reason}", path.display())),
        other => other,
    }
}
