use rusqlite::{Connection, OptionalExtension, params};

use super::columns::Json;
use super::{AuditEntry, Store, StoreFault, Write};
use crate::states::PauseCause;

impl Store {
    /// Adds an entry to the audit log. No operation changes or removes one.
    pub fn audit(&self, entry: &AuditEntry) -> Result<(), StoreFault> {
        self.write(|write| write.audit(entry))
    }

    /// Stores the pause of a plate, or with `None` that it may go on, and the entry for the audit log that says so.
    pub(crate) fn set_pause(
        &self,
        plate: &str,
        pause: Option<&PauseCause>,
        entry: &AuditEntry,
    ) -> Result<(), StoreFault> {
        self.write(|write| {
            write.audit(entry)?;
            write.set_pause(plate, pause)
        })
    }
}

impl Write<'_> {
    pub(super) fn audit(&self, entry: &AuditEntry) -> Result<(), StoreFault> {
        let AuditEntry { plate, act, operator, reason, remote, token_name } = entry;
        let sql = "INSERT INTO audit (at, plate, act, operator, reason, remote, token_name)
                   VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)";
        self.tx.execute(sql, params![self.at(), plate, act, operator, reason, remote, token_name])?;
        Ok(())
    }

    pub(super) fn set_pause(&self, plate: &str, pause: Option<&PauseCause>) -> Result<(), StoreFault> {
        let sql = "INSERT OR REPLACE INTO plates (name, pause) VALUES (?1, ?2)";
        self.tx.execute(sql, params![plate, pause.map(Json)])?;
        Ok(())
    }
}

/// True when the daemon that had the store before was shut down in order, or there was none.
pub(super) fn ended_in_order(connection: &Connection) -> rusqlite::Result<bool> {
    let sql = "SELECT act FROM audit WHERE plate IS NULL AND act IN (?1, ?2) ORDER BY id DESC LIMIT 1";
    let last = connection.query_row(sql, [AuditEntry::STARTED, AuditEntry::ENDED], |row| row.get::<_, String>(0));
    Ok(last.optional()?.is_none_or(|act| act == AuditEntry::ENDED))
}

/// True when a job with this idempotency key was deleted.
pub(super) fn is_of_deleted(connection: &Connection, key: &str) -> rusqlite::Result<bool> {
    let sql = "SELECT EXISTS (SELECT 1 FROM audit WHERE act = 'delete' AND reason = ?1)";
    connection.query_row(sql, [key], |row| row.get(0))
}
