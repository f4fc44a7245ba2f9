use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Duration;

use jiff::Timestamp;

use super::jobs::StartOutcome;
use super::reader::Readers;
use super::retention::Retention;
use super::write_queue::{WriteQueue, task};
use super::write_tx::WriteTx;
use super::{
    AuditEntry, CancelOutcome, ClaimedJob, DeleteOutcome, JobEnd, JobId, JobPage, JobRow, JobSelection, JobState,
    JobStore, MakeFolder, NewEvent, NewJob, Publish, Replay, StoreFault, StoreHealth, StoredEvent, SubmitOutcome,
    history, jobs,
};
use upm_core::files::sync_folder;

/// The job store of one data folder. Callbacks run on its threads, after the commit: they must return at once, and
/// never call [`JobStore::claim`] or [`JobStore::finish`].
pub struct Store {
    pub(super) queue: WriteQueue,
    pub(super) readers: Readers,
    pub(super) runs: PathBuf,
    pub(super) now: fn() -> Timestamp,
    pub(super) retention: Retention,
}

impl fmt::Debug for Store {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Store").field("runs", &self.runs).finish_non_exhaustive()
    }
}

impl Store {
    /// Queues a job if `wanted` still returns true when its turn comes; otherwise `None`, and nothing is stored. A job
    /// in the answer is on the disk.
    pub fn accept_if(
        &self,
        job: NewJob,
        wanted: impl Fn() -> bool + Send + 'static,
        done: impl FnOnce(Result<Option<SubmitOutcome>, StoreFault>) + Send + 'static,
    ) {
        let accept = move |tx: &WriteTx<'_>| wanted().then(|| tx.accept(&job)).transpose();
        self.queue.write(task(accept, done));
    }

