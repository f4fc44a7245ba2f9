use std::io;
use std::path::Path;

use rusqlite::{Connection, OptionalExtension, params};

use super::audit::is_of_deleted;
use super::columns::{JOB, coded, job_of, rows, sql_limit};
use super::retention::size_of;
use super::{
    AuditEntry, ClaimedJob, JobEnd, JobId, JobRow, JobState, NewJob, RecordingStatus, Store, StoreFault, SubmitOutcome,
    Write,
};
use upm_core::files::sync_folder;

/// Makes the run folder of a job and returns its name.
pub(crate) type MakeFolder<'a> = &'a dyn Fn(&JobRow) -> io::Result<String>;

impl Store {
    /// Queues a job, unless its key was used or its plate's queue is full. `None`, and nothing is stored, when `wanted`
    /// returns false once its turn comes.
    pub fn accept(&self, job: &NewJob, wanted: impl Fn() -> bool) -> Result<Option<SubmitOutcome>, StoreFault> {
        self.write(|write| {
            if !wanted() {
                return Ok(None);
            }
            if let Some(answered) = repeated(&write.tx, job.key.as_deref(), &job.body_sha256)? {
                return Ok(Some(answered));
            }
            let queued = write.queued(&job.plate)?;
            if queued >= self.limits.queued {
                return Ok(Some(SubmitOutcome::QueueFull { queued }));
            }
            let row = job.row(write.ids.next(write.now), write.at());
            write.insert(&row, job)?;
            Ok(Some(SubmitOutcome::New(row)))
        })
    }

    /// The earlier answer to a request with this idempotency key; `None` for a new key.
    pub fn repeated(&self, key: &str, body_sha256: &[u8; 32]) -> Result<Option<SubmitOutcome>, StoreFault> {
        self.read(|connection| repeated(connection, Some(key), body_sha256))
    }

    /// Takes a job out of the queue. The job as it is then, with false for one that was not queued and stays as it is;
    /// `None` when there is no such job.
    pub fn cancel_queued(&self, id: &JobId) -> Result<Option<(JobRow, bool)>, StoreFault> {
        let end = JobEnd {
            state: JobState::Cancelled,
            reason: "cancelled before it began".to_owned(),
            report_json: None,
            recording: RecordingStatus::None,
            progress: 0.0,
        };
        self.write(|write| {
            let Some(row) = find(&write.tx, id)? else { return Ok(None) };
            let is_cancelled = write.end(&row, JobState::Queued, &end, None)?;
            Ok(find(&write.tx, id)?.map(|row| (row, is_cancelled)))
        })
    }

    /// Moves a queued job to the front of its plate's queue; a job in another state stays as it is. The job as it is
    /// then; `None` when there is no such job.
    pub fn move_to_front(&self, id: &JobId) -> Result<Option<JobRow>, StoreFault> {
        self.write(|write| {
            let Some(row) = find(&write.tx, id)? else { return Ok(None) };
            let is_next = write.next_queued(&row.plate)?.is_some_and(|next| next.id == *id);
            if row.state != JobState::Queued || is_next {
                return Ok(Some(row));
            }
            let sql = "UPDATE jobs SET turn = (SELECT min(turn) - 1 FROM jobs WHERE plate = ?2 AND state = 'queued')
                       WHERE id = ?1";
            write.tx.execute(sql, params![id, row.plate])?;
            Ok(find(&write.tx, id)?)
        })
    }

    /// Deletes a job that does not run, with its run folder. Its key stays spent: repeating the request does not run it
    /// again. False for one that runs, and stays; `None` when there is no such job.
    pub fn delete(&self, id: &JobId, entry: AuditEntry) -> Result<Option<bool>, StoreFault> {
        self.write(|write| {
            let Some(row) = find(&write.tx, id)? else { return Ok(None) };
            if row.state == JobState::Running {
                return Ok(Some(false));
            }
            if let Some(folder) = &row.folder
                && !self.remove_folder(folder)
            {
                return Err(StoreFault::Io(format!("run folder {folder} cannot be deleted")));
            }
            let sql = "DELETE FROM jobs WHERE id = ?1 RETURNING key";
            let key: Option<String> = write.tx.query_row(sql, [id], |row| row.get(0))?;
            write.audit(&AuditEntry { plate: Some(row.job.plate), reason: key.unwrap_or_default(), ..entry })?;
            Ok(Some(true))
        })
    }

