//! The watchdog: checks that the run on a plate is alive, and reports what is wrong with it.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use upm_core::job::StopCause;
use upm_core::time::PlateTime;
use upm_runner::config::{DeadlinePolicy, WatchdogSpec};
use upm_runner::run::ExternalStop;

/// Interval between two checks.
pub(super) const TICK: Duration = Duration::from_millis(10);
/// Longest interval between two checks that counts. After a longer one the whole program had stopped, watchdog
/// included, and the run notices that by itself.
const STOOD_STILL: Duration = Duration::from_millis(100);
/// Frames that may be missing, or show no part, however low the camera's rate is. A part that two frames do not show is
/// lost, which ends the run first.
const MISSED_FRAMES: f64 = 3.5;
/// Time over which missed deadlines are counted.
const SECOND: Duration = Duration::from_secs(1);

/// Signs of life of a run, written by the plate's thread for the watchdog without waiting.
#[derive(Debug, Default)]
pub(super) struct Heartbeat {
    /// Wall time of the newest frame, ms, at least 1; 0 before the first.
    frame_ms: AtomicU64,
    /// Plate time of that frame, and of the newest one with a part in sight, ms.
    plate_ms: AtomicU64,
    seen_ms: AtomicU64,
    /// Wall time since which no event could be published, ms; 0 while events can.
    unpublished_since_ms: AtomicU64,
    /// True from a frame that a plan starts from until the next frame.
    planning: AtomicBool,
    /// True once control has ended.
    over: AtomicBool,
}

impl Heartbeat {
    /// Resets the signs for a new run.
    pub fn clear(&self) {
        for each in [&self.frame_ms, &self.plate_ms, &self.seen_ms, &self.unpublished_since_ms] {
            each.store(0, Ordering::Relaxed);
        }
        self.over.store(false, Ordering::Release);
    }

    /// Notes that control has ended: the plate is at rest, however long the files take to write.
    pub fn end(&self) {
        self.over.store(true, Ordering::Release);
    }

    /// True once control has ended.
    pub fn is_over(&self) -> bool {
        self.over.load(Ordering::Acquire)
    }

    /// Notes a frame; `starts_cycle` for one that a plan starts from.
    pub fn frame(&self, now: Duration, at: PlateTime, part_in_sight: bool, starts_cycle: bool) {
        let plate_ms = at.nanos() / 1_000_000;
        self.plate_ms.store(plate_ms, Ordering::Relaxed);
        if part_in_sight {
            self.seen_ms.store(plate_ms, Ordering::Relaxed);
        }
        self.planning.store(starts_cycle, Ordering::Relaxed);
        self.over.store(false, Ordering::Release);
        self.frame_ms.store(ms(now).max(1), Ordering::Relaxed);
    }

    /// Notes whether an event could be published.
    pub fn note_publish(&self, now: Duration, could: bool) {
        if could {
            self.unpublished_since_ms.store(0, Ordering::Relaxed);
        } else if self.unpublished_since_ms.load(Ordering::Relaxed) == 0 {
            self.unpublished_since_ms.store(ms(now).max(1), Ordering::Relaxed);
        }
    }
}

/// Pacing of a run.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct WatchdogDeadlines {
    pub policy: DeadlinePolicy,
    pub real_time: bool,
    pub misses: u64,
    pub worst_frames: u64,
}

/// Watchdog of one plate.
#[derive(Debug)]
pub(super) struct Watchdog {
    spec: WatchdogSpec,
    memory: Memory,
}

/// The watchdog's memory of one run.
#[derive(Debug, Default)]
struct Memory {
    looked_at: Option<Duration>,
    /// When the program went on after it had stopped.
    went_on: Duration,
    /// Start of the current second, and the misses counted then.
    second: (Duration, u64),
    /// The newest frame, as [`Heartbeat`] has it, and how long the program has run since it was first seen.
    newest: (u64, Duration),
}

impl Memory {
    /// Adds the time `ran` since the last check, with `frame_ms` as the newest frame; returns how long the program has
    /// run without a new frame.
    fn without_frame(&mut self, ran: Duration, frame_ms: u64) -> Duration {
        let (newest_ms, before) = self.newest;
        let since = if newest_ms == frame_ms { before + ran } else { Duration::ZERO };
        self.newest = (frame_ms, since);
        since
    }
}

impl Watchdog {
    pub fn new(spec: WatchdogSpec) -> Self {
        Self { spec, memory: Memory::default() }
    }

    /// A watchdog of runs with a camera of this rate: limits shorter than a few frames are as long as these.
    pub fn with_camera(spec: WatchdogSpec, frame_hz: f64) -> Self {
        let least_s = MISSED_FRAMES / frame_hz;
        let no_frame = spec.no_frame.max(Duration::from_secs_f64(least_s));
        Self::new(WatchdogSpec { no_frame, no_part_s: spec.no_part_s.max(least_s), ..spec })
    }

