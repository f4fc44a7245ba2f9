use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use axum::http::StatusCode;
use parking_lot::Mutex;
use tokio::sync::Semaphore;

use super::health::Observed;
use super::types::EStopped;
use crate::http::{Caller, Problem};
use crate::store::{AuditEntry, Job, JobId, JobRow, JobState, Store, StoreFault};
use crate::supervisor::{Plate, PlateHandle, PlateSupervisor, ResetFault};
use upm_core::files::free_bytes;
use upm_core::time::{Clock, MonotonicClock};
use upm_runner::config::DaemonSpec;

/// Most event streams at once.
pub(crate) const EVENT_STREAMS: usize = 256;

/// State from which the API is served.
#[derive(Debug)]
pub(crate) struct DaemonState {
    pub spec: DaemonSpec,
    pub store: Arc<Store>,
    pub plates: PlateSupervisor,
    pub clock: MonotonicClock,
    /// True once the daemon is shutting down.
    pub ending: AtomicBool,
    counted: Mutex<Counted>,
    /// Places for event streams.
    pub event_streams: Arc<Semaphore>,
    pub version: &'static str,
}

/// Numbers of jobs and free space at the last count.
#[derive(Clone, Debug)]
struct Counted {
    at: Duration,
    /// Jobs queued for each plate.
    queued: Vec<(String, u64)>,
    /// Jobs of each plate in each state.
    jobs: Vec<(String, JobState, u64)>,
    /// Free bytes on the disk of the run folders; `None` when unknown.
    free_bytes: Option<u64>,
}

impl DaemonState {
    /// The state of a daemon that has just started.
    pub fn new(
        spec: DaemonSpec,
        store: Arc<Store>,
        plates: PlateSupervisor,
        clock: MonotonicClock,
        version: &'static str,
    ) -> Self {
        let counted =
            Mutex::new(Counted { at: clock.elapsed(), queued: Vec::new(), jobs: Vec::new(), free_bytes: None });
        let event_streams = Arc::new(Semaphore::new(EVENT_STREAMS));
        Self { spec, store, plates, clock, ending: AtomicBool::new(false), counted, event_streams, version }
    }

    pub fn plate(&self, name: &str) -> Result<&Arc<PlateHandle>, Problem> {
        self.plates.get(name).ok_or_else(|| unknown("there is no such plate"))
    }

    /// The plate that runs the job now; the refusal `idle` when none does.
    pub fn plate_under(&self, id: &JobId, idle: &str) -> Result<&Arc<PlateHandle>, Problem> {
        let plate = self.plates.get(&self.row(id)?.plate).filter(|plate| plate.job.is(id));
        plate.ok_or_else(|| unknown(idle))
    }

    pub fn row(&self, id: &JobId) -> Result<JobRow, Problem> {
        self.store.job(id)?.ok_or_else(no_job)
    }

    /// A job for a client. The progress of one that runs is known to its plate alone.
    pub fn seen(&self, row: JobRow) -> Job {
        let plate = self.plates.get(&row.plate).filter(|_| row.state == JobState::Running);
        let progress = plate.and_then(|plate| plate.progress_of(&row.id));
        Job { progress: progress.unwrap_or(row.progress), ..row.job }
    }

    /// A plate now, with its queue as last counted.
    pub fn plate_now(&self, plate: &PlateHandle) -> Plate {
        let counted = self.counted.lock();
        let queued = counted.queued.iter().find(|(name, _)| name == plate.name()).map_or(0, |(_, count)| *count);
        drop(counted);
        Plate { queued, ..plate.snapshot() }
    }

    /// The plate's state after an operation on it.
    pub fn plate_after(&self, plate: &PlateHandle) -> Plate {
        self.count_queued();
        self.plate_now(plate)
    }

    /// Stores an emergency stop already made in the audit log and reports its result.
    pub fn confirm_stop(&self, name: &str, caller: &Caller) -> Result<EStopped, Problem> {
        let plate = self.plate(name)?;
        plate.wait_until_motors_off();
        let persisted = plate.record_estop(audit_entry(caller.clone()));
        let times = plate.emergency_stop.interlock.stop_times();
        Ok(EStopped {
            plate: name.to_owned(),
            silent: times.is_some(),
            persisted,
            requested_at_s: times.map(|times| times.requested_at.secs()),
            silent_at_s: times.map(|times| times.motors_off_at.secs()),
            wall_s: times.map(|times| times.wall.as_secs_f64()),
        })
    }

    /// Counts queued jobs; when the store fails, the previous numbers remain.
    pub fn count_queued(&self) {
        if let Ok(queued) = self.store.queued() {
            self.counted.lock().queued = queued;
        }
    }

    /// Counts queued jobs and the free space, and `all` jobs, which takes as long as there are many; sees whether a
    /// store that failed can be written again, and writes stops and pauses that could not be written. Waits for the
    /// disk.
    pub fn count(&self, all: bool) {
        self.store.retry();
        self.plates.persist_again();
        self.count_queued();
        if let Some(jobs) = all.then(|| self.store.counts().ok()).flatten() {
            self.counted.lock().jobs = jobs;
        }
        let free_bytes = free_bytes(self.store.runs()).ok();
        let mut counted = self.counted.lock();
        (counted.at, counted.free_bytes) = (self.clock.elapsed(), free_bytes);
    }

    /// The daemon now. Never blocks: data from the store is as of the last count.
    pub fn observed(&self) -> Observed {
        let Counted { at, jobs, free_bytes, .. } = self.counted.lock().clone();
        let now = self.clock.elapsed();
        Observed {
            version: self.version,
            uptime: now,
            is_stopping: self.ending.load(Ordering::SeqCst),
            plates_alive: self.plates.alive(),
            plates: self.plates.iter().map(|plate| self.plate_now(plate)).collect(),
            jobs,
            store_silence: now.saturating_sub(at),
            store_fault: self.store.fault(),
            free_bytes,
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

impl From<StoreFault> for Problem {
    fn from(fault: StoreFault) -> Self {
        match fault {
            StoreFault::Full => Self::new(StatusCode::INSUFFICIENT_STORAGE, fault.to_string()),
            StoreFault::Closed => Self::busy(fault.to_string(), 1),
            StoreFault::Io(_) | StoreFault::Corrupt(_) | StoreFault::Other { .. } => {
                tracing::error!("{fault}");
                Self::new(StatusCode::INTERNAL_SERVER_ERROR, "the job store cannot be read or written")
            }
        }
    }
}

impl From<ResetFault> for Problem {
    fn from(fault: ResetFault) -> Self {
        match fault {
            ResetFault::NotPersisted(fault) => fault.into(),
            fault => conflict(fault.to_string()),
        }
    }
}
