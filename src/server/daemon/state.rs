use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use parking_lot::{Mutex, MutexGuard};
use serde_json::json;
use tokio::sync::Semaphore;

use super::convert;
use super::status::{DiskObserved, Observed, PlateObserved};
use crate::api::{EVENT_STREAMS, EventSender, Plate, Refusal, Responder, StreamEvent, StreamStart};
use crate::store::{JobId, JobRow, JobState, Store};
use crate::supervisor::{self, EventSubscriber, JobEvent, PlateSnapshot, PlateState, PlateSupervisor};
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
    /// Event distribution of each plate, to the clients that watch its jobs.
    pub relays: BTreeMap<String, Arc<EventRelay>>,
    /// Numbers of jobs at the last count.
    counted: Mutex<JobCounts>,
    /// Counts of requests and streams.
    /// A permit for each event stream that may be opened.
    pub event_streams: Arc<Semaphore>,
    /// Damage found in the store when it was opened.
    pub damage: StoreDamage,
    pub version: &'static str,
}

/// Numbers of jobs.
#[derive(Clone, Debug, Default)]
pub(super) struct JobCounts {
    /// Jobs queued for each plate.
    pub queued: BTreeMap<String, u64>,
    /// Jobs of each plate in each state.
    pub jobs: Vec<(String, JobState, u64)>,
}

impl DaemonState {
    /// The state of a daemon whose store was found with `damage`.
    pub fn new(
        spec: DaemonSpec,
        store: Arc<Store>,
        plates: Arc<PlateSupervisor>,
        clock: MonotonicClock,
        damage: Option<String>,
        version: &'static str,
    ) -> Self {
        let relays = plates.iter().map(|plate| {
            let relay = Arc::<EventRelay>::default();
            plate.subscribe(relay.clone());
            (plate.name().to_owned(), relay)
        });
        Self {
            relays: relays.collect(),
            spec,
            store,
            plates,
            clock,
            ending: AtomicBool::new(false),
            counted: Mutex::default(),
            event_streams: Arc::new(Semaphore::new(EVENT_STREAMS)),
            damage: StoreDamage::found(damage),
            version,
        }
    }

    pub fn plate(&self, name: &str) -> Result<&supervisor::PlateHandle, Refusal> {
        self.plates.get(name).ok_or_else(|| Refusal::Unknown("there is no such plate".to_owned()))
    }

    /// All plates now, with their queues as last counted.
    pub fn plate_statuses(&self) -> crate::api::Plates {
        let plates = self.plates.iter().map(|plate| self.plate_status(plate)).collect();
        crate::api::Plates { plates, stop_listen: self.spec.stop_listen.map(|address| address.to_string()) }
    }

    /// A plate now, with its queue as last counted.
    fn plate_status(&self, plate: &supervisor::PlateHandle) -> Plate {
        convert::plate(&plate.snapshot(), self.counted().queued.get(plate.name()).copied().unwrap_or(0))
    }

    /// Counts queued jobs, then calls `then`; when the store fails, with the previous numbers.
    pub fn count_queued(self: &Arc<Self>, then: impl FnOnce(&Self) + Send + 'static) {
        let state = Arc::clone(self);
        self.store.queued(move |counted| {
            if let Ok(counted) = counted {
                state.counted().queued = counted.into_iter().collect();
            }
            then(&state);
        });
    }

    /// Updates the last counts from the store; when that fails, the previous numbers remain.
    pub fn count_jobs(self: &Arc<Self>) {
        let state = Arc::clone(self);
        self.store.counts(move |counted| {
            if let Ok(counted) = counted {
                state.counted().jobs = counted;
            }
        });
    }

