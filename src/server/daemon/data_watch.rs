//! Watches that the data folder and its files are the ones that the daemon holds open. What is written to deleted files
//! is lost at the next start, and none of the writes fails.

use std::io;
use std::thread;
use std::time::Duration;

use parking_lot::Mutex;

use crate::service::{Reason, ReasonCode};
use crate::store::Displaced;
use upm_core::priority::step_back;

/// Time between two comparisons.
const EVERY: Duration = Duration::from_secs(1);

/// What the last comparison found.
#[derive(Debug, Default)]
pub(super) struct DataWatch {
    found: Mutex<Option<Displaced>>,
    /// Held during a comparison: what one finds never goes over what a later one found.
    comparing: Mutex<()>,
}

impl DataWatch {
    /// The path that is displaced, if one is.
    pub fn displaced(&self) -> Option<Displaced> {
        self.found.lock().clone()
    }

    /// Compares, and notes what was found; logs it when that changes. True when a path is displaced.
    pub fn compare(&self, compare: impl FnOnce() -> Result<(), Displaced>) -> bool {
        let _alone = self.comparing.lock();
        let found = compare().err();
        let mut last = self.found.lock();
        match (&*last, &found) {
            (None, Some(displaced)) => tracing::error!("{displaced}: no job is taken, all plates are paused"),
            (Some(_), None) => tracing::warn!("the data folder holds the daemon's files again"),
            _ => {}
        }
        *last = found;
        last.is_some()
    }
}

/// A displaced path as a reason.
pub(super) fn reason(displaced: &Displaced) -> Reason {
    Reason::new(ReasonCode::DataDisplaced, displaced.to_string())
}

/// Calls `compare` once a second until it answers false: on its own thread, since a dead disk holds up its caller.
pub(super) fn watch(mut compare: impl FnMut() -> bool + Send + 'static) -> io::Result<()> {
    thread::Builder::new().name("data-watch".into()).spawn(move || {
        step_back();
        while compare() {
            thread::sleep(EVERY);
        }
    })?;
    Ok(())
}
