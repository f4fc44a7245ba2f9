//! Plate time and wall time, kept apart. [`PlateTime`] is the experiment's own time, which the rig provides; the core
//! reads no other. Wall time serves reports on speed only and comes from a [`Clock`] that is passed in.

use std::fmt;
use std::ops::{Add, Sub};
use std::time::Duration;

/// Time since the rig was switched on, in whole nanoseconds, so that sums are exact and journals are reproducible.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PlateTime(u64);

impl PlateTime {
    /// The moment the rig was switched on.
    pub const ZERO: Self = Self(0);

    /// Plate time from whole nanoseconds.
    #[inline]
    pub const fn from_nanos(nanos: u64) -> Self {
        Self(nanos)
    }

    /// Plate time from seconds, rounded to the nanosecond. Negative numbers and not-a-number become zero.
    #[inline]
    pub fn from_secs(seconds: f64) -> Self {
        Self((seconds * 1e9).round() as u64)
    }

    /// Plate time in whole nanoseconds.
    #[inline]
    pub const fn nanos(self) -> u64 {
        self.0
    }

    /// Plate time in seconds.
    #[inline]
    pub fn secs(self) -> f64 {
        self.0 as f64 * 1e-9
    }

    /// Seconds elapsed since `earlier`; zero when `earlier` is the later one.
    #[inline]
    pub fn secs_since(self, earlier: Self) -> f64 {
        self.0.saturating_sub(earlier.0) as f64 * 1e-9
    }
}

impl Add<f64> for PlateTime {
    type Output = Self;
    /// Later by so many seconds; a negative number or NaN adds nothing.
    #[inline]
    fn add(self, seconds: f64) -> Self {
        Self(self.0.saturating_add(Self::from_secs(seconds).0))
    }
}

impl Sub for PlateTime {
    type Output = f64;
    /// Difference, s; negative when `other` is the later one.
    #[inline]
    fn sub(self, other: Self) -> f64 {
        (self.0 as f64 - other.0 as f64) * 1e-9
    }
}

impl fmt::Display for PlateTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.3} s", self.secs())
    }
}

/// Source of wall time. The core never reads the system clock itself, so that a test can stop time.
pub trait Clock: fmt::Debug {
    /// Time since a fixed moment; never decreases.
    fn elapsed(&self) -> Duration;
}

/// The machine's monotonic clock, started at construction.
#[derive(Clone, Copy, Debug)]
pub struct MonotonicClock(std::time::Instant);

impl MonotonicClock {
    /// A clock that reads zero now.
    #[allow(clippy::disallowed_methods, clippy::new_without_default)] // the one place that reads the clock
    pub fn new() -> Self {
        Self(std::time::Instant::now())
    }
}

impl Clock for MonotonicClock {
    fn elapsed(&self) -> Duration {
        self.0.elapsed()
    }
}

/// A clock that always reads zero, for runs in which wall time must not appear.
#[derive(Clone, Copy, Debug, Default)]
pub struct StoppedClock;

impl Clock for StoppedClock {
    #[inline]
    fn elapsed(&self) -> Duration {
        Duration::ZERO
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_exact_to_the_nanosecond() {
        let mut t = PlateTime::ZERO;
        for _ in 0..60 {
            t = t + 1.0 / 60.0;
        }
        assert_eq!(t.nanos(), 60 * 16_666_667);
        assert_eq!(PlateTime::from_secs(-1.0), PlateTime::ZERO);
    }
}
