use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::Path;

use rusqlite::Connection;

use super::types::{StoreError, VERSION};

/// SQLite application id, `upm1`: identifies the file as a job store.
pub(super) const APPLICATION_ID: i32 = 0x7570_6d31;

/// First bytes of every SQLite database.
const MAGIC: &[u8] = b"SQLite format 3\0";

/// Offsets of schema version and application id in a database's header.
const VERSION_AT: usize = 60;
const APPLICATION_ID_AT: usize = 68;

/// A job is one JSON text, a `JobRow`; the columns that are asked for are made from it. Times are texts of one length,
/// UTC. The text of a job is deleted when it leaves the queue: a run writes it to its folder. A job that was moved to
/// the front of its plate's queue has a turn below those of the others. `plates` has every plate that was served, with
/// the cause of its pause. The audit log has the pauses of plates, the starts and ends of the daemon, and the
/// idempotency keys of deleted jobs, too.
const TABLES: &str = "
CREATE TABLE jobs (
    id TEXT NOT NULL PRIMARY KEY,
    job TEXT NOT NULL,
    spec TEXT,
    plate TEXT NOT NULL AS (job ->> '$.job.plate'),
    state TEXT NOT NULL AS (job ->> '$.job.state')
        CHECK (state IN ('queued', 'running', 'completed', 'failed', 'cancelled', 'interrupted')),
    turn INTEGER NOT NULL AS (job ->> '$.job.turn'),
    standing INTEGER NOT NULL AS (job ->> '$.job.standing'),
    submitted_at TEXT NOT NULL AS (job ->> '$.job.submitted_at'),
    finished_at TEXT AS (job ->> '$.job.finished_at'),
    key TEXT UNIQUE AS (job ->> '$.key'),
    folder TEXT AS (job ->> '$.folder'),
    bytes INTEGER NOT NULL AS (job ->> '$.bytes')
) STRICT;
CREATE INDEX jobs_by_state ON jobs (state, id);
CREATE INDEX jobs_by_plate ON jobs (plate, state, turn, id);
CREATE INDEX jobs_standing ON jobs (plate, id, state, folder) WHERE standing = 1;
CREATE INDEX jobs_with_folder ON jobs (finished_at, id, folder, bytes) WHERE folder IS NOT NULL;

CREATE TABLE plates (
    name TEXT NOT NULL PRIMARY KEY,
    pause TEXT
) STRICT;

CREATE TABLE audit (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    at TEXT NOT NULL,
    plate TEXT,
    act TEXT NOT NULL,
    operator TEXT NOT NULL,
    reason TEXT NOT NULL,
    remote TEXT NOT NULL,
    token_name TEXT NOT NULL
) STRICT;
CREATE INDEX audit_of_deleted ON audit (reason) WHERE act = 'delete';
CREATE TRIGGER audit_stays BEFORE UPDATE ON audit BEGIN SELECT RAISE(ABORT, 'the audit log is append-only'); END;
CREATE TRIGGER audit_keeps BEFORE DELETE ON audit BEGIN SELECT RAISE(ABORT, 'the audit log is append-only'); END;
";

/// Opens the store at `path`, creating it if there is none. A file that is no store of this version is refused and left
/// untouched.
pub(super) fn open_database(path: &Path) -> Result<Connection, StoreError> {
    match header_of(path)? {
        None | Some((APPLICATION_ID, VERSION)) => {}
        Some((APPLICATION_ID, found)) => return Err(other(path, format!("version {found}"))),
        Some(_) => return Err(other(path, "another database".to_owned())),
    }
    let connection = Connection::open(path)?;
    // this rolls back what a crash left of the transaction below
    if connection.query_row("SELECT count(*) = 0 FROM sqlite_schema", [], |row| row.get(0))? {
        // in one transaction, and before the log exists: the header of a store is always in its file
        connection.execute_batch(&format!(
            "BEGIN; {TABLES} PRAGMA application_id = {APPLICATION_ID}; PRAGMA user_version = {VERSION}; COMMIT;"
        ))?;
    }
    // FULL, because what was answered must survive a power cut
    connection.execute_batch(
        "PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA journal_size_limit = 8388608;
         PRAGMA recursive_triggers = ON; PRAGMA trusted_schema = OFF;",
    )?;
    match connection.query_row("PRAGMA quick_check(1)", [], |row| row.get::<_, String>(0))?.as_str() {
        "ok" => Ok(connection),
        damage => Err(StoreError::Corrupt(damage.to_owned())),
    }
}

/// Application id and schema version in the header of a database; `None` for a file that is missing or empty, as a
/// crash during the first start leaves it.
fn header_of(path: &Path) -> Result<Option<(i32, i32)>, StoreError> {
    let mut header = Vec::new();
    match File::open(path) {
        Ok(file) => file.take(100).read_to_end(&mut header)?,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(error.into()),
    };
    let number = |at: usize| header.get(at..at + 4)?.try_into().ok().map(i32::from_be_bytes);
    match (number(APPLICATION_ID_AT), number(VERSION_AT)) {
        _ if header.is_empty() => Ok(None),
        (Some(id), Some(version)) if header.starts_with(MAGIC) => Ok(Some((id, version))),
        _ => Err(other(path, "no database".to_owned())),
    }
}

fn other(path: &Path, found: String) -> StoreError {
    StoreError::Other { file: path.display().to_string(), found }
}
