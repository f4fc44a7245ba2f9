use std::time::Duration;

use crate::store::{JobState, StoreFault};
use crate::supervisor::PlateState;
use upm_recording::RecordingState;

/// The daemon at one moment: the source of metrics and readiness. Taken without blocking.
#[derive(Clone, Debug)]
pub(super) struct Observed {
    pub version: &'static str,
    /// Time since the daemon started.
    pub uptime: Duration,
    /// True once the daemon is shutting down.
    pub is_stopping: bool,
    /// `Err` names the plate threads that have died or hang.
    pub plates_alive: Result<(), String>,
    /// The plates, in the order of the configuration.
    pub plates: Vec<PlateObserved>,
    /// Number of jobs of each plate in each state, as last counted.
    pub jobs: Vec<(String, JobState, u64)>,
    pub store: StoreObserved,
    /// Number of open event streams.
    pub event_streams: usize,
}

/// A plate at one moment.
#[derive(Clone, Debug)]
pub(super) struct PlateObserved {
    pub name: String,
    pub state: PlateState,
    /// Jobs that wait for it.
    pub queued: u64,
    /// Deadlines missed since the daemon started.
    pub deadline_misses: u64,
    /// How far plate time fell behind the clock in its present or last run.
    pub behind: Duration,
    /// Emergency stops since the daemon started.
    pub estops: u64,
    /// Time since its newest frame; `None` before the first.
    pub frame_age: Option<Duration>,
    /// Share of its job that is done, 0 to 1; `None` without a job.
    pub progress: Option<f64>,
    /// The recording of its job.
    pub recording: RecordingState,
}

/// The job store and its disk.
#[derive(Clone, Debug, Default)]
pub(super) struct StoreObserved {
    /// Time since the store was last read.
    pub heartbeat: Duration,
    /// Fault of the last write; `None` when it succeeded.
    pub fault: Option<StoreFault>,
    /// Free bytes on the disk of the run folders; `None` when unknown.
    pub free_bytes: Option<u64>,
    /// Fewest free bytes with which jobs are accepted.
    pub min_free_bytes: u64,
    /// Bytes in run folders of ended jobs.
    pub runs_bytes: u64,
}

#[cfg(test)]
impl Observed {
    /// Two healthy plates: one runs a job, one is idle.
    pub fn healthy() -> Self {
        let plate = |name: &str, state| PlateObserved {
            name: name.to_owned(),
            state,
            queued: 2,
            deadline_misses: 3,
            behind: Duration::from_millis(1500),
            estops: 1,
            frame_age: None,
            progress: None,
            recording: RecordingState::Off,
        };
        let left = PlateObserved {
            frame_age: Some(Duration::from_millis(15)),
            progress: Some(0.25),
            recording: RecordingState::Writing { bytes: 4096 },
            ..plate("left", PlateState::Running)
        };
        Self {
            version: "1.2.3",
            uptime: Duration::from_millis(61_500),
            is_stopping: false,
            plates_alive: Ok(()),
            plates: vec![left, plate("right", PlateState::Idle)],
            jobs: vec![("left".to_owned(), JobState::Completed, 7), ("gone".to_owned(), JobState::Failed, 1)],
            store: StoreObserved {
                heartbeat: Duration::from_millis(250),
                fault: None,
                free_bytes: Some(5_000_000_000),
                min_free_bytes: 500_000_000,
                runs_bytes: 123,
            },
            event_streams: 5,
        }
    }
}
