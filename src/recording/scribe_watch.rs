use std::io;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

/// Tells from any thread how a [`Scribe`](super::Scribe) is getting on. Clones tell of the same scribe, and nobody waits here.
#[derive(Clone, Debug, Default)]
pub struct ScribeWatch(Arc<Watched>);

#[derive(Debug, Default)]
struct Watched {
    /// Since when the disk has not answered, ms of the scribe's clock, at least 1; 0 while nobody waits for it.
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
