use std::fs::{self, File};
use std::path::{Path, PathBuf};

use rusqlite::{Connection, TransactionBehavior};

use super::StoreFault;
use super::connection::inspecting;
use super::layout::{DataDir, beside, remove_all};
use super::schema::{APPLICATION_ID, OLDEST, VERSION, identity};

/// Refuses a database of a version that this release does not know: it is sound, and only a newer release can use it.
/// Changes nothing. A file that cannot be read as a store passes: whether it is damaged is found out later.
pub(super) fn refuse_newer(db: &Path) -> Result<(), StoreFault> {
    match inspecting(db).and_then(|connection| identity(&connection)) {
        Ok((APPLICATION_ID, found)) if found > VERSION => {
            Err(StoreFault::Newer { file: db.display().to_string(), found, known: VERSION })
        }
        _ => Ok(()),
    }
}

/// Brings a sound store up to the version after the last of `migrations`, in one transaction, after a copy of it as it was
/// has been laid beside it; where the copy is. `None` for a store that is of that version already.
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

/// Copies the store, its log included, to `upm.db.v1` beside it, 1 being its version; over an earlier copy of that version.
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
