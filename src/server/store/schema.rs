use std::fs;
use std::path::Path;
use std::time::Duration;

use rusqlite::config::DbConfig;
use rusqlite::{Connection, OpenFlags};

use super::StoreFault;
use super::aside::remove_all;
use super::migrate::{MIGRATIONS, VERSION};

/// `upm1`: says in the file's header whose it is.
pub(super) const APPLICATION_ID: i32 = 0x7570_6d31;

/// Pages that a connection keeps in memory, in the pragma's own unit of -1024 bytes. The system keeps the file, too.
const CACHE: &str = "PRAGMA cache_size = -512;";

/// How long a connection waits for another one's lock.
const BUSY: Duration = Duration::from_secs(2);

/// Tables of version 1, but for those of [`STATE`]; the migrations come on top of them.
///
/// Times are whole microseconds of Unix time. An event's number never comes twice in a job: what is pruned moves
/// `first_event` up. A job's text stands apart, since it is long and the rest changes often; it goes when the job ends and
/// its run folder has it.
const TABLES: &str = "
CREATE TABLE jobs (
    id BLOB NOT NULL PRIMARY KEY CHECK (length(id) = 16),
    name TEXT NOT NULL,
    plate TEXT NOT NULL,
    state TEXT NOT NULL CHECK (state IN ('queued', 'running', 'completed', 'failed', 'cancelled', 'interrupted')),
    seed INTEGER NOT NULL,
    pace TEXT NOT NULL,
    rig TEXT NOT NULL,
    library TEXT NOT NULL,
    submitted_at INTEGER NOT NULL,
    started_at INTEGER,
    finished_at INTEGER,
    progress REAL NOT NULL DEFAULT 0,
    reason TEXT NOT NULL DEFAULT '',
    folder TEXT UNIQUE,
    recording TEXT NOT NULL DEFAULT 'none',
    first_event INTEGER NOT NULL DEFAULT 1,
    last_event INTEGER NOT NULL DEFAULT 0,
    report TEXT
) STRICT;
CREATE INDEX jobs_by_state ON jobs (state, id);
CREATE INDEX jobs_by_plate ON jobs (plate, state, id);
CREATE INDEX jobs_told ON jobs (id, first_event, last_event) WHERE last_event >= first_event;

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
    at INTEGER NOT NULL
) STRICT, WITHOUT ROWID;
CREATE INDEX keys_by_age ON keys (at);
CREATE INDEX keys_by_job ON keys (job);

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

/// State of plates and store. Its tables come last: an index without entries at the end of the file would hide that the
/// last byte is cut off.
const STATE: &str = "
CREATE TABLE plates (name TEXT NOT NULL PRIMARY KEY, paused INTEGER NOT NULL) STRICT, WITHOUT ROWID;
CREATE TABLE meta (only INTEGER PRIMARY KEY CHECK (only = 1), clean_shutdown INTEGER NOT NULL) STRICT;
INSERT INTO meta VALUES (1, 1);
";

/// Makes a new store at `path`, whole in one file: closed and on the disk when this returns.
pub(super) fn create(path: &Path) -> rusqlite::Result<()> {
    let connection = writing(path)?;
    let migrations = MIGRATIONS.concat();
    connection.execute_batch(&format!(
        "BEGIN; {TABLES} {migrations} {STATE}
         PRAGMA application_id = {APPLICATION_ID}; PRAGMA user_version = {VERSION}; COMMIT;"
    ))?;
    empty_log(&connection)?;
    connection.close().map_err(|(_, error)| error)
}

/// Makes a new store under one name and gives it another when it is whole.
pub(super) fn create_as(draft: &Path, path: &Path) -> Result<(), StoreFault> {
    remove_all(draft)?;
    create(draft)?;
    fs::rename(draft, path)?;
    Ok(remove_all(draft)?)
}

/// The connection that writes. WAL for readers beside it; FULL because what was answered must outlive a power cut.
pub(super) fn writing(path: &Path) -> rusqlite::Result<Connection> {
    let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_CREATE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let connection = Connection::open_with_flags(path, flags)?;
    connection.busy_timeout(BUSY)?;
    keep_log(&connection)?;
    connection.execute_batch(CACHE)?;
    connection.execute_batch(
        "PRAGMA journal_mode = WAL;
         PRAGMA synchronous = FULL;
         PRAGMA wal_autocheckpoint = 1000;
         PRAGMA journal_size_limit = 8388608;
         PRAGMA foreign_keys = ON;
         PRAGMA recursive_triggers = ON;
         PRAGMA trusted_schema = OFF;",
    )?;
    Ok(connection)
}

/// A connection that only reads.
pub(super) fn reading(path: &Path) -> rusqlite::Result<Connection> {
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let connection = Connection::open_with_flags(path, flags)?;
    connection.busy_timeout(BUSY)?;
    keep_log(&connection)?;
    connection.execute_batch(CACHE)?;
    connection.execute_batch("PRAGMA trusted_schema = OFF; PRAGMA query_only = ON;")?;
    Ok(connection)
}

/// The log stays beside the file, so that its absence after a crash means something.
fn keep_log(connection: &Connection) -> rusqlite::Result<()> {
    connection.set_db_config(DbConfig::SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, true).map(|_| ())
}

/// Moves all of the log into the file, and leaves none.
pub(super) fn empty_log(connection: &Connection) -> rusqlite::Result<()> {
    connection.query_row("PRAGMA wal_checkpoint(TRUNCATE)", [], |_| Ok(()))
}

/// Moves all of the log into the file; what is written next goes over the old log. So something can be written even
/// where nothing can grow.
pub(super) fn restart_log(connection: &Connection) -> rusqlite::Result<()> {
    connection.query_row("PRAGMA wal_checkpoint(RESTART)", [], |_| Ok(()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bundled_sqlite_has_the_fix_for_wal_resets() {
        assert!(rusqlite::version_number() >= 3_051_003, "{}", rusqlite::version());
    }

    #[test]
    fn a_new_store_is_whole_in_one_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("upm.db");
        create(&path).unwrap();
        let alone = folder.path().join("alone.db");
        std::fs::copy(&path, &alone).unwrap();
        let connection = reading(&alone).unwrap();
        let pragma = |name: &str| connection.pragma_query_value(None, name, |row| row.get::<_, i32>(0)).unwrap();
        assert_eq!([pragma("application_id"), pragma("user_version")], [APPLICATION_ID, VERSION]);
        assert!(connection.execute("DELETE FROM jobs", []).is_err());
    }

    #[test]
    fn the_writing_connection_loses_nothing_to_a_power_cut() {
        let folder = tempfile::tempdir().unwrap();
        let connection = writing(&folder.path().join("upm.db")).unwrap();
        let pragma = |name: &str| -> String {
            let value =
                connection.pragma_query_value(None, name, |row| row.get::<_, rusqlite::types::Value>(0)).unwrap();
            match value {
                rusqlite::types::Value::Text(text) => text,
                rusqlite::types::Value::Integer(number) => number.to_string(),
                other => format!("{other:?}"),
            }
        };
        let set = [
            ("journal_mode", "wal"),
            ("synchronous", "2"),
            ("wal_autocheckpoint", "1000"),
            ("journal_size_limit", "8388608"),
            ("busy_timeout", "2000"),
            ("foreign_keys", "1"),
            ("recursive_triggers", "1"),
            ("trusted_schema", "0"),
        ];
        for (name, value) in set {
            assert_eq!(pragma(name), value, "{name}");
        }
    }
}
