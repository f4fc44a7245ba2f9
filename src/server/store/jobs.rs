use std::fs;

use rusqlite::{Connection, OptionalExtension, Row, params};

use super::columns::{Json, rows};
use super::run_folders::size_of;
use super::{AuditEntry, JobId, JobRow, JobState, Store, StoreError, SubmitOutcome, Write};
use crate::states::PauseCause;
use upm_core::files::sync_folder;

impl Store {
    /// Queues a job, unless its key was used or its plate's queue is full. `None`, and nothing is stored, when `wanted`
    /// returns false once its turn comes.
    pub fn accept(&self, job: &JobRow, wanted: impl Fn() -> bool) -> Result<Option<SubmitOutcome>, StoreError> {
        self.write(|write| {
            if !wanted() {
                return Ok(None);
            }
            if let Some(key) = &job.key
                && let Some(answered) = repeated(&write.tx, key, &job.body_sha256)?
            {
                return Ok(Some(answered));
            }
            let queued = write.queued(&job.plate)?;
            if queued >= self.queue {
                return Ok(Some(SubmitOutcome::QueueFull { queued }));
            }
            Ok(Some(SubmitOutcome::New(write.insert(job)?)))
        })
    }

    /// The earlier answer to a request with this idempotency key; `None` for a new key.
    pub fn repeated(&self, key: &str, body_sha256: &[u8; 32]) -> Result<Option<SubmitOutcome>, StoreError> {
        self.read(|connection| repeated(connection, key, body_sha256))
    }

    /// Takes a job out of the queue. The job as it is then, with false for one that was not queued and stays as it is;
    /// `None` when there is no such job.
    pub fn cancel_queued(&self, id: &JobId) -> Result<Option<(JobRow, bool)>, StoreError> {
        self.write(|write| match find(&write.tx, id)? {
            Some(mut row) if row.state == JobState::Queued => {
                row.job.set_end(JobState::Cancelled, "cancelled before it began");
                Ok(Some((self.end(write, row, write.at.clone())?, true)))
            }
            row => Ok(row.map(|row| (row, false))),
        })
    }

