use std::fs::{self, File};
use std::path::{Path, PathBuf};

use rusqlite::{Connection, TransactionBehavior};

use super::StoreFault;
use super::connection::{empty_log, inspecting, writing};
use super::layout::{DataDir, beside, remove_all};

/// SQLite application id, `upm1`: identifies the file as a job store.
pub(super) const APPLICATION_ID: i32 = 0x7570_6d31;

/// Oldest version that can be migrated.
pub(super) const OLDEST: i32 = 1;

/// Migration from each version to the next, beginning at [`OLDEST`].
pub(super) const MIGRATIONS: &[&str] = &[STANDING, UPTIME, SPENT_KEYS, TURN];

/// Schema version of this release.
pub(super) const VERSION: i32 = OLDEST + MIGRATIONS.len() as i32;

/// From version 1 to 2: standing jobs.
const STANDING: &str = "
ALTER TABLE jobs ADD COLUMN standing INTEGER NOT NULL DEFAULT 0 CHECK (standing IN (0, 1));
CREATE INDEX jobs_standing ON jobs (plate, id) WHERE standing = 1;
";

/// From version 2 to 3: ages are measured on the time that the store is open. Existing rows begin to age now.
const UPTIME: &str = "
ALTER TABLE jobs ADD COLUMN ended_uptime INTEGER NOT NULL DEFAULT 0;
ALTER TABLE keys ADD COLUMN uptime INTEGER NOT NULL DEFAULT 0;
DROP INDEX keys_by_age;
CREATE INDEX keys_by_uptime ON keys (uptime);
CREATE TABLE clock (only INTEGER PRIMARY KEY CHECK (only = 1), uptime INTEGER NOT NULL) STRICT;
INSERT INTO clock VALUES (1, 0);
";

/// From version 3 to 4: idempotency keys of deleted jobs, so that repeating a request does not run it again.
const SPENT_KEYS: &str = "
CREATE TABLE spent_keys (key TEXT NOT NULL PRIMARY KEY, uptime INTEGER NOT NULL) STRICT, WITHOUT ROWID;
";

/// From version 4 to 5: a job that was moved to the front of its plate's queue has a turn below those of the others.
const TURN: &str = "ALTER TABLE jobs ADD COLUMN turn INTEGER NOT NULL DEFAULT 0;
";

/// Tables of version 1 without those of [`STATE`]; the migrations are applied to them.
///
/// Times are whole microseconds of Unix time. An event's number is never reused within a job: pruning events raises
/// `first_event`. A job's text has its own table, since it is long and the other columns change often; it is deleted
/// when the job ends and its run folder has a copy.
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
    let migrations = MIGRATIONS.concat();
    connection.execute_batch(&format!(
        "BEGIN; {TABLES} {migrations} {STATE}
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

/// Refuses a database of a newer version: it is sound, but this release cannot use it. Changes nothing. A file that is
/// not readable as a store passes: the check for damage follows later.
pub(super) fn refuse_newer(db: &Path) -> Result<(), StoreFault> {
    match inspecting(db).and_then(|connection| identity(&connection)) {
        Ok((APPLICATION_ID, found)) if found > VERSION => {
            Err(StoreFault::Newer { file: db.display().to_string(), found, known: VERSION })
        }
        _ => Ok(()),
    }
}

/// Migrates a sound store to the version after the last of `migrations`, in one transaction. Returns the path of the
/// copy made before; `None` for a store that has that version already.
pub(super) fn migrate(
    connection: &mut Connection,
    dir: &DataDir,
    migrations: &[&str],
) -> Result<Option<PathBuf>, StoreFault> {
    let (_, found) = identity(connection)?;
    let done = usize::try_from(found - OLDEST).unwrap_or(usize::MAX);
    let Some(missing) = migrations.get(done..).filter(|missing| !missing.is_empty()) else { return Ok(None) };
    let copy = copied(connection, dir, found)?;
    let tx = connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
    missing.iter().try_for_each(|migration| tx.execute_batch(migration))?;
    let reached = found + missing.len() as i32;
    tx.pragma_update(None, "user_version", reached)?;
    tx.commit()?;
    tracing::warn!("the job store was migrated from version {found} to {reached}; {} is as it was", copy.display());
    Ok(Some(copy))
}

/// Copies the store with its log to `upm.db.v1` beside it, 1 being its version; overwrites an earlier copy of that
/// version.
fn copied(connection: &Connection, dir: &DataDir, version: i32) -> Result<PathBuf, StoreFault> {
    let copy = beside(&dir.db, &format!(".v{version}"));
    let draft = beside(&copy, ".draft");
    remove_all(&draft)?;
    connection.execute("VACUUM INTO ?1", [draft.display().to_string()])?;
    File::open(&draft)?.sync_all()?;
    fs::rename(&draft, &copy)?;
    dir.sync()?;
    Ok(copy)
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
        std::fs::copy(&path, &alone).unwrap();
        let connection = reading(&alone).unwrap();
        assert_eq!(identity(&connection), Ok((APPLICATION_ID, VERSION)));
        assert!(connection.execute("DELETE FROM jobs", []).is_err());
    }
}
