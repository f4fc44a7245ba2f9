use std::sync::Arc;

use jiff::Timestamp;
use rusqlite::{Connection, OptionalExtension, Row, params};

use super::columns::{Micros, rows, sql_limit};
use super::write_tx::WriteTx;
use super::{AuditEntry, AuditRow, JobId, NewEvent, Replay, StoredEvent};
use upm_core::time::PlateTime;

/// Events written between two counts of all events.
const COUNT_EVERY: u64 = 256;

pub(super) const EVENT: &str = "seq, at, plate_ns, kind, body";

impl WriteTx<'_> {
    /// Stores an event under the job's next number; `None` when there is no such job.
    pub fn append_event(&self, id: &JobId, event: &NewEvent) -> rusqlite::Result<Option<StoredEvent>> {
        let sql = "UPDATE jobs SET last_event = last_event + 1 WHERE id = ?1 RETURNING last_event, first_event";
        let numbers = self.connection.query_row(sql, [id], |row| Ok((row.get::<_, i64>(0)?, row.get::<_, i64>(1)?)));
        let Some((seq, first)) = numbers.optional()? else { return Ok(None) };
        let NewEvent { plate_time, kind, body } = event;
        let sql = "INSERT INTO events (job, seq, at, plate_ns, kind, body) VALUES (?1, ?2, ?3, ?4, ?5, ?6)";
        self.connection
            .execute(sql, params![id, seq, Micros(self.now), plate_time.nanos().cast_signed(), kind, body])?;
        let oldest = seq - sql_limit(self.limits.events_per_job) + 1;
        if first < oldest {
            self.forget_events(id, oldest)?;
        }
        self.uncounted.set(self.uncounted.get() + 1);
        if self.uncounted.get() >= COUNT_EVERY.min(self.limits.events / 8) {
            self.uncounted.set(0);
            self.prune_events()?;
        }
        let (at, plate_time, kind) = (Micros::rounded(self.now), *plate_time, (*kind).to_owned());
        Ok(Some(StoredEvent { seq: seq.cast_unsigned(), at, plate_time, kind, body: Arc::clone(body) }))
    }

    /// Adds an entry to the audit log. No operation changes or removes one.
    pub fn audit(&self, at: Timestamp, entry: &AuditEntry) -> rusqlite::Result<()> {
        let AuditEntry { plate, act, operator, reason, remote, token_name } = entry;
        let sql = "INSERT INTO audit (at, plate, act, operator, reason, remote, token_name)
                   VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)";
        self.connection.execute(sql, params![Micros(at), plate, act, operator, reason, remote, token_name]).map(|_| ())
    }

    /// Deletes a job's events below `oldest`.
    fn forget_events(&self, id: &JobId, oldest: i64) -> rusqlite::Result<()> {
        self.connection.execute("DELETE FROM events WHERE job = ?1 AND seq < ?2", params![id, oldest])?;
        self.connection.execute("UPDATE jobs SET first_event = ?2 WHERE id = ?1", params![id, oldest]).map(|_| ())
    }

    /// Deletes all events of the ended jobs, oldest job first, until the limit is met.
    pub fn prune_events(&self) -> rusqlite::Result<()> {
        let kept = "SELECT coalesce(sum(last_event - first_event + 1), 0) FROM jobs WHERE last_event >= first_event";
        let mut kept: i64 = self.connection.query_row(kept, [], |row| row.get(0))?;
        let most = sql_limit(self.limits.events);
        let oldest = "SELECT id, first_event, last_event FROM jobs
                      WHERE last_event >= first_event AND state NOT IN ('queued', 'running') ORDER BY id LIMIT 1";
        while kept > most {
            let found = self.connection.query_row(oldest, [], |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?)));
            let found: Option<(JobId, i64, i64)> = found.optional()?;
            let Some((id, first, last)) = found else { return Ok(()) };
            self.forget_events(&id, last + 1)?;
            kept -= last - first + 1;
        }
        Ok(())
    }
}

/// A job's events above number `after`, at most `most`; `None` when there is no such job.
pub(super) fn replay(connection: &Connection, id: &JobId, after: u64, most: usize) -> rusqlite::Result<Option<Replay>> {
    // both statements see the same state
    let tx = connection.unchecked_transaction()?;
    let sql = "SELECT first_event, last_event FROM jobs WHERE id = ?1";
    let numbers = tx.query_row(sql, [id], |row| Ok((row.get::<_, i64>(0)?, row.get::<_, i64>(1)?))).optional()?;
    let Some((oldest, last)) = numbers else { return Ok(None) };
    let sql = format!("SELECT {EVENT} FROM events WHERE job = ?1 AND seq > ?2 ORDER BY seq LIMIT ?3");
    let events = rows(&tx, &sql, params![id, sql_limit(after), sql_limit(most)], |row| event_of(row, 0))?;
    Ok(Some(Replay { oldest: oldest.cast_unsigned(), last: last.cast_unsigned(), events }))
}

/// The event whose columns begin at index `first`.
pub(super) fn event_of(row: &Row<'_>, first: usize) -> rusqlite::Result<StoredEvent> {
    Ok(StoredEvent {
        seq: row.get::<_, i64>(first)?.cast_unsigned(),
        at: row.get::<_, Micros>(first + 1)?.0,
        plate_time: PlateTime::from_nanos(row.get::<_, i64>(first + 2)?.cast_unsigned()),
        kind: row.get(first + 3)?,
        body: row.get(first + 4)?,
    })
}

/// The audit entry in a row of `id`, `at` and the entry's columns.
pub(super) fn audit_row_of(row: &Row<'_>) -> rusqlite::Result<AuditRow> {
    let entry = AuditEntry {
        plate: row.get(2)?,
        act: row.get(3)?,
        operator: row.get(4)?,
        reason: row.get(5)?,
        remote: row.get(6)?,
        token_name: row.get(7)?,
    };
    Ok(AuditRow { id: row.get(0)?, at: row.get::<_, Micros>(1)?.0, entry })
}