    /// Moves a queued job to the front of its plate's queue; a job in another state stays as it is. The job as it is
    /// then; `None` when there is no such job.
    pub fn move_to_front(&self, id: &JobId) -> Result<Option<JobRow>, StoreError> {
        self.write(|write| {
            let Some(row) = find(&write.tx, id)? else { return Ok(None) };
            let is_next = write.next_queued(&row.plate)?.is_some_and(|next| next.id == *id);
            if row.state != JobState::Queued || is_next {
                return Ok(Some(row));
            }
            let sql = "UPDATE jobs SET job = json_set(job, '$.job.turn', (SELECT min(turn) - 1 FROM jobs
                       WHERE plate = ?2 AND state = 'queued')) WHERE id = ?1";
            write.tx.execute(sql, params![id, row.plate])?;
            Ok(find(&write.tx, id)?)
        })
    }

    /// Deletes a job that does not run, with its run folder. Its key stays spent: repeating the request does not run it
    /// again. False for one that runs, and stays; `None` when there is no such job.
    pub fn delete(&self, id: &JobId, entry: AuditEntry) -> Result<Option<bool>, StoreError> {
        self.write(|write| {
            let Some(row) = find(&write.tx, id)? else { return Ok(None) };
            if row.state == JobState::Running {
                return Ok(Some(false));
            }
            if let Some(folder) = &row.folder
                && !self.remove_folder(folder)
            {
                return Err(StoreError::Io(format!("run folder {folder} cannot be deleted")));
            }
            write.tx.execute("DELETE FROM jobs WHERE id = ?1", [id])?;
            write.audit(&AuditEntry { plate: Some(row.job.plate), reason: row.key.unwrap_or_default(), ..entry })?;
            Ok(Some(true))
        })
    }

    /// The job with that id; `None` when there is none.
    pub fn job(&self, id: &JobId) -> Result<Option<JobRow>, StoreError> {
        self.read(|connection| find(connection, id))
    }

    /// At most `limit` jobs, newest first: only those in this state, of this plate and older than `before`, which need
    /// not exist.
    pub fn list(
        &self,
        state: Option<JobState>,
        plate: Option<&str>,
        before: Option<JobId>,
        limit: usize,
    ) -> Result<Vec<JobRow>, StoreError> {
        let by_state = state.map_or("?3 IS NULL", |_| "state = ?3");
        let by_plate = plate.map_or("?4 IS NULL", |_| "plate = ?4");
        let below = before.map_or("~".to_owned(), |id| id.to_string());
        let sql = format!("SELECT job FROM jobs WHERE {by_state} AND {by_plate} AND id < ?1 ORDER BY id DESC LIMIT ?2");
        let values = params![below, limit, state.map(JobState::code), plate];
        self.read(|connection| rows(connection, &sql, values, job_of))
    }

    /// Number of jobs of each plate in each state, or in one.
    pub fn counts(&self, of: Option<JobState>) -> Result<Vec<(String, JobState, u64)>, StoreError> {
        let of = of.map_or(String::new(), |state| format!("WHERE state = '{}'", state.code()));
        let sql = &format!("SELECT plate, json_quote(state), count(*) FROM jobs {of} GROUP BY plate, state");
        let of_row = |row: &Row<'_>| Ok((row.get(0)?, row.get::<_, Json<JobState>>(1)?.0, row.get(2)?));
        self.read(|connection| rows(connection, sql, [], of_row))
    }

    /// Takes the oldest job queued for `plate`: it is `running` on the disk when this returns, and is returned once.
    pub(crate) fn claim(&self, plate: &str) -> Result<Option<JobRow>, StoreError> {
        self.write(|write| write.next_queued(plate)?.map(|row| self.begin(write, row)).transpose())
    }

    /// Begins a run of the standing job `job`, as [`Self::claim`] begins a queued one; `None` while a job is queued for
    /// its plate. A job queued after this returns finds the run begun.
    pub(crate) fn begin_standing(&self, job: &JobRow) -> Result<Option<JobRow>, StoreError> {
        self.write(|write| {
            if write.queued(&job.plate)? > 0 {
                return Ok(None);
            }
            let mut row = write.insert(job)?;
            row.job.standing = true;
            self.begin(write, row).map(Some)
        })
    }

    /// Creates the job's own folder before the job is claimed, so that no job is ever without one. An existing folder
    /// does not prevent the claim: the run checks its contents before anything is written.
    fn begin(&self, write: &Write<'_>, mut row: JobRow) -> Result<JobRow, StoreError> {
        let folder = row.run_folder();
        fs::create_dir_all(self.runs.join(&folder))?;
        row.folder = Some(folder);
        // a row must never name a folder that a power cut removes
        sync_folder(&self.runs)?;
        row.job.started_at = Some(write.at.clone().max(row.submitted_at.clone()));
        row.job.state = JobState::Running;
        write.update(&row)?;
        Ok(row)
    }

    /// Stores the running job `row` as ended; a job that had ended before stays as it is. On a fault the caller must
    /// retry later, and start nothing on its plate until then. Deletes old run folders.
    pub(crate) fn finish(&self, row: &JobRow) -> Result<(), StoreError> {
        self.write(|write| match find(&write.tx, &row.id)? {
            Some(before) if before.state != JobState::Running => Ok(()),
            Some(_) => self.end(write, row.clone(), write.at.clone()).map(drop),
            None => Err(StoreError::Io(format!("there is no job {}", row.id))),
        })?;
        self.sweep();
        Ok(())
    }

    /// Stores a job that ended at this time, or when it began or was submitted if that is later.
    pub(super) fn end(&self, write: &Write<'_>, mut row: JobRow, at: String) -> Result<JobRow, StoreError> {
        row.bytes = row.folder.as_ref().map_or(0, |folder| size_of(&self.runs.join(folder)));
        let begun = row.started_at.as_ref().unwrap_or(&row.submitted_at).clone();
        row.job.finished_at = Some(at.max(begun));
        if row.state == JobState::Completed {
            row.job.progress = 1.0;
        }
        write.update(&row)?;
        Ok(row)
    }

    /// Adds an entry to the audit log. No operation changes or removes one.
    pub fn audit(&self, entry: &AuditEntry) -> Result<(), StoreError> {
        self.write(|write| write.audit(entry))
    }

    /// Stores the pause of a plate, or with `None` that it may go on, and the entry for the audit log that says so.
    pub(crate) fn set_pause(
        &self,
        plate: &str,
        pause: Option<&PauseCause>,
        entry: &AuditEntry,
    ) -> Result<(), StoreError> {
        self.write(|write| {
            write.audit(entry)?;
            write.set_pause(plate, pause)
        })
    }
}

