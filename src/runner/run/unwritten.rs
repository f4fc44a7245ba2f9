use std::sync::atomic::{AtomicBool, Ordering};

use upm_control::{EventLevel, Sink};
use upm_core::time::PlateTime;
use upm_recording::ScribeWatch;

/// Stops a run whose journal can no longer be written: nothing moves of which nothing is kept.
pub(super) struct Unwritten<'a> {
    pub journal: &'a ScribeWatch,
    pub stop: &'a AtomicBool,
    /// True once it has been told.
    pub told: bool,
}

impl Unwritten<'_> {
    /// Looks at the journal; says it to `sinks`, once, when it has failed.
    pub fn check(&mut self, sinks: &mut dyn Sink, at: PlateTime) {
        if let (Some(fault), false) = (self.journal.fault(), self.told) {
            self.told = true;
            self.stop.store(true, Ordering::SeqCst);
            sinks.event(at, EventLevel::Error, &format!("the journal cannot be written: {fault}"));
        }
    }
}
