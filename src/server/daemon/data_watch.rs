//! Checks that the paths of the data folder and its files still name the ones that the daemon holds open. Writes to
//! deleted files succeed, but their data is lost at the next start.

use std::io;
use std::thread;
use std::time::Duration;

use parking_lot::Mutex;

use crate::http::{Reason, ReasonCode};
use crate::store::DisplacedFile;
use upm_core::thread_priority::lower_thread_priority;

/// Time between two comparisons.
const EVERY: Duration = Duration::from_secs(1);

/// Result of the last comparison.
#[derive(Debug, Default)]
pub(super) struct DataWatch {
    found: Mutex<Option<DisplacedFile>>,
    /// Held during a comparison, so that an older result never overwrites a newer one.
    comparing: Mutex<()>,
}

impl DataWatch {
    /// The displaced path; `None` while all are in place.
    pub fn displaced(&self) -> Option<DisplacedFile> {
        self.found.lock().clone()
    }

    /// Compares and stores the result, and logs a change of it. True when a path is displaced.
    pub fn compare(&self, compare: impl FnOnce() -> Result<(), DisplacedFile>) -> bool {
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

/// The reason code and sentence for a displaced path.
pub(super) fn reason(displaced: &DisplacedFile) -> Reason {
    Reason::new(ReasonCode::DataDisplaced, displaced.to_string())
}

/// Calls `compare` once a second until it returns false. Runs on its own thread, since a hung disk blocks the caller.
pub(super) fn watch(mut compare: impl FnMut() -> bool + Send + 'static) -> io::Result<()> {
    thread::Builder::new().name("data-watch".into()).spawn(move || {
        lower_thread_priority();
        while compare() {
            thread::sleep(EVERY);
        }
    })?;
    Ok(())
}
