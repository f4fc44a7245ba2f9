use std::sync::atomic::AtomicBool;

use super::pacing::PacingStats;
use upm_control::{EndCause, Ending, EventLevel, Finish, Sink, is_stop};
use upm_core::rig::{Interlock, RigFault, Trip};
use upm_core::time::PlateTime;

/// What reaches into a run from outside while it goes on.
#[derive(Clone, Copy)]
pub struct Links<'a> {
    /// Set to stop after the next frame.
    pub stop: &'a AtomicBool,
    /// Set to end between two cycles, with motors at zero and parts at rest.
    pub give_way: &'a AtomicBool,
    /// Cuts the motors at once. The run fits it to its rig, and the rig is gone when the run returns.
    pub interlock: &'a Interlock,
    /// Told of deadlines that are missed.
    pub pacing: &'a PacingStats,
    /// Who stopped the run and why, asked once it was stopped.
    pub cause: &'a dyn Fn() -> Option<StopCause>,
}

/// Why a run was stopped from outside.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StopCause {
    /// For programs.
    pub cause: EndCause,
    /// The same for people, one line.
    pub reason: String,
}

impl StopCause {
    /// A cause whose `reason` is followed by the remedy, if there is one.
    pub fn of(cause: EndCause, reason: String) -> Self {
        Self { cause, reason: Ending::failed_because(cause, reason).reason }
    }

    /// What a run that was too late for its plate adds to its reason, and what would help; `real_time` for one that kept
    /// to the clock.
    pub fn too_busy(real_time: bool) -> &'static str {
        if real_time {
            "this computer was too busy: `--pace max` would do, or `\"deadlines\": \"relaxed\"` in the job"
        } else {
            "this computer was too busy: `\"deadlines\": \"relaxed\"` in the job would do"
        }
    }
}

impl From<&str> for StopCause {
    /// A cause that programs need not tell apart.
    fn from(reason: &str) -> Self {
        Self { cause: EndCause::Run, reason: reason.to_owned() }
    }
}

impl Links<'_> {
    /// Says of a run that was stopped what stopped it: in an event, and in its ending. Others are left as they are.
    pub(super) fn explain(&self, finish: &mut Finish, sink: &mut dyn Sink, at: PlateTime) {
        if !is_stop(&finish.ending.reason) {
            return;
        }
        let by_control = finish.ending.reason.clone();
        let trip = self.interlock.tripped();
        if let Some(trip) = trip {
            finish.ending = Ending::from(RigFault::Stopped(trip));
        }
        // only a plate in real time passes the time in which nobody drives it
        if trip == Some(Trip::Lease) {
            finish.ending.cause = EndCause::DeadlineMissed;
            finish.ending.reason = format!("{}; {}", finish.ending.reason, StopCause::too_busy(true));
        }
        if let Some(StopCause { cause, reason }) = (self.cause)() {
            (finish.ending.cause, finish.ending.reason) = (cause, reason);
        }
        if finish.ending.reason != by_control {
            let level = if trip.is_some() { EventLevel::Error } else { EventLevel::Info };
            sink.event(at, level, &finish.ending.reason);
        }
    }
}
