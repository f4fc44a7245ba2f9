use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use jiff::Timestamp;

use upm_core::time::Clock;

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

/// Measures [`Uptime`].
#[derive(Debug)]
pub(super) struct AgeClock {
    clocks: Clocks,
    /// Uptime before this start, and the reading of the monotonic clock at the start.
    earlier: Uptime,
    started: Duration,
}

impl AgeClock {
    /// The clock of a store whose earlier starts add up to `earlier`.
    pub fn after(earlier: Uptime, clocks: Clocks) -> Self {
        let started = clocks.monotonic.elapsed();
        Self { clocks, earlier, started }
    }

    /// The uptime now.
    pub fn uptime(&self) -> Uptime {
        self.earlier.saturating_add(micros(self.clocks.monotonic.elapsed().saturating_sub(self.started)))
    }
}

/// The uptime below which things are older than `limit` at the uptime `now`.
pub(super) fn cutoff(now: Uptime, limit: Duration) -> Uptime {
    now.saturating_sub(micros(limit))
}

fn micros(time: Duration) -> i64 {
    i64::try_from(time.as_micros()).unwrap_or(i64::MAX)
}
