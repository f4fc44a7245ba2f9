use std::cell::Cell;
use std::collections::BTreeMap;
use std::path::Path;

use jiff::Timestamp;
use rusqlite::{Connection, OptionalExtension, Row, params};

use super::ages::{Ages, Uptime};
use super::columns::{Micros, rows, sql_limit};
use super::ids::Ids;
use super::{JobId, RecordingStatus, StoreLimits};

/// Sort key for the age of run folders: when a job ended, or when a folder without a job was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct EndStamp {
    pub uptime: Uptime,
    /// Wall time, to sort those with the same uptime: all jobs from a damaged store have the same.
    pub at: Timestamp,
}

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
    /// Ages at that time.
    pub ages: Ages,
    /// Events written since the last count of all events.
    pub uncounted: &'a Cell<u64>,
}

impl WriteTx<'_> {
    /// Run folders of all jobs, with when the job ended; `None` for one that runs.
    pub fn folders(&self) -> rusqlite::Result<BTreeMap<String, (JobId, Option<EndStamp>)>> {
        let sql = "SELECT folder, id, ended_uptime, finished_at FROM jobs WHERE folder IS NOT NULL";
        let folder = |row: &Row<'_>| {
            let (uptime, at) = (row.get(2)?, row.get::<_, Option<Micros>>(3)?);
            Ok((row.get(0)?, (row.get(1)?, at.map(|Micros(at)| EndStamp { uptime, at }))))
        };
        Ok(rows(self.connection, sql, [], folder)?.into_iter().collect())
    }

    /// Stores how long the store has been open, for the next start.
    pub fn note_uptime(&self) -> rusqlite::Result<()> {
        self.connection.execute("UPDATE clock SET uptime = max(uptime, ?1)", [self.ages.now]).map(|_| ())
    }

    /// Removes a job's run folder from its row; returns the former state of its recording. `None` when the row names
    /// another folder, or the job has not ended.
    pub fn prune(&self, id: &JobId, folder: &str) -> rusqlite::Result<Option<RecordingStatus>> {
        let sql = "SELECT recording FROM jobs WHERE id = ?1 AND folder = ?2 AND state NOT IN ('queued', 'running')";
        let kept = self.connection.query_row(sql, params![id, folder], |row| row.get(0)).optional()?;
        if kept.is_some() {
            self.connection.execute("UPDATE jobs SET folder = NULL, recording = 'pruned' WHERE id = ?1", [id])?;
        }
        Ok(kept)
    }

    /// Restores the row of a job whose run folder could not be deleted.
    pub fn restore_job_row(&self, id: &JobId, folder: &str, recording: RecordingStatus) -> rusqlite::Result<()> {
        let sql = "UPDATE jobs SET folder = ?2, recording = ?3 WHERE id = ?1 AND folder IS NULL";
        self.connection.execute(sql, params![id, folder, recording]).map(|_| ())
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
