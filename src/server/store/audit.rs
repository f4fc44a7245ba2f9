use jiff::Timestamp;
use rusqlite::{Connection, Row, params};

use super::books::Books;
use super::columns::At;
use super::{AuditEntry, AuditRow, StoreFault};

impl Books<'_> {
    /// Adds a line; there is no act that changes or removes one.
    pub fn note_act(&self, at: Timestamp, entry: &AuditEntry) -> rusqlite::Result<()> {
        let AuditEntry { plate, act, operator, reason, remote, token_name } = entry;
        let sql = "INSERT INTO audit (at, plate, act, operator, reason, remote, token_name)
                   VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)";
        self.tx.execute(sql, params![At(at), plate, act, operator, reason, remote, token_name]).map(|_| ())
    }
}

/// The last `most` lines, newest first.
pub(super) fn tail(connection: &Connection, most: usize) -> Result<Vec<AuditRow>, StoreFault> {
    let sql = "SELECT id, at, plate, act, operator, reason, remote, token_name FROM audit ORDER BY id DESC LIMIT ?1";
    let mut statement = connection.prepare(sql)?;
    let rows = statement.query_map([i64::try_from(most).unwrap_or(i64::MAX)], line_of)?;
    Ok(rows.collect::<Result<_, _>>()?)
}

/// The line in a row of `id, at` and what an entry holds.
pub(super) fn line_of(row: &Row<'_>) -> rusqlite::Result<AuditRow> {
    let entry = AuditEntry {
        plate: row.get(2)?,
        act: row.get(3)?,
        operator: row.get(4)?,
        reason: row.get(5)?,
        remote: row.get(6)?,
        token_name: row.get(7)?,
    };
    Ok(AuditRow { id: row.get(0)?, at: row.get::<_, At>(1)?.0, entry })
}
