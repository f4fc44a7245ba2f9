use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use parking_lot::Mutex;
use tokio::sync::Semaphore;

use super::convert;
use super::status::{Observed, PlateObserved, StoreObserved};
use crate::api::{EVENT_STREAMS, Job, Plate, Refusal};
use crate::store::{JobId, JobRow, JobState, Store};
use crate::supervisor::{PlateHandle, PlateSnapshot, PlateSupervisor};
use upm_core::files::free_bytes;
use upm_core::time::{Clock, MonotonicClock};
use upm_recording::RecordingState;
use upm_runner::config::DaemonSpec;

/// State from which the API is served.
#[derive(Debug)]
pub(super) struct DaemonState {
    pub spec: DaemonSpec,
    pub store: Arc<Store>,
    pub plates: Arc<PlateSupervisor>,
    pub clock: MonotonicClock,
    /// True once the daemon is shutting down.
    pub ending: AtomicBool,
    /// Jobs queued for each plate, as last counted.
    queued: Mutex<BTreeMap<String, u64>>,
    counted: Mutex<Counted>,
    /// Places for event streams.
    pub event_streams: Arc<Semaphore>,
    pub version: &'static str,
}

/// Numbers of jobs and free space at the last count.
#[derive(Clone, Debug)]
struct Counted {
    at: Duration,
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
        plates: Arc<PlateSupervisor>,
        clock: MonotonicClock,
        version: &'static str,
    ) -> Self {
        let counted = Mutex::new(Counted { at: clock.elapsed(), jobs: Vec::new(), free_bytes: None });
        let (ending, queued) = (AtomicBool::new(false), Mutex::default());
        let event_streams = Arc::new(Semaphore::new(EVENT_STREAMS));
        Self { spec, store, plates, clock, ending, queued, counted, event_streams, version }
    }

    pub fn plate(&self, name: &str) -> Result<&PlateHandle, Refusal> {
        self.plates.get(name).ok_or_else(|| Refusal::Unknown("there is no such plate".to_owned()))
    }

    pub fn row(&self, id: &JobId) -> Result<JobRow, Refusal> {
        self.store.job(id).map_err(convert::unread)?.ok_or_else(no_job)
    }

    /// A job in the API's form. The progress of one that runs is known to its plate alone.
    pub fn job(&self, row: &JobRow) -> Job {
        let mut job = convert::job(row);
        if row.state == JobState::Running
            && let Some(progress) = self.plates.get(&row.plate).and_then(|plate| plate.progress_of(&row.id))
        {
            job.progress = progress;
        }
        job
    }

    /// All plates now, with their queues as last counted.
    pub fn plate_statuses(&self) -> crate::api::Plates {
        let plates = self.plates.iter().map(|plate| self.plate_status(plate)).collect();
        crate::api::Plates { plates, stop_listen: self.spec.stop_listen.map(|address| address.to_string()) }
    }

    /// A plate now, with its queue as last counted.
    fn plate_status(&self, plate: &PlateHandle) -> Plate {
        convert::plate(&plate.snapshot(), self.queued_for(plate.name()))
    }

    fn queued_for(&self, plate: &str) -> u64 {
        self.queued.lock().get(plate).copied().unwrap_or(0)
    }

    /// The plate's state after an operation on it.
    pub fn plate_after(&self, name: &str) -> Result<Plate, Refusal> {
        self.count_queued();
        self.plate(name).map(|plate| self.plate_status(plate))
    }

    /// Counts queued jobs; when the store fails, the previous numbers remain.
    pub fn count_queued(&self) {
        if let Ok(queued) = self.store.queued() {
            *self.queued.lock() = queued.into_iter().collect();
        }
    }

    /// Counts queued jobs and the free space, with `all` every job, sees whether a store that failed can be written
    /// again, and writes stops and pauses that could not be written. Waits for the disk.
    pub fn count(&self, all: bool) {
        self.store.retry();
        self.plates.persist_again();
        self.count_queued();
        let jobs = all.then(|| self.store.counts());
        let free_bytes = free_bytes(self.store.runs()).ok();
        let mut counted = self.counted.lock();
        (counted.at, counted.free_bytes) = (self.clock.elapsed(), free_bytes);
        if let Some(Ok(jobs)) = jobs {
            counted.jobs = jobs;
        }
    }

    /// The daemon now. Never blocks: data from the store is as of the last count.
    pub fn observed(&self) -> Observed {
        let Counted { at, jobs, free_bytes } = self.counted.lock().clone();
        let plate = |plate: &PlateHandle| plate_observed(plate.snapshot(), self.queued_for(plate.name()));
        let now = self.clock.elapsed();
        Observed {
            version: self.version,
            uptime: now,
            is_stopping: self.ending.load(Ordering::SeqCst),
            plates_alive: self.plates.alive(),
            plates: self.plates.iter().map(plate).collect(),
            jobs,
            store: StoreObserved {
                heartbeat: now.saturating_sub(at),
                fault: self.store.fault(),
                free_bytes,
                min_free_bytes: self.spec.min_free_bytes,
                runs_bytes: self.store.runs_bytes(),
            },
            event_streams: EVENT_STREAMS - self.event_streams.available_permits(),
        }
    }
}

/// The id of a job in a request.
pub(super) fn job_id(text: &str) -> Result<JobId, Refusal> {
    JobId::parse(text).ok_or_else(no_job)
}

pub(super) fn no_job() -> Refusal {
    Refusal::Unknown("there is no such job".to_owned())
}

fn plate_observed(plate: PlateSnapshot, queued: u64) -> PlateObserved {
    let PlateSnapshot { name, state, job, observation, age, recording, deadline_misses, behind, estops, .. } = plate;
    PlateObserved {
        name,
        state,
        queued,
        deadline_misses,
        behind,
        estops,
        frame_age: age,
        progress: job.map(|_| observation.progress),
        recording: recording.unwrap_or(RecordingState::Off),
    }
}
