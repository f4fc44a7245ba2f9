use std::io;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use super::switch::RecordingSwitch;
use upm_core::background::OverflowPolicy;
use upm_core::time::MonotonicClock;

/// How what is told of a run gets to the disk. It changes nothing in the run itself.
#[derive(Clone, Debug)]
pub struct Keeping {
    /// The journal's choice when the disk lags. One that gives up fails with [`io::ErrorKind::WouldBlock`] from then on.
    pub journal_overflow: OverflowPolicy,
    /// Tells how the journal is getting on. One for each run.
    pub journal: ScribeWatch,
    /// The recording's choice when it lags. One that gives up ends as failed, and the run goes on.
    pub recording_overflow: OverflowPolicy,
    /// Tells how the recording is getting on, and stops it. One for each run.
    pub recording: RecordingSwitch,
    /// True for a run that has a clock to keep up with: the threads that write let it go before them. Without a clock they
    /// would only fall behind it.
    pub has_clock: bool,
    /// Set once the run is to end: from then on it waits a tenth of a second for its recording at most,
    /// unless that may wait without end.
    pub stop: Arc<AtomicBool>,
    /// When the threads that write have gathered long enough.
    pub clock: MonotonicClock,
}

impl Keeping {
    /// The run waits for the disk, so nothing is ever lost.
    pub fn patient(clock: MonotonicClock) -> Self {
        Self {
            journal_overflow: OverflowPolicy::Wait,
            journal: ScribeWatch::default(),
            recording_overflow: OverflowPolicy::Wait,
            recording: RecordingSwitch::default(),
            has_clock: false,
            stop: Arc::default(),
            clock,
        }
    }
}

/// Status of a [`Scribe`](super::scribe::Scribe), to be read from any thread without waiting. Clones are of the same scribe.
#[derive(Clone, Debug, Default)]
pub struct ScribeWatch(Arc<Watched>);

#[derive(Debug, Default)]
struct Watched {
    /// Since when the disk has not answered, ms of the scribe's clock, at least 1; 0 while it is not waited for.
    waits_since_ms: AtomicU64,
    fault: OnceLock<String>,
}

impl ScribeWatch {
    /// Since when the scribe has been waiting for the disk, by its clock.
    pub fn waits_since(&self) -> Option<Duration> {
        let since_ms = self.0.waits_since_ms.load(Ordering::Relaxed);
        (since_ms != 0).then(|| Duration::from_millis(since_ms))
    }

    /// Why nothing more is written.
    pub fn fault(&self) -> Option<&str> {
        self.0.fault.get().map(String::as_str)
    }

    /// The scribe turns to the disk.
    pub(super) fn wait(&self, now: Duration) {
        let now_ms = u64::try_from(now.as_millis()).unwrap_or(u64::MAX);
        self.0.waits_since_ms.store(now_ms.max(1), Ordering::Relaxed);
    }

    /// The disk has answered.
    pub(super) fn go_on(&self) {
        self.0.waits_since_ms.store(0, Ordering::Relaxed);
    }

    /// Nothing more is written. The first fault counts.
    pub(super) fn fail(&self, fault: &io::Error) {
        self.0.fault.set(fault.to_string()).ok();
    }
}
