//! Health and readiness of the daemon: reason codes for programs and sentences for people, derived from [`Observed`]
//! alone.

use std::time::Duration;

use super::status::Observed;
use crate::http::{Reason, ReasonCode};
use crate::supervisor::PlateState;

/// Longest silence of a healthy store: it is read twice a second.
const LONGEST_SILENCE: Duration = Duration::from_secs(5);

/// Reasons why the daemon does not work at all; empty when it is healthy.
pub(super) fn liveness_failures(observed: &Observed) -> Vec<Reason> {
    let mut failures = Vec::new();
    if observed.store.heartbeat > LONGEST_SILENCE {
        let silent_s = observed.store.heartbeat.as_secs_f64();
        failures
            .push(Reason::new(ReasonCode::StoreHangs, format!("the job store has not responded for {silent_s:.1} s")));
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
    let fault = observed.store.fault.as_ref();
    failures.extend(fault.map(|fault| Reason::new(ReasonCode::StoreUnwritable, fault.to_string())));
    failures.extend(low_disk(observed).map(|low| Reason::new(ReasonCode::DiskLow, low)));
    if observed.plates.iter().all(|plate| plate.state == PlateState::Stopped) {
        failures.push(Reason::new(ReasonCode::AllStopped, "an emergency stop holds on every plate"));
    }
    failures
}

fn low_disk(observed: &Observed) -> Option<String> {
    let min_free_bytes = observed.store.min_free_bytes;
    let free_bytes = observed.store.free_bytes.filter(|free_bytes| *free_bytes < min_free_bytes)?;
    let [free_mb, min_free_mb] = [free_bytes, min_free_bytes].map(|bytes| bytes as f64 * 1e-6);
    Some(format!("the disk has {free_mb:.1} MB left, jobs are taken from {min_free_mb:.1} MB on"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::StoreFault;

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
        assert_eq!(failures(|o| o.store.heartbeat = LONGEST_SILENCE).0, [""; 0]);
        both(|o| o.store.heartbeat = Duration::from_millis(5100), "the job store has not responded for 5.1 s");
        let dead = || Err("the worker of plate right has died".to_owned());
        both(|o| o.plates_alive = dead(), "the worker of plate right has died");
    }

    #[test]
    fn conditions_that_bar_new_jobs_fail_readiness_only() {
        unready(|o| o.is_stopping = true, "the daemon is ending");
        unready(|o| o.store.fault = Some(StoreFault::Full), "the disk of the job store is full");
        let full = "the disk has 500.0 MB left, jobs are taken from 500.0 MB on";
        unready(|o| o.store.free_bytes = Some(499_999_999), full);
        assert_eq!(failures(|o| o.store.free_bytes = Some(500_000_000)).1, [""; 0]);
        assert_eq!(failures(|o| o.store.free_bytes = None).1, [""; 0]);
    }

    #[test]
    fn one_plate_that_may_move_is_enough() {
        assert_eq!(failures(|o| o.plates[0].state = PlateState::Stopped).1, [""; 0]);
        let stop_all = |o: &mut Observed| o.plates.iter_mut().for_each(|plate| plate.state = PlateState::Stopped);
        unready(stop_all, "an emergency stop holds on every plate");
    }

    #[test]
    fn every_reason_is_reported() {
        let (dead, unready) = failures(|o| {
            o.store.heartbeat = Duration::from_secs(9);
            o.plates_alive = Err("the worker of plate left has died".to_owned());
            o.is_stopping = true;
        });
        assert_eq!((dead.len(), unready.len()), (2, 3));
        assert!(unready.starts_with(&dead));
    }
}
