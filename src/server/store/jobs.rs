use rusqlite::{Connection, OptionalExtension, params};

use super::ages::cutoff;
use super::columns::{JOB, Micros, job_of, rows, sql_limit};
use super::write_tx::WriteTx;
use super::{
    CancelOutcome, ClaimedJob, DeleteOutcome, JobEnd, JobId, JobPage, JobRow, JobSelection, JobState, NewJob,
    StoredEvent, SubmitOutcome,
};

/// Ended runs of standing jobs except the newest of each plate.
const SURPLUS_STANDING: &str = "
    SELECT id, folder FROM (
        SELECT id, folder, row_number() OVER (PARTITION BY plate ORDER BY id DESC) AS age FROM jobs
            WHERE standing = 1 AND state NOT IN ('queued', 'running'))
    WHERE age > ?1 ORDER BY id";

/// Outcome of [`WriteTx::start`].
pub(super) enum StartOutcome {
    /// The job is running.
    Now(Box<ClaimedJob>),
    /// The job is no longer queued, and the folder made for it is not needed.
    Not,
    /// The folder belongs to another job: this job can never begin, and has ended.
    Never,
}

/// Earlier use of an idempotency key.
enum KeyLookup {
    /// Used with the same body, for this job.
    Same(JobId),
    /// Used with another body.
    Other,
}

