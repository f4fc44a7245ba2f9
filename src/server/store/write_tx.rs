use std::cell::Cell;
use std::path::Path;

use jiff::Timestamp;
use rusqlite::{Connection, params};

use super::ages::Uptime;
use super::columns::{rows, sql_limit};
use super::ids::Ids;
use super::{JobId, StoreLimits};

/// A writing transaction with its context. Statements on jobs, events and the audit log are methods in the files for
/// those.
pub(super) struct WriteTx<'a> {
    /// Connection within the transaction.
    pub connection: &'a Connection,
    pub ids: &'a Ids,
    pub limits: &'a StoreLimits,
    pub runs: &'a Path,
    /// Wall time at which this transaction began.
    pub now: Timestamp,
    /// Uptime at that time.
    pub uptime: Uptime,
    /// Events written since the last count of all events.
    pub uncounted: &'a Cell<u64>,
}

impl WriteTx<'_> {
    /// Run folders of ended jobs, those that ended first at the front.
    pub fn ended_runs(&self) -> rusqlite::Result<Vec<(String, JobId)>> {
        let sql = "SELECT folder, id FROM jobs WHERE folder IS NOT NULL AND finished_at IS NOT NULL
                   ORDER BY ended_uptime, finished_at, folder";
        rows(self.connection, sql, [], |row| Ok((row.get(0)?, row.get(1)?)))
    }

    /// Run folders of jobs that have not ended.
    pub fn begun_runs(&self) -> rusqlite::Result<Vec<String>> {
        let sql = "SELECT folder FROM jobs WHERE folder IS NOT NULL AND finished_at IS NULL";
        rows(self.connection, sql, [], |row| row.get(0))
    }

    /// Stores how long the store has been open, for the next start.
    pub fn note_uptime(&self) -> rusqlite::Result<()> {
        self.connection.execute("UPDATE clock SET uptime = max(uptime, ?1)", [self.uptime]).map(|_| ())
    }

    /// Removes a job's run folder from its row; no change when the row names another folder, or the job has not ended.
    pub fn prune(&self, id: &JobId, folder: &str) -> rusqlite::Result<()> {
        let sql = "UPDATE jobs SET folder = NULL, recording = 'pruned'
                   WHERE id = ?1 AND folder = ?2 AND state NOT IN ('queued', 'running')";
        self.connection.execute(sql, params![id, folder]).map(|_| ())
    }

    /// True when there are more jobs than are kept.
    pub fn has_too_many_jobs(&self) -> rusqlite::Result<bool> {
        let sql = "SELECT count(*) > ?1 FROM jobs";
        self.connection.query_row(sql, [sql_limit(self.limits.jobs)], |row| row.get(0))
    }

    /// Deletes the oldest ended jobs without a run folder, until the limit is met. A job stays while its key is
    /// remembered: a repeated key must be answered with it, never run again.
    pub fn forget_jobs(&self) -> rusqlite::Result<()> {
        let sql = "DELETE FROM jobs WHERE id IN (
                       SELECT id FROM jobs WHERE folder IS NULL AND state NOT IN ('queued', 'running')
                           AND NOT EXISTS (SELECT 1 FROM keys WHERE keys.job = jobs.id)
                       ORDER BY id LIMIT max(0, (SELECT count(*) FROM jobs) - ?1))";
        self.connection.execute(sql, [sql_limit(self.limits.jobs)]).map(|_| ())
    }
}
