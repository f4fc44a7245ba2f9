use std::fmt;
use std::sync::atomic::AtomicBool;

use super::paced::PacingStats;
use upm_control::{EventFacts, EventKind, EventLevel, FinalState, RunEnd, Sink};
use upm_core::job::{Finding, StopCause, StopRequest};
use upm_core::rig::{Interlock, RigError, Trip};
use upm_core::time::PlateTime;

/// Text added to the reason of a run that was too late for its plate, with the remedy.
pub(super) const TOO_BUSY: &str =
    "this computer was too busy: `--pace max` would do, or `\"deadlines\": \"relaxed\"` in the job";

/// Controls through which the caller observes and stops a run.
#[derive(Clone, Copy)]
pub struct RunControls<'a> {
    /// Set to stop after the next frame.
    pub stop: &'a AtomicBool,
    /// Set to end between two cycles, with motors at zero and parts at rest.
    pub give_way: &'a AtomicBool,
    /// Cuts the motors at once. The run connects it to its rig, which is dropped when the run returns.
    pub interlock: &'a Interlock,
    /// Statistics of missed deadlines, updated by the run.
    pub pacing: &'a PacingStats,
    /// Cause of a stop from outside; called once the run was stopped.
    pub cause: &'a dyn Fn() -> Option<ExternalStop>,
}

/// Cause of a stop from outside.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExternalStop {
    /// Machine-readable cause.
    pub cause: StopCause,
    /// Explanation on one line.
    pub reason: String,
}

impl ExternalStop {
    /// A stop by `cause` with `reason`, followed by the remedy if there is one.
    pub fn of(cause: impl Into<StopCause>, reason: impl fmt::Display) -> Self {
        let cause = cause.into();
        Self { cause, reason: RunEnd::failed_because(cause, reason).reason }
    }

    /// Interruption by the operator at the program.
    pub(super) fn by_operator() -> Self {
        Self { cause: StopCause::Asked(StopRequest::Interrupted), reason: RunEnd::stopped().reason }
    }
}

impl RunControls<'_> {
    /// Reports the cause of a stop in an event and in the ending. Runs that were not stopped are left unchanged.
    pub(super) fn explain(&self, finish: &mut FinalState, sink: &mut dyn Sink, at: PlateTime) {
        if !finish.ending.is_external() || finish.ending.cause == Some(StopCause::Asked(StopRequest::GaveWay)) {
            return;
        }
        let by_control = finish.ending.clone();
        let trip = self.interlock.tripped();
        if let Some(trip) = trip {
            finish.ending = RunEnd::from(RigError::Stopped(trip));
        }
        // plate time passes without a driver only in real time
        if trip == Some(Trip::Lease) {
            finish.ending.cause = Some(StopCause::Found(Finding::DeadlineMissed));
            finish.ending.reason = format!("{}; {TOO_BUSY}", finish.ending.reason);
        }
        if let Some(ExternalStop { cause, reason }) = (self.cause)() {
            (finish.ending.cause, finish.ending.reason) = (Some(cause), reason);
        }
        if finish.ending != by_control {
            let level = if trip.is_some() { EventLevel::Error } else { EventLevel::Info };
            let RunEnd { outcome, cause, reason } = finish.ending.clone();
            sink.event(&EventFacts { at, level, text: reason, kind: EventKind::RunEnded { outcome, cause } });
        }
    }
}
