use std::fs;
use std::path::Path;

use rusqlite::Connection;

use super::StoreFault;
use super::connection::{empty_log, inspecting, writing};
use super::layout::remove_all;

/// SQLite application id, `upm1`: identifies the file as a job store.
pub(super) const APPLICATION_ID: i32 = 0x7570_6d31;

/// Schema version; a store of another one is refused.
pub(super) const VERSION: i32 = 1;

/// Tables without those of [`STATE`].
///
/// Times are whole microseconds of Unix time. An event's number is never reused within a job: pruning events raises
/// `first_event`. A job's text has its own table, since it is long and the other columns change often; it is deleted
/// when the job ends and its run folder has a copy. Ages are measured on the time that the store is open, its uptime.
/// `spent_keys` has the idempotency keys of deleted jobs, so that repeating a request does not run it again. A job that
/// was moved to the front of its plate's queue has a turn below those of the others.
const TABLES: &str = "
CREATE TABLE jobs (
    id BLOB NOT NULL PRIMARY KEY CHECK (length(id) = 16),
    name TEXT NOT NULL,
    plate TEXT NOT NULL,
    state TEXT NOT NULL CHECK (state IN ('queued', 'running', 'completed', 'failed', 'cancelled', 'interrupted')),
    seed INTEGER NOT NULL,
    pace TEXT NOT NULL,
    rig TEXT NOT NULL,
    submitted_at INTEGER NOT NULL,
    started_at INTEGER,
    finished_at INTEGER,
    progress REAL NOT NULL DEFAULT 0,
    reason TEXT NOT NULL DEFAULT '',
    folder TEXT UNIQUE,
    recording TEXT NOT NULL DEFAULT 'none',
    first_event INTEGER NOT NULL DEFAULT 1,
    last_event INTEGER NOT NULL DEFAULT 0,
    report TEXT,
    standing INTEGER NOT NULL DEFAULT 0 CHECK (standing IN (0, 1)),
    ended_uptime INTEGER NOT NULL DEFAULT 0,
    turn INTEGER NOT NULL DEFAULT 0
) STRICT;
CREATE INDEX jobs_by_state ON jobs (state, id);
CREATE INDEX jobs_by_plate ON jobs (plate, state, id);
CREATE INDEX jobs_told ON jobs (id, first_event, last_event) WHERE last_event >= first_event;
CREATE INDEX jobs_standing ON jobs (plate, id) WHERE standing = 1;

CREATE TABLE specs (
    job BLOB NOT NULL PRIMARY KEY REFERENCES jobs (id) ON DELETE CASCADE,
    spec TEXT NOT NULL
) STRICT, WITHOUT ROWID;

CREATE TABLE events (
    job BLOB NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
    seq INTEGER NOT NULL,
    at INTEGER NOT NULL,
    plate_ns INTEGER NOT NULL,
    kind TEXT NOT NULL,
    body TEXT NOT NULL,
    PRIMARY KEY (job, seq)
) STRICT, WITHOUT ROWID;

CREATE TABLE keys (
    key TEXT NOT NULL PRIMARY KEY,
    body_sha256 BLOB NOT NULL CHECK (length(body_sha256) = 32),
    job BLOB NOT NULL REFERENCES jobs (id) ON DELETE CASCADE,
    uptime INTEGER NOT NULL
) STRICT, WITHOUT ROWID;
CREATE INDEX keys_by_uptime ON keys (uptime);
CREATE INDEX keys_by_job ON keys (job);
CREATE TABLE spent_keys (key TEXT NOT NULL PRIMARY KEY, uptime INTEGER NOT NULL) STRICT, WITHOUT ROWID;

CREATE TABLE clock (only INTEGER PRIMARY KEY CHECK (only = 1), uptime INTEGER NOT NULL) STRICT;
INSERT INTO clock VALUES (1, 0);

CREATE TABLE audit (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    at INTEGER NOT NULL,
    plate TEXT,
    act TEXT NOT NULL,
    operator TEXT NOT NULL,
    reason TEXT NOT NULL,
    remote TEXT NOT NULL,
    token_name TEXT NOT NULL
) STRICT;
CREATE TRIGGER audit_stays BEFORE UPDATE ON audit BEGIN SELECT RAISE(ABORT, 'the audit log is append-only'); END;
CREATE TRIGGER audit_keeps BEFORE DELETE ON audit BEGIN SELECT RAISE(ABORT, 'the audit log is append-only'); END;
";

/// State of plates and store. Its tables must be the last: an index without entries at the end of the file would hide
/// that the last byte is cut off.
const STATE: &str = "
CREATE TABLE plates (name TEXT NOT NULL PRIMARY KEY, paused INTEGER NOT NULL) STRICT, WITHOUT ROWID;
CREATE TABLE meta (only INTEGER PRIMARY KEY CHECK (only = 1), clean_shutdown INTEGER NOT NULL) STRICT;
INSERT INTO meta VALUES (1, 1);
";

/// Makes a new store at `path`, in one file that is closed and on the disk when this returns.
pub(super) fn create(path: &Path) -> rusqlite::Result<()> {
    let connection = writing(path)?;
    connection.execute_batch(&format!(
        "BEGIN; {TABLES} {STATE}
         PRAGMA application_id = {APPLICATION_ID}; PRAGMA user_version = {VERSION}; COMMIT;"
    ))?;
    empty_log(&connection)?;
    connection.close().map_err(|(_, error)| error)
}

/// Makes a new store at `draft` and renames it to `path` when it is complete.
pub(super) fn create_as(draft: &Path, path: &Path) -> Result<(), StoreFault> {
    remove_all(draft)?;
    create(draft)?;
    fs::rename(draft, path)?;
    Ok(remove_all(draft)?)
}

/// Application id (see [`APPLICATION_ID`]) and version of a database.
pub(super) fn identity(connection: &Connection) -> rusqlite::Result<(i32, i32)> {
    let number = |name: &str| connection.pragma_query_value(None, name, |row| row.get(0));
    Ok((number("application_id")?, number("user_version")?))
}

/// True when the store was closed in order.
pub(super) fn is_clean(connection: &Connection) -> rusqlite::Result<bool> {
    connection.query_row("SELECT clean_shutdown FROM meta", [], |row| row.get(0))
}

/// Refuses a database of another version, which is sound. Changes nothing. A file that is not readable as a store
/// passes: the check for damage follows later.
pub(super) fn refuse_other_version(db: &Path) -> Result<(), StoreFault> {
    match inspecting(db).and_then(|connection| identity(&connection)) {
        Ok((APPLICATION_ID, found)) if found != VERSION => {
            Err(StoreFault::OtherVersion { file: db.display().to_string(), found, expected: VERSION })
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::connection::reading;

    #[test]
    fn a_new_store_is_whole_in_one_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("upm.db");
        create(&path).unwrap();
        let alone = folder.path().join("alone.db");
        fs::copy(&path, &alone).unwrap();
        let connection = reading(&alone).unwrap();
        assert_eq!(identity(&connection), Ok((APPLICATION_ID, VERSION)));
        assert!(connection.execute("DELETE FROM jobs", []).is_err());
    }
}