    /// The job with that id; `None` when there is none.
    pub fn job(&self, id: &JobId) -> Result<Option<JobRow>, StoreFault> {
        self.read(|connection| find(connection, id))
    }

    /// At most `limit` jobs, newest first: only those in this state and older than `before`, which need not exist.
    pub fn list(
        &self,
        state: Option<JobState>,
        before: Option<JobId>,
        limit: usize,
    ) -> Result<Vec<JobRow>, StoreFault> {
        let by_state = state.map_or("?3 IS NULL", |_| "state = ?3");
        // ids have 16 bytes, so this one sorts above all of them
        let below = before.map_or(vec![0xff; 17], |id| id.as_bytes().to_vec());
        let sql = format!("SELECT {JOB} FROM jobs WHERE {by_state} AND id < ?1 ORDER BY id DESC LIMIT ?2");
        self.read(|connection| {
            rows(connection, &sql, params![below, sql_limit(limit), state.map(JobState::code)], job_of)
        })
    }

    /// Number of jobs queued for each plate; plates without any are left out.
    pub fn queued(&self) -> Result<Vec<(String, u64)>, StoreFault> {
        let sql = "SELECT plate, count(*) FROM jobs WHERE state = 'queued' GROUP BY plate";
        let of_row = |row: &rusqlite::Row<'_>| Ok((row.get(0)?, row.get::<_, i64>(1)?.cast_unsigned()));
        self.read(|connection| rows(connection, sql, [], of_row))
    }

    /// Number of jobs of each plate in each state.
    pub fn counts(&self) -> Result<Vec<(String, JobState, u64)>, StoreFault> {
        let sql = "SELECT plate, state, count(*) FROM jobs GROUP BY plate, state";
        let of_row = |row: &rusqlite::Row<'_>| {
            Ok((row.get(0)?, coded(row, 1, JobState::of_code)?, row.get::<_, i64>(2)?.cast_unsigned()))
        };
        self.read(|connection| rows(connection, sql, [], of_row))
    }

    /// Takes the oldest job queued for `plate`: it is `running` on the disk when this returns, and is returned once.
    pub(crate) fn claim(&self, plate: &str, folder: MakeFolder<'_>) -> Result<Option<ClaimedJob>, StoreFault> {
        self.write(|write| match write.next_queued(plate)? {
            Some(row) => self.begin(write, &row, folder),
            None => Ok(None),
        })
    }

    /// Begins a run of the standing job `job`, as [`Self::claim`] begins a queued one; `None` while a job is queued for
    /// its plate. A job queued after this returns finds the run begun.
    pub(crate) fn begin_standing(
        &self,
        job: &NewJob,
        folder: MakeFolder<'_>,
    ) -> Result<Option<ClaimedJob>, StoreFault> {
        self.write(|write| {
            if write.queued(&job.plate)? > 0 {
                return Ok(None);
            }
            let mut row = job.row(write.ids.next(write.now), write.at());
            row.job.standing = true;
            write.insert(&row, job)?;
            self.begin(write, &row, folder)
        })
    }

    fn begin(&self, write: &Write<'_>, row: &JobRow, folder: MakeFolder<'_>) -> Result<Option<ClaimedJob>, StoreFault> {
        let name = folder(row)?;
        // a row must never name a folder that a power cut removes
        sync_folder(&self.runs)?;
        let sql = "UPDATE jobs SET state = 'running', started_at = max(?2, submitted_at), folder = ?3
                   WHERE id = ?1 RETURNING spec";
        let spec: Option<String> = write.tx.query_row(sql, params![row.id, write.at(), name], |row| row.get(0))?;
        let claimed = |row| ClaimedJob { row, spec_json: spec.unwrap_or_default() };
        Ok(find(&write.tx, &row.id)?.map(claimed))
    }

    /// Stores the end of a running job; a job that had ended before stays as it is. On a fault the caller must retry
    /// later, and start nothing on its plate until then. Deletes old run folders.
    pub(crate) fn finish(&self, id: &JobId, end: &JobEnd) -> Result<(), StoreFault> {
        let row = self.job(id)?.ok_or_else(|| StoreFault::Io(format!("there is no job {id}")))?;
        let folder = row.folder.as_ref().map(|folder| self.runs.join(folder));
        self.write(|write| write.end(&row, JobState::Running, end, folder.as_deref()))?;
        self.sweep();
        Ok(())
    }
}