    pub fn counted(&self) -> MutexGuard<'_, JobCounts> {
        self.counted.lock()
    }

    /// Replies with the plate's state after an operation on it.
    pub fn answer_with(self: &Arc<Self>, name: &str, reply: Responder<Plate>) {
        let name = name.to_owned();
        self.count_queued(move |state| reply.send(state.plate(&name).map(|plate| state.plate_status(plate))));
    }

    /// The state of a job for a client that begins to watch it.
    pub fn stream_start(&self, row: &JobRow) -> StreamStart {
        let plate = self.plate(&row.plate).ok().map(|plate| self.plate_status(plate));
        let snapshot = json!({"job": convert::job(row), "plate": plate}).to_string();
        StreamStart { snapshot, newest: row.last_event, is_over: row.state.is_final() }
    }

    /// The daemon now. Never blocks: data from the store is as of the last count.
    pub fn observed(&self) -> Observed {
        let counted = self.counted().clone();
        let snapshots: Vec<PlateSnapshot> = self.plates.iter().map(|plate| plate.snapshot()).collect();
        let plates = snapshots.into_iter().map(|plate| {
            let queued = counted.queued.get(&plate.name).copied().unwrap_or(0);
            plate_observed(plate, queued)
        });
        Observed {
            version: self.version,
            uptime: self.clock.elapsed(),
            is_stopping: self.ending.load(Ordering::SeqCst),
            damage: self.unacknowledged_damage(),
            plates_alive: self.plates.alive(),
            plates: plates.collect(),
            jobs: counted.jobs,
            store: self.store.health(),
            disk: DiskObserved { min_free_bytes: self.spec.min_free_bytes, runs_bytes: self.store.runs_bytes() },
            event_streams: EVENT_STREAMS - self.event_streams.available_permits(),
        }
    }

    /// Damage found at start and not acknowledged yet, as a sentence.
    pub fn unacknowledged_damage(&self) -> Option<String> {
        let states: Vec<PlateState> = self.plates.iter().map(|plate| plate.snapshot().state).collect();
        self.damage.unacknowledged(&states)
    }
}

pub(super) fn no_job() -> Refusal {
    Refusal::Unknown("there is no such job".to_owned())
}

/// Damage found in the store when it was opened, as a sentence, until an operator acknowledges it.
#[derive(Debug)]
pub(super) struct StoreDamage(Mutex<Option<String>>);

impl StoreDamage {
    pub fn found(sentence: Option<String>) -> Self {
        Self(Mutex::new(sentence))
    }

    /// The damage, until acknowledged. After damage every plate is paused or stopped; resuming the last of them counts
    /// as acknowledgement. A later pause has another cause.
    fn unacknowledged(&self, states: &[PlateState]) -> Option<String> {
        let mut damage = self.0.lock();
        let may_any_move = states.iter().any(|state| *state != PlateState::Stopped);
        if may_any_move && !states.contains(&PlateState::Paused) {
            *damage = None;
        }
        damage.clone()
    }
}

/// Distributes the events of one plate to the clients that watch its jobs. An event is serialized once for all of them.
#[derive(Default)]
pub(super) struct EventRelay(Mutex<Vec<(JobId, EventSender)>>);

impl fmt::Debug for EventRelay {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("EventRelay").field(&self.senders().len()).finish()
    }
}

impl EventRelay {
    /// Offers all further events of `job` to `sender` until its client is gone.
    pub fn forward(&self, job: JobId, sender: EventSender) {
        let mut senders = self.senders();
        senders.retain(|(_, other)| !other.is_closed());
        senders.push((job, sender));
    }

    fn senders(&self) -> MutexGuard<'_, Vec<(JobId, EventSender)>> {
        self.0.lock()
    }
}

impl EventSubscriber for EventRelay {
    fn offer(&self, job_event: &JobEvent) {
        let mut senders = self.senders();
        if !senders.iter().any(|(job, _)| *job == job_event.job) {
            return;
        }
        let event = StreamEvent::new(job_event.seq, job_event.kind, &job_event.body);
        senders.retain(|(job, sender)| *job != job_event.job || sender.offer(&event));
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn acknowledged_damage_is_not_reported_again() {
        use PlateState::{Idle, Paused, Stopped};
        let damage = StoreDamage::found(Some("the job store was damaged".to_owned()));
        let states = [[Stopped, Stopped], [Paused, Stopped], [Idle, Paused], [Idle, Stopped], [Paused, Paused]];
        let is_unacknowledged = states.map(|states| damage.unacknowledged(&states).is_some());
        assert_eq!(is_unacknowledged, [true, true, true, false, false]);
        assert_eq!(StoreDamage::found(None).unacknowledged(&[Paused]), None);
    }
}
