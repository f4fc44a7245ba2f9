use std::cell::Cell;
use std::collections::BTreeMap;

use jiff::Timestamp;
use rusqlite::{Connection, params};

use super::columns::At;
use super::ids::Ids;
use super::{JobId, Limits};

/// What a writing transaction works with. The rooms' acts are methods on it, in files of their own.
pub(super) struct Books<'a> {
    /// The transaction.
    pub tx: &'a Connection,
    /// Ids of jobs to come.
    pub ids: &'a Ids,
    /// How much is kept.
    pub limits: &'a Limits,
    /// When this transaction began.
    pub now: Timestamp,
    /// Events told since they were last counted.
    pub told: &'a Cell<u64>,
}

impl Books<'_> {
    /// Run folders of all jobs, with the time at which the job ended; `None` for one that runs.
    pub fn folders(&self) -> rusqlite::Result<BTreeMap<String, (JobId, Option<Timestamp>)>> {
        let sql = "SELECT folder, id, finished_at FROM jobs WHERE folder IS NOT NULL";
        let mut statement = self.tx.prepare(sql)?;
        let ended = |at: Option<At>| at.map(|At(at)| at);
        statement.query_map([], |row| Ok((row.get(0)?, (row.get(1)?, ended(row.get(2)?)))))?.collect()
    }

    /// Notes that a job's run folder goes. False when it is not that job's, or the job has not ended.
    pub fn prune(&self, id: &JobId, folder: &str) -> rusqlite::Result<bool> {
        let sql = "UPDATE jobs SET folder = NULL, recording = 'pruned'
                   WHERE id = ?1 AND folder = ?2 AND state NOT IN ('queued', 'running')";
        Ok(self.tx.execute(sql, params![id, folder])? > 0)
    }

    /// Forgets the oldest jobs that have ended and have no run folder any more, until no more than the limit are left.
    pub fn forget_jobs(&self) -> rusqlite::Result<()> {
        let most = i64::try_from(self.limits.jobs).unwrap_or(i64::MAX);
        let sql = "DELETE FROM jobs WHERE id IN (
                       SELECT id FROM jobs WHERE folder IS NULL AND state NOT IN ('queued', 'running')
                       ORDER BY id LIMIT max(0, (SELECT count(*) FROM jobs) - ?1))";
        self.tx.execute(sql, [most]).map(|_| ())
    }
}
