use std::sync::atomic::{AtomicBool, Ordering};

use upm_core::job::{Finding, Outcome, StopCause, StopRequest};
use upm_core::rig::{RigError, Trip};

/// A value to go on with, or the ending of the run.
pub(super) type OrEnd<T = ()> = Result<T, RunEnd>;

/// Outcome, cause and reason of the end of a run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RunEnd {
    /// Completed, failed or cancelled.
    pub outcome: Outcome,
    /// Its cause; `None` where the outcome says it all.
    pub cause: Option<StopCause>,
    /// The reason, one line for people.
    pub reason: String,
}

impl RunEnd {
    /// The goal was reached.
    pub fn completed(reason: impl Into<String>) -> Self {
        Self { outcome: Outcome::Completed, reason: reason.into(), ..Self::default() }
    }

    /// The goal is out of reach.
    pub fn failed(reason: impl Into<String>) -> Self {
        Self { outcome: Outcome::Failed, reason: reason.into(), ..Self::default() }
    }

    /// The goal is out of reach for a cause with a code; `reason` is followed by the remedy.
    pub fn failed_because(cause: impl Into<StopCause>, reason: impl std::fmt::Display) -> Self {
        let cause = cause.into();
        let reason = cause.remedy().map_or_else(|| reason.to_string(), |remedy| format!("{reason}; {remedy}"));
        Self { cause: Some(cause), ..Self::failed(reason) }
    }

    /// Stopped from outside.
    pub fn cancelled(cause: impl Into<StopCause>, reason: impl Into<String>) -> Self {
        Self { outcome: Outcome::Cancelled, cause: Some(cause.into()), reason: reason.into() }
    }

    /// The flag that ends a run was set.
    pub fn stopped() -> Self {
        Self::cancelled(StopRequest::Stopped, "stopped from outside, motors at zero")
    }

    /// Ended between two cycles to make room for another run. A task without an end that makes progress is `completed`
    /// then; any other has not reached its goal.
    pub fn gave_way(completed: bool) -> Self {
        let outcome = if completed { Outcome::Completed } else { Outcome::Cancelled };
        Self { outcome, ..Self::cancelled(StopRequest::GaveWay, "gave way to another job") }
    }

    /// True when the run was ended from outside.
    pub fn is_external(&self) -> bool {
        self.cause.is_some_and(StopCause::is_external)
    }
}

impl From<RigError> for RunEnd {
    fn from(fault: RigError) -> Self {
        let reason = format!("the rig stopped: {fault}");
        match fault {
            RigError::Stopped(trip @ (Trip::EStop | Trip::Shutdown)) => Self::cancelled(trip, reason),
            RigError::Stopped(trip) => Self { cause: Some(trip.into()), ..Self::failed(reason) },
            _ => Self::failed_because(Finding::DeviceFault, reason),
        }
    }
}

/// True for a run that was ended from outside.
pub(super) fn is_stopped<T>(done: &OrEnd<T>) -> bool {
    matches!(done, Err(ending) if ending.is_external())
}

/// Ends the run once `stop` is set.
pub(super) fn check_stop(stop: &AtomicBool) -> OrEnd {
    if stop.load(Ordering::Relaxed) { Err(RunEnd::stopped()) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outcome_of_a_stopped_run_follows_from_the_trip() {
        for (trip, outcome) in [
            (Trip::EStop, Outcome::Cancelled),
            (Trip::Shutdown, Outcome::Cancelled),
            (Trip::Lease, Outcome::Failed),
            (Trip::Watchdog, Outcome::Failed),
        ] {
            let ending = RunEnd::from(RigError::Stopped(trip));
            assert_eq!((ending.outcome, ending.is_external()), (outcome, true), "{trip:?}");
        }
        assert!(RunEnd::stopped().is_external() && RunEnd::gave_way(true).is_external());
        let broken = RunEnd::from(RigError::Device("no camera".into()));
        assert_eq!((broken.outcome, broken.is_external()), (Outcome::Failed, false));
        assert!(!RunEnd::completed("all in place").is_external());
    }
}
