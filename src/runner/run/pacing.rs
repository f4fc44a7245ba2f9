use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Deadlines missed in real time, for whoever watches a plate while it runs.
///
/// A deadline is missed when control comes for its next frame more than a frame's period late: a camera would have
/// taken that frame without anybody looking. The count goes on over all runs of a plate, the worst is that of its
/// present or last run, and so is how far the plate fell behind.
#[derive(Debug, Default)]
pub struct PacingStats {
    misses: AtomicU64,
    worst_frames: AtomicU64,
    worst_late_ns: AtomicU64,
    behind_ns: AtomicU64,
}

impl PacingStats {
    /// Deadlines missed so far, in all runs.
    pub fn misses(&self) -> u64 {
        self.misses.load(Ordering::Relaxed)
    }

    /// Whole frame periods by which the worst one of this run was missed.
    pub fn worst_frames(&self) -> u64 {
        self.worst_frames.load(Ordering::Relaxed)
    }

    /// How late that was.
    pub fn worst_late(&self) -> Duration {
        Duration::from_nanos(self.worst_late_ns.load(Ordering::Relaxed))
    }

    /// How far plate time has fallen behind the clock in this run, in all: it is never made up for.
    pub fn behind(&self) -> Duration {
        Duration::from_nanos(self.behind_ns.load(Ordering::Relaxed))
    }

    /// A run starts; the deadlines missed before it.
    pub(super) fn start_run(&self) -> u64 {
        self.worst_frames.store(0, Ordering::Relaxed);
        self.worst_late_ns.store(0, Ordering::Relaxed);
        self.behind_ns.store(0, Ordering::Relaxed);
        self.misses()
    }

    pub(super) fn miss(&self, late: Duration, frames: u64) {
        self.misses.fetch_add(1, Ordering::Relaxed);
        self.worst_frames.fetch_max(frames, Ordering::Relaxed);
        self.worst_late_ns.fetch_max(nanos(late), Ordering::Relaxed);
    }

    /// The plate waited for control, and is that much further behind the clock.
    pub(super) fn fall_behind(&self, by: Duration) {
        self.behind_ns.fetch_add(nanos(by), Ordering::Relaxed);
    }
}

fn nanos(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
}
