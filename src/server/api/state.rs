use std::io;
use std::sync::Arc;
use std::sync::mpsc::Receiver;
use std::time::Duration;

use axum::http::StatusCode;
use parking_lot::Mutex;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tokio::sync::Semaphore;
use tokio::task::spawn_blocking;
use tokio_util::sync::CancellationToken;

use super::health::{Counted, Observed};
use crate::http::{BLOCKING_THREADS, Caller, Confirmations, Problem, Tokens};
use crate::store::{AuditEntry, Job, JobId, JobRow, JobState, Store, StoreError};
use crate::supervisor::{DryRunSlot, Plate, PlateHandle, PlateSupervisor, ResetError};
use upm_core::files::free_bytes;
use upm_core::time::{Clock, MonotonicClock};
use upm_runner::config::DaemonSpec;

/// Most event streams at once.
pub(crate) const EVENT_STREAMS: usize = 256;

/// Longest wait of an emergency stop for the motors to be silent, for the latch file and for the audit log.
const CONFIRMED_WITHIN: Duration = Duration::from_millis(800);

/// State that all handlers share.
#[derive(Debug)]
pub(crate) struct DaemonState {
    pub spec: DaemonSpec,
    pub store: Arc<Store>,
    pub plates: PlateSupervisor,
    pub tokens: Arc<Tokens>,
    pub clock: MonotonicClock,
    /// Cancelled once the daemon is shutting down; ends the server and event streams.
    pub ending: CancellationToken,
    counted: Mutex<Counted>,
    pub confirmations: Confirmations,
    pub dry_runs: DryRunSlot,
    /// Places for work that waits for the disk. Threads remain for files that are being sent.
    places: Arc<Semaphore>,
    /// Places for event streams.
    pub event_streams: Arc<Semaphore>,
    pub version: &'static str,
}

/// Result of an emergency stop.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct EStopped {
    /// Name of the plate.
    pub plate: String,
    /// True once the motors were seen at zero; a plate at rest has nothing to stop.
    pub silent: bool,
    /// True when the stop is on the disk and holds over a restart.
    pub persisted: bool,
    /// Plate time of the request, s.
    pub requested_at_s: Option<f64>,
    /// Plate time from which the force was zero, s.
    pub silent_at_s: Option<f64>,
    /// Wall time between the two, s.
    pub wall_s: Option<f64>,
}

impl DaemonState {
    /// The state of a daemon that has just started.
    pub fn new(
        spec: DaemonSpec,
        store: Arc<Store>,
        plates: PlateSupervisor,
        tokens: Arc<Tokens>,
        clock: MonotonicClock,
        version: &'static str,
    ) -> io::Result<Self> {
        Ok(Self {
            spec,
            store,
            plates,
            tokens,
            clock,
            ending: CancellationToken::new(),
            counted: Mutex::new(Counted { at: clock.elapsed(), ..Counted::default() }),
            confirmations: Confirmations::start()?,
            dry_runs: DryRunSlot::default(),
            places: Arc::new(Semaphore::new(BLOCKING_THREADS - 2)),
            event_streams: Arc::new(Semaphore::new(EVENT_STREAMS)),
            version,
        })
    }

