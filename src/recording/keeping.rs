use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use super::scribe::ScribeMode;
use super::scribe_watch::ScribeWatch;
use super::switch::{OnFull, RecordingSwitch};
use upm_core::time::MonotonicClock;

/// How what is told of a run gets to the disk. It changes nothing in the run itself.
#[derive(Clone, Debug)]
pub struct Keeping {
    /// What the journal does when the disk lags.
    pub scribe: ScribeMode,
    /// Tells how the journal is getting on. One for each run.
    pub journal: ScribeWatch,
    /// What the recording does when it lags.
    pub on_full: OnFull,
    /// Tells how the recording is getting on, and stops it. One for each run.
    pub recording: RecordingSwitch,
    /// True for a run that has a clock to keep up with: the threads that write let it go before them. Without a clock they
    /// would only fall behind it.
    pub has_clock: bool,
    /// Set once the run is to end: from then on it hardly waits for its recording, see [`OnFull::WaitAtMost`].
    pub stop: Arc<AtomicBool>,
    /// When the threads that write have gathered long enough.
    pub clock: MonotonicClock,
}

impl Keeping {
    /// Whoever tells waits for the disk, so nothing is ever lost.
    pub fn patient(clock: MonotonicClock) -> Self {
        Self {
            scribe: ScribeMode::Wait,
            journal: ScribeWatch::default(),
            on_full: OnFull::Wait,
            recording: RecordingSwitch::default(),
            has_clock: false,
            stop: Arc::default(),
            clock,
        }
    }
}
