use std::fmt;
use std::sync::atomic::AtomicBool;

use super::paced::PacingStats;
use upm_control::{Ending, EventLevel, Finish, Milestone, MilestoneFacts, Sink};
use upm_core::job::StopCause;
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
    pub cause: &'a dyn Fn() -> Option<ExternalStop>,
}

/// Why a run was stopped from outside.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExternalStop {
    /// For programs.
    pub cause: StopCause,
    /// The same for people, one line.
    pub reason: String,
}

impl ExternalStop {
    /// A stop by `cause`, whose `reason` is followed by the remedy, if there is one.
    pub fn of(cause: StopCause, reason: impl fmt::Display) -> Self {
        Self { cause, reason: Ending::failed_because(cause, reason).reason }
    }

    /// The person at the program interrupted it.
    pub(super) fn by_operator() -> Self {
        Self { cause: StopCause::Interrupted, reason: Ending::stopped().reason }
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

impl Links<'_> {
    /// Says of a run that was stopped what stopped it: in an event, and in its ending. Others are left as they are.
    pub(super) fn explain(&self, finish: &mut Finish, sink: &mut dyn Sink, at: PlateTime) {
        if !finish.ending.is_external() || finish.ending.cause == Some(StopCause::GaveWay) {
            return;
        }
        let by_control = finish.ending.clone();
        let trip = self.interlock.tripped();
        if let Some(trip) = trip {
            finish.ending = Ending::from(RigFault::Stopped(trip));
        }
        // only a plate in real time passes the time in which nobody drives it
        if trip == Some(Trip::Lease) {
            finish.ending.cause = Some(StopCause::DeadlineMissed);
            finish.ending.reason = format!("{}; {}", finish.ending.reason, ExternalStop::too_busy(true));
        }
        if let Some(ExternalStop { cause, reason }) = (self.cause)() {
            (finish.ending.cause, finish.ending.reason) = (Some(cause), reason);
        }
        if finish.ending != by_control {
            let level = if trip.is_some() { EventLevel::Error } else { EventLevel::Info };
            let Ending { outcome, cause, reason } = &finish.ending;
            let milestone = Milestone::RunEnded { outcome: *outcome, cause: *cause };
            sink.milestone(&MilestoneFacts { at, level, milestone, text: reason });
        }
    }
}
