use std::path::Path;
use std::time::Duration;

use rusqlite::config::DbConfig;
use rusqlite::{Connection, OpenFlags};

use super::layout::beside;

/// Page cache of a connection, in the pragma's unit of -1024 bytes. The system caches the file as well.
const CACHE: &str = "PRAGMA cache_size = -512;";

/// Longest wait of a connection for another one's lock.
const BUSY: Duration = Duration::from_secs(2);

/// The writing connection. WAL allows readers beside it; FULL, because answered writes must survive a power cut.
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

/// A read-only connection.
pub(super) fn reading(path: &Path) -> rusqlite::Result<Connection> {
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let connection = Connection::open_with_flags(path, flags)?;
    connection.busy_timeout(BUSY)?;
    keep_log(&connection)?;
    connection.execute_batch(CACHE)?;
    connection.execute_batch("PRAGMA trusted_schema = OFF; PRAGMA query_only = ON;")?;
    Ok(connection)
}

/// A read-only connection that creates no log. An ordinary reader would create a missing log, and the next start could
/// no longer detect that it had been lost. Without a log only the database file is read.
pub(super) fn inspecting(db: &Path) -> rusqlite::Result<Connection> {
    if beside(db, "-wal").exists() {
        return reading(db);
    }
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX | OpenFlags::SQLITE_OPEN_URI;
    let connection = Connection::open_with_flags(immutable_uri(db), flags)?;
    connection.execute_batch("PRAGMA trusted_schema = OFF; PRAGMA query_only = ON;")?;
    Ok(connection)
}

/// The URI by which SQLite opens a file that no process changes.
fn immutable_uri(db: &Path) -> String {
    use std::fmt::Write as _;
    use std::os::unix::ffi::OsStrExt;
    let mut address = "file:".to_owned();
    for byte in db.as_os_str().as_bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'/' | b'.' | b'-' | b'_' => address.push(char::from(*byte)),
            // writing to a string never fails
            other => write!(address, "%{other:02x}").unwrap_or_default(),
        }
    }
    address + "?immutable=1"
}

/// Makes SQLite keep the log when it closes the database, so that a missing log after a crash is a sign of its loss.
fn keep_log(connection: &Connection) -> rusqlite::Result<()> {
    connection.set_db_config(DbConfig::SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, true).map(|_| ())
}

/// Moves the whole log into the database file and truncates it.
pub(super) fn empty_log(connection: &Connection) -> rusqlite::Result<()> {
    connection.query_row("PRAGMA wal_checkpoint(TRUNCATE)", [], |_| Ok(()))
}

/// Moves the whole log into the database file; later writes overwrite the log. So writes succeed even where no file can
/// grow.
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