    /// The earlier answer to a job with a repeated key; `None` for a new key. Queues nothing.
    pub fn repeated(&self, job: NewJob, done: impl FnOnce(Result<Option<SubmitOutcome>, StoreFault>) + Send + 'static) {
        self.queue.write(task(move |tx: &WriteTx<'_>| tx.repeated(&job), done));
    }

    /// Takes a job out of the queue.
    pub fn cancel_queued(&self, id: &JobId, done: impl FnOnce(Result<CancelOutcome, StoreFault>) + Send + 'static) {
        let id = *id;
        self.queue.write(task(move |tx: &WriteTx<'_>| tx.cancel_queued(&id), done));
    }

    /// Moves a queued job to the front of its plate's queue; a job in another state stays as it is. The answer is the
    /// job as it is then; `None` when there is no such job.
    pub fn move_to_front(&self, id: &JobId, done: impl FnOnce(Result<Option<JobRow>, StoreFault>) + Send + 'static) {
        let id = *id;
        self.queue.write(task(move |tx: &WriteTx<'_>| tx.move_to_front(&id), done));
    }

    /// Deletes a job that does not run; its run folder is removed soon after.
    pub fn delete(&self, id: &JobId, done: impl FnOnce(Result<DeleteOutcome, StoreFault>) + Send + 'static) {
        let (id, discards) = (*id, self.retention.discards());
        let deleted = move |outcome: Result<DeleteOutcome, StoreFault>| {
            if let Ok(DeleteOutcome::Now(row, _)) = &outcome {
                row.folder.iter().for_each(|folder| discards.add(folder));
            }
            done(outcome);
        };
        self.queue.write(task(move |tx: &WriteTx<'_>| tx.delete(&id), deleted));
    }

    /// The job with that id; `None` when there is none.
    pub fn job(&self, id: &JobId, done: impl FnOnce(Result<Option<JobRow>, StoreFault>) + Send + 'static) {
        let id = *id;
        self.readers.ask(move |connection| jobs::find(connection, &id), done);
    }

    /// A page of jobs, newest first.
    pub fn list(&self, page: JobSelection, done: impl FnOnce(Result<JobPage, StoreFault>) + Send + 'static) {
        self.readers.ask(move |connection| jobs::list(connection, &page), done);
    }

    /// Number of jobs queued for each plate; plates without any are left out.
    pub fn queued(&self, done: impl FnOnce(Result<Vec<(String, u64)>, StoreFault>) + Send + 'static) {
        self.readers.ask(jobs::queued, done);
    }

    /// Number of jobs of each plate in each state.
    pub fn counts(&self, done: impl FnOnce(Result<Vec<(String, JobState, u64)>, StoreFault>) + Send + 'static) {
        self.readers.ask(jobs::counts, done);
    }

    /// A job's events above number `after`, at most `most`; `None` when there is no such job.
    pub fn replay(
        &self,
        id: &JobId,
        after: u64,
        most: usize,
        done: impl FnOnce(Result<Option<Replay>, StoreFault>) + Send + 'static,
    ) {
        let id = *id;
        self.readers.ask(move |connection| history::replay(connection, &id, after, most), done);
    }

    /// Bytes in run folders at the last count, which takes place every minute and after every job.
    pub fn runs_bytes(&self) -> Option<u64> {
        self.retention.bytes()
    }

    /// The folder of run folders.
    pub fn runs(&self) -> &Path {
        &self.runs
    }

    /// The state of the store's threads and disk.
    pub fn health(&self) -> StoreHealth {
        let fault = if self.queue.status.closed.load(Ordering::SeqCst) {
            Some(StoreFault::Closed)
        } else {
            self.queue.status.fault()
        };
        StoreHealth {
            heartbeat: self.queue.status.heartbeat(),
            fault,
            waiting: self.queue.status.waiting.load(Ordering::Relaxed),
            free_bytes: self.queue.status.free_bytes(),
            audit_waiting: self.queue.status.pending.pending_audit_entries(),
            reader_busy: self.readers.busy(),
        }
    }

    /// Writes everything queued and records an orderly shutdown. False when that took longer than `within`: then the
    /// next start recovers as after a crash. Later requests are refused.
    pub fn close(&self, within: Duration) -> bool {
        self.queue.close(within)
    }
}

impl JobStore for Store {
    fn claim(&self, plate: &str, folder: MakeFolder<'_>) -> Result<Option<ClaimedJob>, StoreFault> {
        loop {
            let asked = plate.to_owned();
            let Some(row) = self.queue.written(move |tx| tx.next_queued(&asked))? else {
                return Ok(None);
            };
            let name = folder(&row)?;
            // a row must never name a folder that a power cut removes
            sync_folder(&self.runs)?;
            let made = name.clone();
            let claimed = self.queue.written(move |tx| tx.start(&row.id, &made));
            match claimed {
                Ok(StartOutcome::Now(claimed)) => return Ok(Some(*claimed)),
                Ok(StartOutcome::Never) => {}
                // cancelled in between: the folder is still empty
                Ok(StartOutcome::Not) => drop(std::fs::remove_dir(self.runs.join(&name))),
                Err(fault) => {
                    drop(std::fs::remove_dir(self.runs.join(&name)));
                    return Err(fault);
                }
            }
        }
    }

    fn begin_standing(&self, job: &NewJob, folder: MakeFolder<'_>) -> Result<Option<ClaimedJob>, StoreFault> {
        let new = job.clone();
        let Some(row) = self.queue.written(move |tx| tx.next_standing(&new))? else {
            return Ok(None);
        };
        let name = folder(&row)?;
        sync_folder(&self.runs)?;
        let (state, started_at) = (JobState::Running, Some(row.submitted_at));
        let row = JobRow { state, started_at, folder: Some(name.clone()), ..row };
        let (begun, spec_json) = (row.clone(), job.spec_json.clone());
        let started = self.queue.written(move |tx| tx.start_standing(&begun, &spec_json));
        if !matches!(started, Ok(true)) {
            drop(std::fs::remove_dir(self.runs.join(&name)));
        }
        Ok(started?.then(|| ClaimedJob { row, spec_json: job.spec_json.clone() }))
    }

    fn finish(&self, id: &JobId, end: JobEnd) -> Result<Option<StoredEvent>, StoreFault> {
        let known = *id;
        let written = self.queue.written(move |tx| {
            let finished = tx.end(&known, JobState::Running, &end)?;
            Ok((finished, tx.find(&known)?))
        });
        let (finished, found) = written?;
        self.retention.notify();
        let never_began = || StoreFault::Io(format!("job {id} never began"));
        found.filter(|row| row.state.is_final()).map(|_| finished).ok_or_else(never_began)
    }

    fn append_event(&self, id: &JobId, event: NewEvent, published: Publish) -> bool {
        let id = *id;
        let done = move |stored: Result<Option<StoredEvent>, StoreFault>| {
            published(stored.and_then(|event| event.ok_or_else(|| StoreFault::Io(format!("there is no job {id}")))));
        };
        self.queue.offer(task(move |tx: &WriteTx<'_>| tx.append_event(&id, &event), done)).is_ok()
    }

    fn progress(&self, id: &JobId, progress: f64) {
        self.queue.status.pending.progress(id, progress);
    }

    fn note_paused(&self, plate: &str, paused: bool) {
        self.queue.status.pending.paused(plate, paused);
        self.queue.wake();
    }

    fn audit(&self, entry: AuditEntry) -> bool {
        let taken = self.queue.status.pending.act((self.now)(), entry);
        self.queue.wake();
        taken
    }

    fn audit_durably(&self, entry: AuditEntry) -> Result<(), StoreFault> {
        let at = (self.now)();
        self.queue.written(move |tx| tx.audit(at, &entry))
    }
}