impl WriteTx<'_> {
    /// Queues a job, unless its key was used or its plate's queue is full.
    pub fn accept(&self, job: &NewJob) -> rusqlite::Result<SubmitOutcome> {
        if let Some(answered) = self.repeated(job)? {
            return Ok(answered);
        }
        let queued = self.queued(&job.plate)?;
        if queued >= self.limits.queued {
            return Ok(SubmitOutcome::QueueFull { queued });
        }
        let row = job.row(self.ids.next(self.now), Micros::rounded(self.now));
        insert(self.connection, &row, Some(&job.spec_json))?;
        if let Some(key) = &job.key {
            self.remember(key, &job.body_sha256, &row.id)?;
        }
        Ok(SubmitOutcome::New(row))
    }

    /// The earlier answer to a job with a repeated key; `None` for a new key.
    pub fn repeated(&self, job: &NewJob) -> rusqlite::Result<Option<SubmitOutcome>> {
        Ok(match self.seen(job)? {
            Some(KeyLookup::Same(id)) => {
                Some(self.find(&id)?.map_or(SubmitOutcome::KeyReused, SubmitOutcome::Replayed))
            }
            Some(KeyLookup::Other) => Some(SubmitOutcome::KeyReused),
            None => None,
        })
    }

    /// Earlier use of a job's key; `None` when it has no key, or the use is too old.
    fn seen(&self, job: &NewJob) -> rusqlite::Result<Option<KeyLookup>> {
        let Some(key) = &job.key else { return Ok(None) };
        let sql = "SELECT body_sha256, job FROM keys WHERE key = ?1 AND uptime >= ?2";
        let oldest = cutoff(self.uptime, self.limits.keys_kept);
        let known =
            self.connection.query_row(sql, params![key, oldest], |row| Ok((row.get::<_, [u8; 32]>(0)?, row.get(1)?)));
        let seen = |(body, id)| if body == job.body_sha256 { KeyLookup::Same(id) } else { KeyLookup::Other };
        if let Some(known) = known.optional()? {
            return Ok(Some(seen(known)));
        }
        let sql = "SELECT EXISTS (SELECT 1 FROM spent_keys WHERE key = ?1 AND uptime >= ?2)";
        let is_spent = self.connection.query_row(sql, params![key, oldest], |row| row.get::<_, bool>(0))?;
        Ok(is_spent.then_some(KeyLookup::Other))
    }

    /// Stores a key, replacing a use that is too old.
    pub fn remember(&self, key: &str, body_sha256: &[u8; 32], id: &JobId) -> rusqlite::Result<()> {
        let sql = "INSERT OR REPLACE INTO keys (key, body_sha256, job, uptime) VALUES (?1, ?2, ?3, ?4)";
        self.connection.execute(sql, params![key, body_sha256, id, self.uptime]).map(|_| ())
    }

    /// Deletes keys whose use is too old.
    pub fn forget_keys(&self) -> rusqlite::Result<()> {
        let oldest = cutoff(self.uptime, self.limits.keys_kept);
        self.connection.execute("DELETE FROM keys WHERE uptime < ?1", [oldest])?;
        self.connection.execute("DELETE FROM spent_keys WHERE uptime < ?1", [oldest]).map(|_| ())
    }

    fn queued(&self, plate: &str) -> rusqlite::Result<usize> {
        let sql = "SELECT count(*) FROM jobs WHERE plate = ?1 AND state = 'queued'";
        self.connection
            .query_row(sql, [plate], |row| row.get::<_, i64>(0))
            .map(|count| usize::try_from(count).unwrap_or(0))
    }

    /// The job that `plate` runs next.
    pub fn next_queued(&self, plate: &str) -> rusqlite::Result<Option<JobRow>> {
        let sql = format!("SELECT {JOB} FROM jobs WHERE plate = ?1 AND state = 'queued' ORDER BY turn, id LIMIT 1");
        self.connection.query_row(&sql, [plate], job_of).optional()
    }

    /// Moves a queued job to the front of its plate's queue; a job in another state stays as it is. The job as it is
    /// then; `None` when there is no such job.
    pub fn move_to_front(&self, id: &JobId) -> rusqlite::Result<Option<JobRow>> {
        let Some(row) = self.find(id)? else { return Ok(None) };
        let is_next = self.next_queued(&row.plate)?.is_some_and(|next| next.id == *id);
        if row.state != JobState::Queued || is_next {
            return Ok(Some(row));
        }
        let sql = "UPDATE jobs SET turn = (SELECT min(turn) - 1 FROM jobs WHERE plate = ?2 AND state = 'queued')
                   WHERE id = ?1";
        self.connection.execute(sql, params![id, row.plate])?;
        self.find(id)
    }

    /// Marks a queued job as running.
    pub fn start(&self, id: &JobId, folder: &str) -> rusqlite::Result<StartOutcome> {
        let taken = "SELECT EXISTS (SELECT 1 FROM jobs WHERE folder = ?1)";
        if self.connection.query_row(taken, [folder], |row| row.get(0))? {
            self.end(id, JobState::Queued, &JobEnd::without_a_folder())?;
            return Ok(StartOutcome::Never);
        }
        let sql = "UPDATE jobs SET state = 'running', started_at = max(?2, submitted_at), folder = ?3
                   WHERE id = ?1 AND state = 'queued'";
        if self.connection.execute(sql, params![id, Micros(self.now), folder])? == 0 {
            return Ok(StartOutcome::Not);
        }
        let spec_json = self.connection.query_row("SELECT spec FROM specs WHERE job = ?1", [id], |row| row.get(0))?;
        Ok(self.find(id)?.map_or(StartOutcome::Not, |row| StartOutcome::Now(Box::new(ClaimedJob { row, spec_json }))))
    }

    /// A run of the standing job `job`, ready to begin; `None` while any job is queued for its plate.
    pub fn next_standing(&self, job: &NewJob) -> rusqlite::Result<Option<JobRow>> {
        let is_free = self.queued(&job.plate)? == 0;
        let row = || JobRow { standing: true, ..job.row(self.ids.next(self.now), Micros::rounded(self.now)) };
        Ok(is_free.then(row))
    }

    /// Begins that run in its folder. False when a job was queued in between: that job runs first.
    pub fn start_standing(&self, row: &JobRow, spec_json: &str) -> rusqlite::Result<bool> {
        let is_free = self.queued(&row.plate)? == 0;
        if is_free {
            insert(self.connection, row, Some(spec_json))?;
        }
        Ok(is_free)
    }

    /// Ended runs of standing jobs above the limit, with their run folders.
    pub fn surplus_standing(&self) -> rusqlite::Result<Vec<(JobId, Option<String>)>> {
        let most = sql_limit(self.limits.standing_runs);
        rows(self.connection, SURPLUS_STANDING, [most], |row| Ok((row.get(0)?, row.get(1)?)))
    }

    /// Deletes the row of an ended standing run, once its run folder is gone.
    pub fn forget_standing(&self, id: &JobId) -> rusqlite::Result<()> {
        let sql = "DELETE FROM jobs WHERE id = ?1 AND standing = 1 AND folder IS NULL
                       AND state NOT IN ('queued', 'running')";
        self.connection.execute(sql, [id]).map(|_| ())
    }

    /// Ends a job in state `from` and returns its last event; `None`, and no change, when it is in another state.
    pub fn end(&self, id: &JobId, from: JobState, end: &JobEnd) -> rusqlite::Result<Option<StoredEvent>> {
        let JobEnd { state, reason, report_json, recording, .. } = end;
        let sql = "UPDATE jobs SET state = ?3, reason = ?4, report = ?5, recording = ?6,
                       finished_at = max(?7, coalesce(started_at, submitted_at)), ended_uptime = ?8,
                       progress = CASE ?3 WHEN 'completed' THEN 1 ELSE progress END
                   WHERE id = ?1 AND state = ?2";
        let (now, uptime) = (Micros(self.now), self.uptime);
        if self.connection.execute(sql, params![id, from, state, reason, report_json, recording, now, uptime])? == 0 {
            return Ok(None);
        }
        self.drop_spec(id)?;
        self.append_event(id, &end.event())
    }

    /// Takes a job out of the queue.
    pub fn cancel_queued(&self, id: &JobId) -> rusqlite::Result<CancelOutcome> {
        let finished = self.end(id, JobState::Queued, &JobEnd::before_it_began())?;
        Ok(match (self.find(id)?, finished) {
            (None, _) => CancelOutcome::Unknown,
            (Some(row), Some(finished)) => CancelOutcome::Now(row, finished),
            (Some(row), None) => CancelOutcome::Not(row),
        })
    }

    /// Deletes a job that does not run, with its events. Its key stays spent: repeating the request does not run it
    /// again.
    pub fn delete(&self, id: &JobId) -> rusqlite::Result<DeleteOutcome> {
        let finished = self.end(id, JobState::Queued, &JobEnd::before_it_began())?;
        let Some(row) = self.find(id)? else { return Ok(DeleteOutcome::Unknown) };
        if row.state == JobState::Running {
            return Ok(DeleteOutcome::Not(row));
        }
        let sql = "INSERT OR REPLACE INTO spent_keys (key, uptime) SELECT key, uptime FROM keys WHERE job = ?1";
        self.connection.execute(sql, [id])?;
        self.connection.execute("DELETE FROM jobs WHERE id = ?1", [id])?;
        Ok(DeleteOutcome::Now(row, finished))
    }

    /// Deletes the text of an ended job when its run folder has a copy, and when the job never began. Otherwise the
    /// text stays as long as the job's row.
    fn drop_spec(&self, id: &JobId) -> rusqlite::Result<()> {
        let sql = "SELECT folder FROM jobs WHERE id = ?1";
        let folder: Option<String> = self.connection.query_row(sql, [id], |row| row.get(0))?;
        if folder.is_none_or(|name| self.runs.join(name).join("effective.json").is_file()) {
            self.connection.execute("DELETE FROM specs WHERE job = ?1", [id])?;
        }
        Ok(())
    }

    /// Stores the share of a running job that is done.
    pub fn progress(&self, id: &JobId, progress: f64) -> rusqlite::Result<()> {
        let share = if progress.is_nan() { 0.0 } else { progress.clamp(0.0, 1.0) };
        self.connection
            .execute("UPDATE jobs SET progress = ?2 WHERE id = ?1 AND state = 'running'", params![id, share])?;
        Ok(())
    }

    /// Stores whether a plate is paused.
    pub fn set_paused(&self, plate: &str, paused: bool) -> rusqlite::Result<()> {
        let sql = "INSERT INTO plates VALUES (?1, ?2) ON CONFLICT (name) DO UPDATE SET paused = excluded.paused";
        self.connection.execute(sql, params![plate, paused])?;
        Ok(())
    }

    pub fn find(&self, id: &JobId) -> rusqlite::Result<Option<JobRow>> {
        find(self.connection, id)
    }
}

