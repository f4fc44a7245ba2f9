use rusqlite::{Connection, OptionalExtension, params};

use super::columns::rows;
use super::{AuditEntry, Store, StoreFault, Write};

impl Store {
    /// Adds an entry to the audit log. No operation changes or removes one.
    pub fn audit(&self, entry: &AuditEntry) -> Result<(), StoreFault> {
        self.write(|write| write.audit(entry))
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
}

/// True when the daemon that had the store before was shut down in order, or there was none.
pub(super) fn ended_in_order(connection: &Connection) -> rusqlite::Result<bool> {
    let sql = "SELECT act FROM audit WHERE plate IS NULL AND act IN (?1, ?2) ORDER BY id DESC LIMIT 1";
    let last = connection.query_row(sql, [AuditEntry::STARTED, AuditEntry::ENDED], |row| row.get::<_, String>(0));
    Ok(last.optional()?.is_none_or(|act| act == AuditEntry::ENDED))
}

/// Plates that are paused: the last entry of each is not that it was resumed.
pub(super) fn paused(connection: &Connection) -> rusqlite::Result<Vec<String>> {
    let sql = "SELECT plate FROM audit WHERE plate IS NOT NULL AND act IN (?1, ?2)
               GROUP BY plate HAVING max(id) = max(CASE act WHEN ?1 THEN id END)";
    rows(connection, sql, [AuditEntry::PAUSE, AuditEntry::RESUME], |row| row.get(0))
}

/// True when a job with this idempotency key was deleted.
pub(super) fn is_of_deleted(connection: &Connection, key: &str) -> rusqlite::Result<bool> {
    let sql = "SELECT EXISTS (SELECT 1 FROM audit WHERE act = 'delete' AND reason = ?1)";
    connection.query_row(sql, [key], |row| row.get(0))
}