    /// The answer of `work`, which may wait for the disk. The work gets a test of whether the client still waits, and
    /// is left out when it does not.
    pub async fn blocking<T: Send + 'static>(
        self: &Arc<Self>,
        work: impl FnOnce(&Self, &dyn Fn() -> bool) -> Result<T, Problem> + Send + 'static,
    ) -> Result<T, Problem> {
        let (daemon, gone) = (Arc::clone(self), CancellationToken::new());
        let _awaited = gone.clone().drop_guard();
        let place = Arc::clone(&self.places).acquire_owned().await;
        let answer = spawn_blocking(move || {
            // free once the work has ended, whether or not its client waits
            let _place = place;
            let is_awaited = || !gone.is_cancelled();
            if is_awaited() { work(&daemon, &is_awaited) } else { Err(unheard()) }
        });
        let broken = |_| Err(Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "internal error"));
        answer.await.unwrap_or_else(broken)
    }

    /// The answer of `work` on the job with the id `text`.
    pub async fn on_job<T: Send + 'static>(
        self: &Arc<Self>,
        text: &str,
        work: impl FnOnce(&Self, JobId) -> Result<T, Problem> + Send + 'static,
    ) -> Result<T, Problem> {
        let id = JobId::parse(text).ok_or_else(no_job)?;
        self.blocking(move |daemon, _| work(daemon, id)).await
    }

    pub fn plate(&self, name: &str) -> Result<&Arc<PlateHandle>, Problem> {
        self.plates.get(name).ok_or_else(|| unknown("there is no such plate"))
    }

    /// The plate that runs the job, or has run none since; otherwise the refusal says that there is no `what`.
    pub fn plate_under(&self, id: &JobId, what: &str) -> Result<&Arc<PlateHandle>, Problem> {
        let plate = self.plates.get(&self.row(id)?.plate).filter(|plate| plate.job.is_newest(id));
        plate.ok_or_else(|| unknown(&format!("there is {what} of a job only until its plate begins the next")))
    }

    pub fn row(&self, id: &JobId) -> Result<JobRow, Problem> {
        self.store.job(id)?.ok_or_else(no_job)
    }

    /// A job for a client. The progress of one that runs is known to its plate alone.
    pub fn seen(&self, row: JobRow) -> Job {
        let is_on = |plate: &&Arc<PlateHandle>| plate.job.running().is_some_and(|running| running.job == row.id);
        let plate = self.plates.get(&row.plate).filter(|plate| row.state == JobState::Running && is_on(plate));
        Job { progress: plate.map_or(row.progress, |plate| plate.job.seen().0.progress), ..row.job }
    }

    /// A plate now, with its queue as last counted.
    pub fn plate_now(&self, plate: &PlateHandle) -> Plate {
        let is_queued =
            |(name, state, _): &&(String, JobState, u64)| name == plate.name() && *state == JobState::Queued;
        let queued = self.counted.lock().jobs.iter().find(is_queued).map_or(0, |(.., count)| *count);
        Plate { queued, ..plate.snapshot() }
    }

    /// The plate's state after an operation on it.
    pub fn plate_after(&self, plate: &PlateHandle) -> Plate {
        self.count_jobs(Some(JobState::Queued));
        self.plate_now(plate)
    }

    /// Stores emergency stops already made in the audit log and reports their results. Waits briefly for motors and
    /// disks, for all plates at once.
    pub fn confirm_stops(&self, plates: &[Arc<PlateHandle>], caller: &Caller) -> Vec<EStopped> {
        let until = self.clock.elapsed() + CONFIRMED_WITHIN;
        let record = |plate: &Arc<PlateHandle>| plate.record_estop(audit_entry(caller.clone()));
        let recorded: Vec<Receiver<bool>> = plates.iter().map(record).collect();
        let confirm = |(plate, written): (&Arc<PlateHandle>, Receiver<bool>)| {
            let left = || until.saturating_sub(self.clock.elapsed());
            let times = plate.emergency_stop.interlock.wait_until_motors_off(left());
            let persisted = written.recv_timeout(left()).unwrap_or(false);
            // ends with the thread: the entry in the audit log is there, too
            written.recv_timeout(left()).ok();
            EStopped {
                plate: plate.name().to_owned(),
                silent: times.is_some(),
                persisted,
                requested_at_s: times.map(|times| times.requested_at.secs()),
                silent_at_s: times.map(|times| times.motors_off_at.secs()),
                wall_s: times.map(|times| times.wall.as_secs_f64()),
            }
        };
        plates.iter().zip(recorded).map(confirm).collect()
    }

    /// Counts jobs, or those in one state; when the store fails, the previous numbers remain.
    pub fn count_jobs(&self, of: Option<JobState>) {
        if let Ok(counts) = self.store.counts(of) {
            let jobs = &mut self.counted.lock().jobs;
            jobs.retain(|(_, state, _)| of.is_some_and(|of| *state != of));
            jobs.extend(counts);
        }
    }

    /// Counts queued jobs and the free space, and `all` jobs, which takes as long as there are many; sees whether a
    /// store that failed can be written again, and writes stops and pauses that could not be written. Waits for the
    /// disk.
    pub fn count(&self, all: bool) {
        self.store.retry();
        self.plates.persist_again();
        self.count_jobs((!all).then_some(JobState::Queued));
        let free_bytes = free_bytes(self.store.runs()).ok();
        let mut counted = self.counted.lock();
        (counted.at, counted.free_bytes) = (self.clock.elapsed(), free_bytes);
    }

    /// The daemon now. Never blocks: data from the store is as of the last count.
    pub fn observed(&self) -> Observed {
        let counted = self.counted.lock().clone();
        let now = self.clock.elapsed();
        Observed {
            version: self.version,
            uptime: now,
            is_stopping: self.ending.is_cancelled(),
            plates_alive: self.plates.alive(),
            plates: self.plates.iter().map(|plate| self.plate_now(plate)).collect(),
            store_silence: now.saturating_sub(counted.at),
            counted,
            store_fault: self.store.fault(),
            min_free_bytes: self.spec.min_free_bytes,
            runs_bytes: self.store.runs_bytes(),
            event_streams: EVENT_STREAMS - self.event_streams.available_permits(),
        }
    }
}

/// The part of an audit entry that the network tells.
pub(super) fn audit_entry(caller: Caller) -> AuditEntry {
    let remote = caller.remote.map(|address| address.to_string()).unwrap_or_default();
    AuditEntry { remote, token_name: caller.name, ..AuditEntry::default() }
}

pub(super) fn unknown(detail: &str) -> Problem {
    Problem::new(StatusCode::NOT_FOUND, detail)
}

pub(super) fn no_job() -> Problem {
    unknown("there is no such job")
}

pub(super) fn conflict(detail: impl Into<String>) -> Problem {
    Problem::new(StatusCode::CONFLICT, detail)
}

pub(super) fn unheard() -> Problem {
    Problem::busy("its client no longer waits", 1)
}

impl From<StoreError> for Problem {
    fn from(fault: StoreError) -> Self {
        match fault {
            StoreError::Full => Self::new(StatusCode::INSUFFICIENT_STORAGE, fault.to_string()),
            StoreError::Closed => Self::busy(fault.to_string(), 1),
            StoreError::Io(_) | StoreError::Corrupt(_) | StoreError::Other { .. } => {
                tracing::error!("{fault}");
                Self::new(StatusCode::INTERNAL_SERVER_ERROR, "the job store cannot be read or written")
            }
        }
    }
}

impl From<ResetError> for Problem {
    fn from(fault: ResetError) -> Self {
        match fault {
            ResetError::NotPersisted(fault) => fault.into(),
            fault => conflict(fault.to_string()),
        }
    }
}
