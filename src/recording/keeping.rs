use super::scribe::ScribeMode;
use crate::time::MonotonicClock;

/// How what is told of a run gets to the disk. It changes nothing in the run itself.
#[derive(Clone, Debug)]
pub struct Keeping {
    /// What the journal does when the disk lags.
    pub scribe: ScribeMode,
    /// When the threads that write have gathered long enough.
    pub clock: MonotonicClock,
}

impl Keeping {
    /// Whoever tells waits for the disk, so nothing is ever lost.
    pub fn patient(clock: MonotonicClock) -> Self {
        Self { scribe: ScribeMode::Wait, clock }
    }
}
