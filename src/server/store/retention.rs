use std::fs;
use std::io;
use std::path::Path;
use std::sync::atomic::Ordering;

use jiff::SignedDuration;
use rusqlite::params;

use super::columns::{rows, sql_limit, text_of_time};
use super::{JobId, Store, StoreFault};

/// Ended runs of standing jobs except the newest of each plate.
const SURPLUS_STANDING: &str = "
    SELECT id, folder FROM (
        SELECT id, folder, row_number() OVER (PARTITION BY plate ORDER BY id DESC) AS age FROM jobs
            WHERE standing = 1 AND state NOT IN ('queued', 'running'))
    WHERE age > ?1 ORDER BY id";

/// Ended jobs above the limit that have no run folder any more, the oldest. A key is kept for a day: until then its
/// request may be repeated.
const SURPLUS_JOBS: &str = "
    DELETE FROM jobs WHERE id IN (
        SELECT id FROM jobs WHERE folder IS NULL AND state NOT IN ('queued', 'running')
            AND (key IS NULL OR submitted_at < ?2) ORDER BY id LIMIT max(0, (SELECT count(*) FROM jobs) - ?1))";
const KEY_KEPT: SignedDuration = SignedDuration::from_hours(24);

impl Store {
    /// Deletes surplus runs of standing jobs, then the run folders of the jobs that ended first while all are too large
    /// in total, then surplus rows. Called after each job; a fault is logged, and the next job tries again.
    pub(super) fn sweep(&self) {
        if let Err(fault) = self.try_sweep() {
            tracing::warn!("old run folders are not deleted: {fault}");
        }
    }

    fn try_sweep(&self) -> Result<(), StoreFault> {
        let most = sql_limit(self.limits.standing_runs);
        let of_row = |row: &rusqlite::Row<'_>| Ok((row.get(0)?, row.get(1)?));
        let surplus: Vec<(JobId, Option<String>)> =
            self.read(|connection| rows(connection, SURPLUS_STANDING, [most], of_row))?;
        for (id, folder) in surplus {
            if folder.is_none_or(|folder| self.remove_folder(&folder)) {
                self.write(|write| Ok(write.tx.execute("DELETE FROM jobs WHERE id = ?1", [id])?))?;
            }
        }
        let sql = "SELECT id, folder, bytes FROM jobs WHERE folder IS NOT NULL AND finished_at IS NOT NULL
                   ORDER BY finished_at, id";
        let of_row = |row: &rusqlite::Row<'_>| Ok((row.get(0)?, row.get(1)?, row.get::<_, i64>(2)?.cast_unsigned()));
        let ended: Vec<(JobId, String, u64)> = self.read(|connection| rows(connection, sql, [], of_row))?;
        let mut bytes: u64 = ended.iter().map(|(_, _, bytes)| bytes).sum();
        for (id, folder, size) in ended {
            if bytes <= self.limits.runs_bytes {
                break;
            }
            if self.remove_folder(&folder) {
                let sql = "UPDATE jobs SET folder = NULL, bytes = 0, recording = 'pruned' WHERE id = ?1";
                self.write(|write| Ok(write.tx.execute(sql, params![id])?))?;
                bytes -= size;
            }
        }
        self.runs_bytes.store(bytes, Ordering::Relaxed);
        let count: i64 =
            self.read(|connection| connection.query_row("SELECT count(*) FROM jobs", [], |row| row.get(0)))?;
        if count > sql_limit(self.limits.jobs) {
            let most = sql_limit(self.limits.jobs);
            self.write(|write| {
                Ok(write.tx.execute(SURPLUS_JOBS, params![most, text_of_time(write.now - KEY_KEPT)])?)
            })?;
        }
        Ok(())
    }

    /// Removes a run folder; false, with the reason in the log, when it stays.
    pub(super) fn remove_folder(&self, folder: &str) -> bool {
        let path = self.runs.join(folder);
        match fs::remove_dir_all(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                tracing::warn!("{}: cannot be deleted: {error}", path.display());
                false
            }
            _ => true,
        }
    }
}

/// Bytes of all files below a folder. Links are not followed; unreadable entries count as 0.
pub(super) fn size_of(folder: &Path) -> u64 {
    let Ok(entries) = fs::read_dir(folder) else { return 0 };
    let size = |entry: fs::DirEntry| match entry.metadata() {
        Ok(file) if file.is_dir() => size_of(&entry.path()),
        Ok(file) => file.len(),
        Err(_) => 0,
    };
    entries.flatten().map(size).sum()
}