impl Write<'_> {
    /// Ends a job in state `from`, with its run folder; false, and no change, when it is in another state.
    pub(super) fn end(
        &self,
        row: &JobRow,
        from: JobState,
        end: &JobEnd,
        folder: Option<&Path>,
    ) -> Result<bool, StoreFault> {
        let JobEnd { state, reason, report_json, recording, progress } = end;
        let progress = if *state == JobState::Completed { 1.0 } else { *progress };
        let bytes = folder.map_or(0, size_of).cast_signed();
        let sql = "UPDATE jobs SET state = ?3, reason = ?4, report = ?5, recording = ?6, progress = ?7, bytes = ?8,
                       finished_at = max(?9, coalesce(started_at, submitted_at)), spec = NULL
                   WHERE id = ?1 AND state = ?2";
        let (from, state, recording) = (from.code(), state.code(), recording.code());
        let values = params![row.id, from, state, reason, report_json, recording, progress, bytes, self.at()];
        Ok(self.tx.execute(sql, values)? > 0)
    }

    fn queued(&self, plate: &str) -> rusqlite::Result<usize> {
        let sql = "SELECT count(*) FROM jobs WHERE plate = ?1 AND state = 'queued'";
        let count = self.tx.query_row(sql, [plate], |row| row.get::<_, i64>(0))?;
        Ok(usize::try_from(count).unwrap_or(0))
    }

    /// The job that `plate` runs next.
    fn next_queued(&self, plate: &str) -> rusqlite::Result<Option<JobRow>> {
        let sql = format!("SELECT {JOB} FROM jobs WHERE plate = ?1 AND state = 'queued' ORDER BY turn, id LIMIT 1");
        self.tx.query_row(&sql, [plate], job_of).optional()
    }

    /// Writes a complete row with the text and the key of the job.
    fn insert(&self, row: &JobRow, job: &NewJob) -> rusqlite::Result<()> {
        let sql = "INSERT INTO jobs (id, name, plate, state, seed, pace, rig, submitted_at, \
                   standing, spec, key, body_sha256) VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12)";
        let values = params![
            row.id,
            row.name,
            row.plate,
            row.state.code(),
            row.seed.cast_signed(),
            row.pace.code(),
            row.rig_fingerprint,
            row.submitted_at,
            row.standing,
            job.spec_json,
            job.key,
            job.body_sha256,
        ];
        self.tx.execute(sql, values).map(|_| ())
    }
}

/// The earlier answer to a request with this idempotency key; `None` for a request without one or with a new one.
fn repeated(
    connection: &Connection,
    key: Option<&str>,
    body_sha256: &[u8; 32],
) -> rusqlite::Result<Option<SubmitOutcome>> {
    let Some(key) = key else { return Ok(None) };
    let sql = format!("SELECT {JOB}, body_sha256 = ?2 FROM jobs WHERE key = ?1");
    let of_row = |row: &rusqlite::Row<'_>| Ok((job_of(row)?, row.get(17)?));
    Ok(match connection.query_row(&sql, params![key, body_sha256], of_row).optional()? {
        Some((row, true)) => Some(SubmitOutcome::Replayed(row)),
        Some((_, false)) => Some(SubmitOutcome::KeyReused),
        None => is_of_deleted(connection, key)?.then_some(SubmitOutcome::KeyReused),
    })
}

fn find(connection: &Connection, id: &JobId) -> rusqlite::Result<Option<JobRow>> {
    connection.query_row(&format!("SELECT {JOB} FROM jobs WHERE id = ?1"), [id], job_of).optional()
}
