use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use jiff::{SignedDuration, Timestamp};
use parking_lot::Mutex;

use upm_core::time::Clock;

/// Least difference between the advances of the wall clock and the monotonic clock that counts as a jump.
const JUMP: Duration = Duration::from_secs(3600);

/// Time after a jump during which nothing is deleted by age, so that an operator can act before data is lost.
const SUSPENDED: Duration = Duration::from_secs(24 * 3600);

/// The clocks of a store.
#[derive(Clone)]
pub struct Clocks {
    /// Wall time, for people. It may jump.
    pub wall: fn() -> Timestamp,
    /// Monotonic time, for ages.
    pub monotonic: Arc<dyn Clock + Send + Sync>,
}

impl Clocks {
    /// A wall clock with a monotonic one.
    pub fn new(wall: fn() -> Timestamp, monotonic: impl Clock + Send + Sync + 'static) -> Self {
        Self { wall, monotonic: Arc::new(monotonic) }
    }
}

impl fmt::Debug for Clocks {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Clocks").finish_non_exhaustive()
    }
}

/// Time that a store has been open, summed over all starts, in whole microseconds. Ages are measured on it: it never
/// advances faster than the monotonic clock, so a wrong wall clock makes nothing old. Time during which no daemon had
/// the store open is not counted, since no clock can be trusted for it.
pub(super) type Uptime = i64;

/// Measures [`Uptime`] and detects jumps of the wall clock.
#[derive(Debug)]
pub(super) struct AgeClock {
    clocks: Clocks,
    /// Uptime before this start, and the reading of the monotonic clock at the start.
    earlier: Uptime,
    started: Duration,
    watch: Mutex<AgeWatch>,
}

#[derive(Debug)]
struct AgeWatch {
    wall: Timestamp,
    monotonic: Duration,
    /// Reading of the monotonic clock at which the suspension ends.
    suspended_until: Option<Duration>,
}

/// Uptime and suspension at one moment.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ages {
    /// Uptime of this start added to that of the earlier ones.
    pub now: Uptime,
    /// True while nothing is deleted by age.
    pub suspended: bool,
}

impl Ages {
    /// The uptime below which things are older than `limit`; while deletion is suspended nothing is.
    pub fn cutoff(self, limit: Duration) -> Uptime {
        let limit = i64::try_from(limit.as_micros()).unwrap_or(i64::MAX);
        if self.suspended { Uptime::MIN } else { self.now.saturating_sub(limit) }
    }
}

impl AgeClock {
    /// The clock of a store whose earlier starts add up to `earlier`.
    pub fn after(earlier: Uptime, clocks: Clocks) -> Self {
        let (wall, started) = ((clocks.wall)(), clocks.monotonic.elapsed());
        let watch = Mutex::new(AgeWatch { wall, monotonic: started, suspended_until: None });
        Self { clocks, earlier, started, watch }
    }

    /// The ages now. Compares the clocks; a jump of the wall clock suspends deletion by age for a day.
    pub fn ages(&self) -> Ages {
        let mut watch = self.watch.lock();
        let (wall, monotonic) = ((self.clocks.wall)(), self.clocks.monotonic.elapsed());
        watch.compare(wall, monotonic);
        let open = monotonic.saturating_sub(self.started);
        let open = i64::try_from(open.as_micros()).unwrap_or(i64::MAX);
        Ages { now: self.earlier.saturating_add(open), suspended: watch.suspended_until.is_some() }
    }
}

impl AgeWatch {
    fn compare(&mut self, wall: Timestamp, monotonic: Duration) {
        let passed = monotonic.saturating_sub(self.monotonic);
        let expected = SignedDuration::try_from(passed).unwrap_or(SignedDuration::MAX);
        let ahead = wall.duration_since(self.wall).saturating_sub(expected);
        (self.wall, self.monotonic) = (wall, monotonic);
        if ahead.unsigned_abs() > JUMP {
            self.suspended_until = Some(monotonic + SUSPENDED);
            let hours = ahead.as_secs_f64() / 3600.0;
            tracing::error!("the wall clock jumped by {hours:+.1} h: for a day nothing is deleted by age");
        } else if self.suspended_until.is_some_and(|until| monotonic >= until) {
            self.suspended_until = None;
            tracing::info!("things are deleted by age again");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOUR: u64 = 3600;

    fn hours(hours: u64) -> Duration {
        Duration::from_secs(hours * HOUR)
    }

    #[test]
    fn jump_of_the_wall_clock_either_way_suspends_for_a_day_and_drift_does_not() {
        let at = |hours: i64| Timestamp::from_second(1_800_000_000 + hours * HOUR as i64).unwrap();
        for jump in [2, -2, 24 * 60, -20 * 365 * 24] {
            let mut watch = AgeWatch { wall: at(0), monotonic: hours(5), suspended_until: None };
            let mut suspended = |wall: i64, monotonic: u64| {
                watch.compare(at(wall), hours(monotonic));
                watch.suspended_until.is_some()
            };
            assert!(!suspended(10, 15) && !suspended(11, 15), "an hour is no jump");
            assert!(suspended(11 + jump, 15) && suspended(34 + jump, 38), "{jump} h");
            assert!(!suspended(35 + jump, 39), "{jump} h");
        }
    }

    #[test]
    fn nothing_is_old_while_deletion_is_suspended() {
        let ages = |suspended| Ages { now: 10_000_000, suspended };
        assert_eq!(ages(false).cutoff(Duration::from_secs(3)), 7_000_000);
        assert_eq!(ages(false).cutoff(Duration::MAX), 10_000_000 - i64::MAX);
        assert_eq!(ages(true).cutoff(Duration::ZERO), i64::MIN);
    }
}
