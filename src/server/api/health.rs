//! Health and readiness of the daemon: reason codes for programs and sentences for people, derived from [`Observed`]
//! alone.

use std::time::Duration;

use crate::http::{Reason, ReasonCode};
use crate::store::{JobState, StoreError, low_disk};
use crate::supervisor::{Plate, PlateState};

/// Longest silence of a healthy store: it is read twice a second.
const LONGEST_SILENCE: Duration = Duration::from_secs(5);

/// The daemon at one moment: the source of metrics and readiness. Taken without blocking.
#[derive(Clone, Debug)]
pub(crate) struct Observed {
    pub version: &'static str,
    /// Time since the daemon started.
    pub uptime: Duration,
    /// True once the daemon is shutting down.
    pub is_stopping: bool,
    /// `Err` names the plate threads that have died or hang.
    pub plates_alive: Result<(), String>,
    /// The plates, in the order of the configuration.
    pub plates: Vec<Plate>,
    /// Counts of jobs and free space, the last ones.
    pub counted: Counted,
    /// Time since the store was last read.
    pub store_silence: Duration,
    /// Fault of the store's last write; `None` when it succeeded.
    pub store_fault: Option<StoreError>,
    /// Fewest free bytes with which jobs are accepted.
    pub min_free_bytes: u64,
    /// Bytes in run folders of ended jobs.
    pub runs_bytes: u64,
    /// Number of open event streams.
    pub event_streams: usize,
}

/// Numbers of jobs and free space at the last count.
#[derive(Clone, Debug, Default)]
pub(crate) struct Counted {
    pub at: Duration,
    /// Jobs of each plate in each state.
    pub jobs: Vec<(String, JobState, u64)>,
    /// Free bytes on the disk of the run folders; `None` when unknown.
    pub free_bytes: Option<u64>,
}

/// Reasons why the daemon does not work at all; empty when it is healthy.
pub(crate) fn liveness_failures(observed: &Observed) -> Vec<Reason> {
    let mut failures = Vec::new();
    if observed.store_silence > LONGEST_SILENCE {
        let detail = format!("the job store has not responded for {:.1} s", observed.store_silence.as_secs_f64());
        failures.push(Reason::new(ReasonCode::StoreHangs, detail));
    }
    let dead = observed.plates_alive.as_ref().err();
    failures.extend(dead.map(|dead| Reason::new(ReasonCode::PlatesDead, dead.clone())));
    failures
}

/// Reasons why it takes no jobs; empty when it is ready.
pub(super) fn readiness_failures(observed: &Observed) -> Vec<Reason> {
    let mut failures = liveness_failures(observed);
    if observed.is_stopping {
        failures.push(Reason::new(ReasonCode::Ending, "the daemon is ending"));
    }
    let fault = observed.store_fault.as_ref();
    failures.extend(fault.map(|fault| Reason::new(ReasonCode::StoreUnwritable, fault.to_string())));
    let low = low_disk(observed.counted.free_bytes, observed.min_free_bytes);
    failures.extend(low.map(|low| Reason::new(ReasonCode::DiskLow, low)));
    if observed.plates.iter().all(|plate| plate.state == PlateState::Stopped) {
        failures.push(Reason::new(ReasonCode::AllStopped, "an emergency stop holds on every plate"));
    }
    failures
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::supervisor::Observation;
    use upm_recording::RecordingState;

    impl Observed {
        /// Two healthy plates: one runs a job, one is idle.
        pub(in crate::api) fn healthy() -> Self {
            let plate = |name: &str, state: PlateState| Plate {
                name: name.to_owned(),
                state,
                queued: 2,
                side_mm: 200.0,
                deadline_misses: 3,
                behind_s: 1.5,
                estops: 1,
                ..Plate::default()
            };
            let left = Plate {
                age_s: Some(0.015),
                job: Some(String::new()),
                observation: Observation { progress: 0.25, ..Observation::default() },
                recording: Some(RecordingState::Writing { bytes: 4096 }),
                ..plate("left", PlateState::Running)
            };
            Self {
                version: "1.2.3",
                uptime: Duration::from_millis(61_500),
                is_stopping: false,
                plates_alive: Ok(()),
                plates: vec![left, plate("right", PlateState::Idle)],
                counted: Counted {
                    at: Duration::from_millis(61_250),
                    jobs: vec![("left".to_owned(), JobState::Completed, 7), ("gone".to_owned(), JobState::Failed, 1)],
                    free_bytes: Some(5_000_000_000),
                },
                store_silence: Duration::from_millis(250),
                store_fault: None,
                min_free_bytes: 500_000_000,
                runs_bytes: 123,
                event_streams: 5,
            }
        }
    }

    fn failures(change: impl FnOnce(&mut Observed)) -> (Vec<String>, Vec<String>) {
        let mut observed = Observed::healthy();
        change(&mut observed);
        let details = |reasons: Vec<Reason>| reasons.into_iter().map(|reason| reason.detail).collect();
        (details(liveness_failures(&observed)), details(readiness_failures(&observed)))
    }

    fn both(change: impl FnOnce(&mut Observed), detail: &str) {
        assert_eq!(failures(change), (vec![detail.to_owned()], vec![detail.to_owned()]));
    }

    fn unready(change: impl FnOnce(&mut Observed), detail: &str) {
        assert_eq!(failures(change), (Vec::new(), vec![detail.to_owned()]));
    }

    #[test]
    fn healthy_daemon_reports_no_failures() {
        assert_eq!(failures(|_| ()), (Vec::new(), Vec::new()));
    }

    #[test]
    fn hung_store_or_dead_worker_fails_liveness() {
        assert_eq!(failures(|o| o.store_silence = LONGEST_SILENCE).0, [""; 0]);
        both(|o| o.store_silence = Duration::from_millis(5100), "the job store has not responded for 5.1 s");
        let dead = || Err("the worker of plate right has died".to_owned());
        both(|o| o.plates_alive = dead(), "the worker of plate right has died");
    }

    #[test]
    fn conditions_that_bar_new_jobs_fail_readiness_only() {
        unready(|o| o.is_stopping = true, "the daemon is ending");
        unready(|o| o.store_fault = Some(StoreError::Full), "the disk of the job store is full");
        let full = "the disk has 500.0 MB left, jobs are taken from 500.0 MB on (`disk.min_free_mb`)";
        unready(|o| o.counted.free_bytes = Some(499_999_999), full);
        assert_eq!(failures(|o| o.counted.free_bytes = Some(500_000_000)).1, [""; 0]);
        assert_eq!(failures(|o| o.counted.free_bytes = None).1, [""; 0]);
    }

    #[test]
    fn one_plate_that_may_move_is_enough() {
        assert_eq!(failures(|o| o.plates[0].state = PlateState::Stopped).1, [""; 0]);
        let stop_all = |o: &mut Observed| o.plates.iter_mut().for_each(|plate| plate.state = PlateState::Stopped);
        unready(stop_all, "an emergency stop holds on every plate");
    }
}
