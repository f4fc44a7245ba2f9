use std::fs;
use std::path::{Path, PathBuf};

use jiff::Timestamp;
use rusqlite::{Connection, ErrorCode};

use super::connection::{empty_log, reading, writing};
use super::layout::{DataDir, SQLITE_SUFFIXES, beside, remove_all};
use super::salvage::{from_folders, from_store, have_begun};
use super::schema::{APPLICATION_ID, create, identity};
use super::{RecoveryReport, StoreFault};

/// Size of the smallest database, bytes. SQLite would take a shorter file for a new database, and discard the log
/// beside it.
const LEAST_BYTES: u64 = 512;

/// The damage of the database at `path`; `None` for a sound one. Changes nothing. `Err` when the disk prevents the
/// check.
pub(super) fn damage_of(path: &Path) -> Result<Option<String>, StoreFault> {
    if fs::metadata(path)?.len() < LEAST_BYTES {
        return Ok(Some("upm.db has been cut off".to_owned()));
    }
    match reading(path).and_then(|connection| check_store(&connection)) {
        Ok(damage) => Ok(damage),
        Err(rusqlite::Error::SqliteFailure(code, reason)) => match code.code {
            ErrorCode::CannotOpen
            | ErrorCode::PermissionDenied
            | ErrorCode::ReadOnly
            | ErrorCode::DatabaseBusy
            | ErrorCode::DatabaseLocked
            | ErrorCode::SystemIoFailure
            | ErrorCode::OutOfMemory
            | ErrorCode::DiskFull => Err(rusqlite::Error::SqliteFailure(code, reason).into()),
            _ => Ok(Some(reason.unwrap_or_else(|| code.to_string()))),
        },
        Err(other) => Ok(Some(other.to_string())),
    }
}

fn check_store(connection: &Connection) -> rusqlite::Result<Option<String>> {
    let (id, _) = identity(connection)?;
    if id != APPLICATION_ID {
        return Ok(Some(format!("upm.db has the application id {id:08x}, expected {APPLICATION_ID:08x}")));
    }
    let said: String = connection.query_row("PRAGMA quick_check(1)", [], |row| row.get(0))?;
    if said != "ok" {
        return Ok(Some(said));
    }
    connection.query_row("SELECT clean_shutdown FROM meta WHERE only = 1", [], |row| row.get::<_, bool>(0))?;
    Ok(None)
}

/// Makes a new store of the readable data in the old one and in the run folders, and moves the old one aside. If it is
/// interrupted at any point, the next start resumes it without loss: the old store is moved only when the new one is
/// complete.
pub(super) fn quarantine(dir: &DataDir, now: Timestamp, damage: &str) -> Result<RecoveryReport, StoreFault> {
    tracing::error!("the job store is damaged and moved aside: {damage}");
    if !dir.next.exists() {
        remove_all(&dir.draft)?;
        create(&dir.draft)?;
        let connection = writing(&dir.draft)?;
        from_store(&dir.db, &connection)?;
        have_begun(dir, &connection)?;
        from_folders(dir, &connection)?;
        connection.execute("UPDATE meta SET clean_shutdown = 0", [])?;
        empty_log(&connection)?;
        connection.close().map_err(|(_, error)| error)?;
        fs::rename(&dir.draft, &dir.next)?;
        dir.sync()?;
    }
    let moved = move_away(&dir.db, now)?;
    fs::rename(&dir.next, &dir.db)?;
    // the new log begins with the new database
    remove_all(&dir.draft)?;
    dir.sync()?;
    Ok(RecoveryReport { moved_aside: moved, damage: Some(damage.to_owned()), ..RecoveryReport::default() })
}

/// Renames the database together with its log and index; `None` when there was none of them.
fn move_away(db: &Path, now: Timestamp) -> Result<Option<PathBuf>, StoreFault> {
    let there: Vec<&str> = SQLITE_SUFFIXES.into_iter().filter(|ending| beside(db, ending).exists()).collect();
    if there.is_empty() {
        return Ok(None);
    }
    let utc = now.strftime("%Y%m%dT%H%M%SZ").to_string();
    let name_of = |number: u32| {
        beside(db, &format!(".corrupt-{utc}{}", if number == 0 { String::new() } else { format!("-{number}") }))
    };
    let free = |name: &PathBuf| SQLITE_SUFFIXES.iter().all(|ending| !beside(name, ending).exists());
    let aside = (0..1000).map(name_of).find(free);
    let aside = aside.ok_or_else(|| StoreFault::Io("too many damaged stores of this second".into()))?;
    for ending in there {
        fs::rename(beside(db, ending), beside(&aside, ending))?;
    }
    Ok(Some(aside))
}
