//! The watchdog: checks that the run on a plate is alive, and reports what is wrong with it.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use upm_core::job::{Finding, StopCause};
use upm_core::time::PlateTime;
use upm_runner::config::WatchdogSpec;
use upm_runner::run::ExternalStop;

/// Interval between two checks.
pub(super) const TICK: Duration = Duration::from_millis(10);
/// Longest interval between two checks that counts. In a longer one the whole program had stopped, watchdog included.
const STOOD_STILL: Duration = Duration::from_millis(100);
/// Frames that may be missing, or show no part, however low the camera's rate is. A part that two frames do not show is
/// lost, which ends the run first.
const MISSED_FRAMES: f64 = 3.5;

/// Signs of life of a run, written by the plate's thread for the watchdog without waiting.
#[derive(Debug, Default)]
pub(super) struct Heartbeat {
    /// Wall time of the newest frame, ms, at least 1; 0 before the first, and once control has ended.
    frame_ms: AtomicU64,
    /// Plate time of that frame, and of the newest one with a part in sight, ms.
    plate_ms: AtomicU64,
    seen_ms: AtomicU64,
}

impl Heartbeat {
    /// Resets the signs for a new run.
    pub fn clear(&self) {
        for each in [&self.frame_ms, &self.plate_ms, &self.seen_ms] {
            each.store(0, Ordering::Relaxed);
        }
    }

    /// Notes that control has ended: the plate is at rest, however long the files take to write.
    pub fn end(&self) {
        self.frame_ms.store(0, Ordering::Release);
    }

    /// True from the first frame of a run until its control ends.
    pub fn is_driven(&self) -> bool {
        self.frame_ms.load(Ordering::Acquire) > 0
    }

    /// Notes a frame.
    pub fn frame(&self, now: Duration, at: PlateTime, part_in_sight: bool) {
        let plate_ms = at.nanos() / 1_000_000;
        self.plate_ms.store(plate_ms, Ordering::Relaxed);
        if part_in_sight {
            self.seen_ms.store(plate_ms, Ordering::Relaxed);
        }
        self.frame_ms.store(ms(now).max(1), Ordering::Release);
    }
}

/// Watchdog of one plate.
#[derive(Debug)]
pub(super) struct Watchdog {
    spec: WatchdogSpec,
    /// When it looked last at the present run; `None` before it did.
    looked_at: Option<Duration>,
    frame: Unchanged,
    unwritten: Unchanged,
}

/// Time that the program has run since a value last changed. Time in which it was suspended does not count.
#[derive(Debug, Default)]
struct Unchanged {
    value: u64,
    ran: Duration,
}

impl Unchanged {
    /// Adds the time `ran` since the last check, in which the value became `value`.
    fn add(&mut self, ran: Duration, value: u64) -> Duration {
        self.ran = if self.value == value { self.ran + ran } else { Duration::ZERO };
        self.value = value;
        self.ran
    }
}

impl Watchdog {
    /// A watchdog of runs with a camera of this rate: limits shorter than a few frames are as long as these.
    pub fn with_camera(spec: WatchdogSpec, frame_hz: f64) -> Self {
        let least_s = MISSED_FRAMES / frame_hz;
        let hung = spec.hung.max(Duration::from_secs_f64(least_s));
        let spec = WatchdogSpec { hung, no_part_s: spec.no_part_s.max(least_s), ..spec };
        Self { spec, looked_at: None, frame: Unchanged::default(), unwritten: Unchanged::default() }
    }

    /// Checks a run. Returns its fault, if any; `None` before its first frame. `unwritten_since` is the time since
    /// which the journal waits for the disk.
    pub fn check(
        &mut self,
        now: Duration,
        heartbeat: &Heartbeat,
        unwritten_since: Option<Duration>,
    ) -> Option<ExternalStop> {
        let ran = now.saturating_sub(self.looked_at.replace(now)?).min(STOOD_STILL);
        let read = |value: &AtomicU64| value.load(Ordering::Relaxed);
        let frame_ms = read(&heartbeat.frame_ms);
        let unwritten_ms = unwritten_since.map_or(0, ms);
        let unframed = self.frame.add(ran, frame_ms);
        let unwritten = self.unwritten.add(ran, unwritten_ms);
        let unseen_s = read(&heartbeat.plate_ms).saturating_sub(read(&heartbeat.seen_ms)) as f64 * 1e-3;
        let WatchdogSpec { hung, no_part_s, blocked } = self.spec;
        let [unframed_s, unwritten_s] = [unframed, unwritten].map(|time| time.as_secs_f64());
        let (finding, reason) = if frame_ms == 0 {
            return None;
        } else if unframed > hung {
            (Finding::Hung, format!("no frame came for {unframed_s:.1} s: the controller hangs"))
        } else if unseen_s > no_part_s {
            (Finding::NoPartSeen, format!("no part was seen for {unseen_s:.1} s of plate time"))
        } else if unwritten_ms != 0 && unwritten > blocked {
            (Finding::JournalBlocked, format!("the journal could not be written for {unwritten_s:.1} s"))
        } else {
            return None;
        };
        Some(ExternalStop::of(StopCause::Found(finding), reason))
    }

    /// Forgets the run: it ended, or none is on the plate.
    pub fn rest(&mut self) {
        self.looked_at = None;
        (self.frame, self.unwritten) = Default::default();
    }
}

pub(super) fn ms(time: Duration) -> u64 {
    u64::try_from(time.as_millis()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests;
