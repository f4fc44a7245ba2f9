//! Contents of the store that only tests read.

use rusqlite::Connection;

use crate::store::columns::{rows, sql_limit};
use crate::store::history::{EVENT, audit_row_of, event_of};
use crate::store::{AuditRow, JobId, Store, StoreFault, StoredEvent};

impl Store {
    /// The last events of the newest jobs, newest first.
    pub(super) fn newest_events(
        &self,
        most: usize,
        done: impl FnOnce(Result<Vec<(JobId, StoredEvent)>, StoreFault>) + Send + 'static,
    ) {
        let sql = format!("SELECT job, {EVENT} FROM events ORDER BY job DESC, seq DESC LIMIT ?1");
        let read = move |connection: &Connection| {
            rows(connection, &sql, [sql_limit(most)], |row| Ok((row.get(0)?, event_of(row, 1)?)))
        };
        self.readers.ask(read, done);
    }

    /// The last entries of the audit log, newest first.
    pub(crate) fn audit_tail(
        &self,
        most: usize,
        done: impl FnOnce(Result<Vec<AuditRow>, StoreFault>) + Send + 'static,
    ) {
        let sql =
            "SELECT id, at, plate, act, operator, reason, remote, token_name FROM audit ORDER BY id DESC LIMIT ?1";
        self.readers.ask(move |connection| rows(connection, sql, [sql_limit(most)], audit_row_of), done);
    }
}
