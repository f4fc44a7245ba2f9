//! Watches that the data folder and its files are the ones that the daemon holds open. What is written to deleted files
//! is lost at the next start, and none of the writes fails.

use std::io;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread;
use std::time::Duration;

use parking_lot::Mutex;

use super::desk::Office;
use crate::plates::Pause;
use crate::service::{Reason, ReasonCode, Refusal};
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

    /// Notes what was found; says it when that changes.
    fn note(&self, found: Option<Displaced>) {
        let mut last = self.found.lock();
        match (&*last, &found) {
            (None, Some(displaced)) => tracing::error!("{displaced}: no job is taken, all plates are paused"),
            (Some(_), None) => tracing::warn!("the data folder holds the daemon's files again"),
            _ => {}
        }
        *last = found;
    }
}

/// A displaced path as a reason.
pub(super) fn reason(displaced: &Displaced) -> Reason {
    Reason::new(ReasonCode::DataDisplaced, displaced.to_string())
}

impl Office {
    /// Compares once, and pauses all plates while a path is displaced. Waits for the disk.
    pub fn check_paths(&self) {
        let _alone = self.data.comparing.lock();
        let found = self.store.check_paths().and_then(|()| self.plates.check_paths()).err();
        if found.is_some() {
            let why = "the data folder or a file in it was deleted or replaced: see to it, then resume";
            self.plates.pause_all(&Pause::new("data_displaced", why, "restore the data folder, then resume"));
        }
        self.data.note(found);
    }

    /// Refuses what would be lost with displaced data.
    pub fn intact(&self) -> Result<(), Refusal> {
        self.data.displaced().map_or(Ok(()), |displaced| Err(Refusal::Unwell(reason(&displaced))))
    }
}

/// Compares once a second until the daemon ends: on a thread of its own, since a dead disk holds up whoever asks it.
pub(super) fn watch(office: &Arc<Office>) -> io::Result<()> {
    let office = Arc::downgrade(office);
    thread::Builder::new().name("data-watch".into()).spawn(move || {
        step_back();
        while let Some(office) = office.upgrade().filter(|office| !office.ending.load(Ordering::SeqCst)) {
            office.check_paths();
            drop(office);
            thread::sleep(EVERY);
        }
    })?;
    Ok(())
}