impl Write<'_> {
    fn queued(&self, plate: &str) -> rusqlite::Result<usize> {
        let sql = "SELECT count(*) FROM jobs WHERE plate = ?1 AND state = 'queued'";
        self.tx.query_row(sql, [plate], |row| row.get(0))
    }

    /// The job that `plate` runs next, with its text.
    fn next_queued(&self, plate: &str) -> rusqlite::Result<Option<JobRow>> {
        let sql = "SELECT job, spec FROM jobs WHERE plate = ?1 AND state = 'queued' ORDER BY turn, id LIMIT 1";
        let of_row = |row: &Row<'_>| Ok(JobRow { spec_json: row.get(1)?, ..job_of(row)? });
        self.tx.query_row(sql, [plate], of_row).optional()
    }

    /// Stores a new job, under a new id and with the time.
    fn insert(&self, job: &JobRow) -> rusqlite::Result<JobRow> {
        let mut row = job.clone();
        let last = self.tx.query_row("SELECT max(id) FROM jobs", [], |row| row.get(0))?;
        (row.job.id, row.job.submitted_at) = (JobId::next(last, self.now), self.at.clone());
        let sql = "INSERT INTO jobs (id, job, spec) VALUES (?1, ?2, ?3)";
        self.tx.execute(sql, params![row.id, Json(&row), row.spec_json])?;
        Ok(row)
    }

    /// Replaces a job. Its text is deleted once it has left the queue.
    fn update(&self, row: &JobRow) -> rusqlite::Result<()> {
        let sql = "UPDATE jobs SET job = ?2, spec = iif(?3, spec, NULL) WHERE id = ?1";
        self.tx.execute(sql, params![row.id, Json(row), row.state == JobState::Queued]).map(drop)
    }

    pub(super) fn audit(&self, entry: &AuditEntry) -> Result<(), StoreError> {
        let AuditEntry { plate, act, operator, reason, remote, token_name } = entry;
        let sql = "INSERT INTO audit (at, plate, act, operator, reason, remote, token_name)
                   VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)";
        self.tx.execute(sql, params![self.at, plate, act, operator, reason, remote, token_name])?;
        Ok(())
    }

    pub(super) fn set_pause(&self, plate: &str, pause: Option<&PauseCause>) -> Result<(), StoreError> {
        let sql = "INSERT OR REPLACE INTO plates (name, pause) VALUES (?1, ?2)";
        self.tx.execute(sql, params![plate, pause.map(Json)])?;
        Ok(())
    }
}

/// The earlier answer to a request with this idempotency key; `None` for a new one.
fn repeated(connection: &Connection, key: &str, body_sha256: &[u8; 32]) -> rusqlite::Result<Option<SubmitOutcome>> {
    Ok(match connection.query_row("SELECT job FROM jobs WHERE key = ?1", [key], job_of).optional()? {
        Some(row) if row.body_sha256 == *body_sha256 => Some(SubmitOutcome::Replayed(row)),
        Some(_) => Some(SubmitOutcome::KeyReused),
        None => {
            let sql = "SELECT EXISTS (SELECT 1 FROM audit WHERE act = 'delete' AND reason = ?1)";
            let is_of_deleted: bool = connection.query_row(sql, [key], |row| row.get(0))?;
            is_of_deleted.then_some(SubmitOutcome::KeyReused)
        }
    })
}

fn find(connection: &Connection, id: &JobId) -> rusqlite::Result<Option<JobRow>> {
    connection.query_row("SELECT job FROM jobs WHERE id = ?1", [id], job_of).optional()
}

/// The job in a row whose first column is `job`.
pub(super) fn job_of(row: &Row<'_>) -> rusqlite::Result<JobRow> {
    row.get::<_, Json<JobRow>>(0).map(|job| job.0)
}

/// True when the daemon that had the store before was shut down in order, or there was none.
pub(super) fn ended_in_order(connection: &Connection) -> rusqlite::Result<bool> {
    let sql = "SELECT act FROM audit WHERE plate IS NULL AND act IN (?1, ?2) ORDER BY id DESC LIMIT 1";
    let last = connection.query_row(sql, [AuditEntry::STARTED, AuditEntry::ENDED], |row| row.get::<_, String>(0));
    Ok(last.optional()?.is_none_or(|act| act == AuditEntry::ENDED))
}