    /// Checks a run. Returns its fault, if any; `None` before its first frame. `unwritten_since` is the time since
    /// which the journal waits for the disk.
    ///
    /// Under relaxed deadlines a run may be slow; in wall time only a hung one is a fault.
    pub fn check(
        &mut self,
        now: Duration,
        heartbeat: &Heartbeat,
        deadlines: WatchdogDeadlines,
        unwritten_since: Option<Duration>,
    ) -> Option<ExternalStop> {
        let memory = &mut self.memory;
        let gap = now.saturating_sub(memory.looked_at.replace(now)?);
        let frame_ms = heartbeat.frame_ms.load(Ordering::Relaxed);
        let unframed = memory.without_frame(gap.min(STOOD_STILL), frame_ms);
        if gap > STOOD_STILL {
            (memory.went_on, memory.second) = (now, (now, deadlines.misses));
            return None;
        }
        if frame_ms == 0 {
            return None; // until then the deadlines are those of the run before
        }
        let (slow, blocked) = match deadlines.policy {
            DeadlinePolicy::Strict => {
                let slow = self.late(now, deadlines).or_else(|| self.no_frame(now, heartbeat, deadlines.real_time));
                (slow.map(|what| too_busy(&what, deadlines.real_time)), self.spec.blocked)
            }
            DeadlinePolicy::Relaxed => (self.hung(unframed), self.spec.hung),
        };
        slow.or_else(|| self.unseen(heartbeat))
            .or_else(|| self.events_blocked(now, heartbeat, blocked))
            .or_else(|| self.journal_blocked(now, unwritten_since?, blocked))
    }

    /// Forgets the run: it ended, or none is on the plate.
    pub fn rest(&mut self) {
        self.memory = Memory::default();
    }

    fn late(&mut self, now: Duration, deadlines: WatchdogDeadlines) -> Option<String> {
        let (began, misses_then) = self.memory.second;
        if began == Duration::ZERO || now.saturating_sub(began) >= SECOND {
            self.memory.second = (now, deadlines.misses);
        }
        let misses = deadlines.misses.saturating_sub(misses_then);
        let counted = began != Duration::ZERO && misses > self.spec.misses_per_s;
        if deadlines.worst_frames > self.spec.late_frames {
            return Some(format!("control came {} frames late", deadlines.worst_frames));
        }
        counted.then(|| format!("{misses} deadlines were missed within a second"))
    }

    /// Wall time since `then_ms`, without the time before the program went on.
    fn since(&self, now: Duration, then_ms: u64) -> Duration {
        Duration::from_millis(ms(now).saturating_sub(then_ms.max(ms(self.memory.went_on))))
    }

    fn no_frame(&self, now: Duration, heartbeat: &Heartbeat, real_time: bool) -> Option<String> {
        let spec = &self.spec;
        let unframed = self.since(now, heartbeat.frame_ms.load(Ordering::Relaxed));
        // without real-time pacing, everything between two frames may take as long as a plan
        let (longest, what) = match (heartbeat.planning.load(Ordering::Relaxed), real_time) {
            (true, _) => (spec.planning, "no plan came"),
            (false, true) => (spec.no_frame, "no frame came"),
            (false, false) => (spec.planning, "no frame came"),
        };
        (unframed > longest).then(|| format!("{what} for {:.1} s", unframed.as_secs_f64()))
    }

    fn hung(&self, unframed: Duration) -> Option<ExternalStop> {
        let reason = || format!("no frame came for {:.1} s: the controller hangs", unframed.as_secs_f64());
        (unframed > self.spec.hung).then(|| ExternalStop::of(StopCause::Hung, reason()))
    }

    fn unseen(&self, heartbeat: &Heartbeat) -> Option<ExternalStop> {
        let read = |value: &AtomicU64| value.load(Ordering::Relaxed);
        let unseen_s = read(&heartbeat.plate_ms).saturating_sub(read(&heartbeat.seen_ms)) as f64 * 1e-3;
        let reason = || format!("no part was seen for {unseen_s:.1} s of plate time");
        (unseen_s > self.spec.no_part_s).then(|| ExternalStop::of(StopCause::NoPartSeen, reason()))
    }

    fn events_blocked(&self, now: Duration, heartbeat: &Heartbeat, longest: Duration) -> Option<ExternalStop> {
        let since_ms = heartbeat.unpublished_since_ms.load(Ordering::Relaxed);
        let waited = self.since(now, since_ms);
        let reason = || format!("no event could be stored for {:.1} s", waited.as_secs_f64());
        (since_ms != 0 && waited > longest).then(|| ExternalStop::of(StopCause::EventsBlocked, reason()))
    }

    fn journal_blocked(&self, now: Duration, since: Duration, longest: Duration) -> Option<ExternalStop> {
        let waited = now.saturating_sub(since.max(self.memory.went_on));
        let reason = || format!("the journal could not be written for {:.1} s", waited.as_secs_f64());
        (waited > longest).then(|| ExternalStop::of(StopCause::JournalBlocked, reason()))
    }
}

/// The stop of a run that was too slow for strict deadlines.
fn too_busy(what: &str, real_time: bool) -> ExternalStop {
    ExternalStop::of(StopCause::DeadlineMissed, format!("{what}; {}", ExternalStop::too_busy(real_time)))
}

pub(super) fn ms(time: Duration) -> u64 {
    u64::try_from(time.as_millis()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests;