/// Writes a complete row, and the job's text, if any.
pub(super) fn insert(tx: &Connection, row: &JobRow, spec_json: Option<&str>) -> rusqlite::Result<()> {
    let sql = format!(
        "INSERT INTO jobs ({JOB}, first_event)
         VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13, ?14, ?15, ?16, ?17, ?18, ?16 + 1)"
    );
    let values = params![
        row.id,
        row.name,
        row.plate,
        row.state,
        row.seed.cast_signed(),
        row.pace.code(),
        row.rig_fingerprint,
        Micros(row.submitted_at),
        row.started_at.map(Micros),
        row.finished_at.map(Micros),
        row.progress,
        row.reason,
        row.report_json,
        row.folder,
        row.recording,
        row.last_event.cast_signed(),
        row.standing,
        row.turn,
    ];
    tx.execute(&sql, values)?;
    match spec_json {
        Some(spec) => tx.execute("INSERT INTO specs (job, spec) VALUES (?1, ?2)", params![row.id, spec]).map(|_| ()),
        None => Ok(()),
    }
}

pub(super) fn find(connection: &Connection, id: &JobId) -> rusqlite::Result<Option<JobRow>> {
    connection.query_row(&format!("SELECT {JOB} FROM jobs WHERE id = ?1"), [id], job_of).optional()
}

