use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use super::pacing::PacingStats;
use upm_control::{Ending, EventLevel, Finish, Sink, is_stop};
use upm_core::rig::{Interlock, RigFault};
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
    pub pacing: &'a Arc<PacingStats>,
    /// Who stopped the run and why, asked once it was stopped.
    pub cause: &'a dyn Fn() -> Option<String>,
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
        if let Some(cause) = (self.cause)() {
            finish.ending.reason = cause;
        }
        if finish.ending.reason != by_control {
            let level = if trip.is_some() { EventLevel::Error } else { EventLevel::Info };
            sink.event(at, level, &finish.ending.reason);
        }
    }
}
