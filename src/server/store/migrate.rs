use std::fs::{self, File};
use std::path::{Path, PathBuf};

use rusqlite::{Connection, TransactionBehavior};

use super::StoreFault;
use super::aside::remove_all;
use super::peek;
use super::places::{Places, beside};
use super::schema::APPLICATION_ID;

/// Oldest version that can be migrated.
pub(super) const OLDEST: i32 = 1;

/// The change from each version to the next, beginning at [`OLDEST`].
pub(super) const MIGRATIONS: &[&str] = &[STANDING, UPTIME];

/// Version of the tables that this release makes and uses.
pub(super) const VERSION: i32 = OLDEST + MIGRATIONS.len() as i32;

/// From version 1 to 2: standing jobs.
const STANDING: &str = "
ALTER TABLE jobs ADD COLUMN standing INTEGER NOT NULL DEFAULT 0 CHECK (standing IN (0, 1));
CREATE INDEX jobs_standing ON jobs (plate, id) WHERE standing = 1;
";

/// From version 2 to 3: ages are counted on the time that the store is open. What is there already begins to age now.
const UPTIME: &str = "
ALTER TABLE jobs ADD COLUMN ended_uptime INTEGER NOT NULL DEFAULT 0;
ALTER TABLE keys ADD COLUMN uptime INTEGER NOT NULL DEFAULT 0;
DROP INDEX keys_by_age;
CREATE INDEX keys_by_uptime ON keys (uptime);
CREATE TABLE clock (only INTEGER PRIMARY KEY CHECK (only = 1), uptime INTEGER NOT NULL) STRICT;
INSERT INTO clock VALUES (1, 0);
";

/// Version of the tables in a store.
pub(super) fn version_of(connection: &Connection) -> rusqlite::Result<i32> {
    connection.pragma_query_value(None, "user_version", |row| row.get(0))
}

/// Refuses a database of a version that this release does not know: it is sound, and only a newer release can use it.
/// Changes nothing. A file that cannot be read as a store passes: whether it is damaged is found out later.
pub(super) fn refuse_newer(db: &Path) -> Result<(), StoreFault> {
    let known = |connection: &Connection| {
        let id: i32 = connection.pragma_query_value(None, "application_id", |row| row.get(0))?;
        Ok::<_, rusqlite::Error>((id == APPLICATION_ID).then_some(version_of(connection)?))
    };
    let found = peek::open(db).and_then(|connection| Ok(known(&connection)?)).ok().flatten();
    match found.filter(|version| *version > VERSION) {
        Some(found) => Err(StoreFault::Newer { file: db.display().to_string(), found, known: VERSION }),
        None => Ok(()),
    }
}

/// Brings a sound store up to the version after the last of `migrations`, in one transaction, after a copy of it as it was
/// has been laid beside it; where the copy is. `None` for a store that is of that version already.
pub(super) fn migrate(
    connection: &mut Connection,
    places: &Places,
    migrations: &[&str],
) -> Result<Option<PathBuf>, StoreFault> {
    let found = version_of(connection)?;
    let done = usize::try_from(found - OLDEST).unwrap_or(usize::MAX);
    let Some(missing) = migrations.get(done..).filter(|missing| !missing.is_empty()) else { return Ok(None) };
    let copy = copied(connection, places, found)?;
    let tx = connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
    missing.iter().try_for_each(|migration| tx.execute_batch(migration))?;
    let reached = found + missing.len() as i32;
    tx.pragma_update(None, "user_version", reached)?;
    tx.commit()?;
    tracing::warn!("the job store was migrated from version {found} to {reached}; {} is as it was", copy.display());
    Ok(Some(copy))
}

/// Copies the store, its log included, to `upm.db.v1` beside it, 1 being its version; over an earlier copy of that version.
fn copied(connection: &Connection, places: &Places, version: i32) -> Result<PathBuf, StoreFault> {
    let copy = beside(&places.db, &format!(".v{version}"));
    let draft = beside(&copy, ".draft");
    remove_all(&draft)?;
    connection.execute("VACUUM INTO ?1", [draft.display().to_string()])?;
    File::open(&draft)?.sync_all()?;
    fs::rename(&draft, &copy)?;
    places.sync()?;
    Ok(copy)
}