/// A page of jobs, newest first.
pub(super) fn list(connection: &Connection, page: &JobSelection) -> rusqlite::Result<JobPage> {
    let limit = page.limit.clamp(1, JobSelection::MOST);
    let by_state = page.state.map_or("", |_| "state = ?3 AND");
    // ids have 16 bytes, so this one sorts above all of them
    let below = page.cursor.map_or(vec![0xff; 17], |id| id.as_bytes().to_vec());
    let sql = format!("SELECT {JOB} FROM jobs WHERE {by_state} id < ?1 ORDER BY id DESC LIMIT ?2");
    let most = limit as i64 + 1;
    let mut rows = match page.state {
        Some(state) => rows(connection, &sql, params![below, most, state], job_of)?,
        None => rows(connection, &sql, params![below, most], job_of)?,
    };
    let more = rows.len() > limit;
    rows.truncate(limit);
    let next = rows.last().filter(|_| more).map(|row| row.id);
    Ok(JobPage { rows, next })
}

/// Number of jobs queued for each plate; plates without any are left out.
pub(super) fn queued(connection: &Connection) -> rusqlite::Result<Vec<(String, u64)>> {
    let sql = "SELECT plate, count(*) FROM jobs WHERE state = 'queued' GROUP BY plate";
    rows(connection, sql, [], |row| Ok((row.get(0)?, row.get::<_, i64>(1)?.cast_unsigned())))
}

/// Number of jobs of each plate in each state.
pub(super) fn counts(connection: &Connection) -> rusqlite::Result<Vec<(String, JobState, u64)>> {
    let sql = "SELECT plate, state, count(*) FROM jobs GROUP BY plate, state";
    rows(connection, sql, [], |row| Ok((row.get(0)?, row.get(1)?, row.get::<_, i64>(2)?.cast_unsigned())))
}
