use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use crate::config::DeadlinePolicy;
use upm_core::rig::{Interlock, Rig, RigError};
use upm_core::signal::{AccelTrace, Drive, Frame};
use upm_core::time::{Clock, PlateTime};
use upm_recording::{PacingReport, rounded};

/// Interval at which a waiting thread polls an interlock that does not wake it.
const LONGEST_SLEEP: Duration = Duration::from_millis(20);

/// Clock, statistics and policies of real-time pacing.
pub(super) struct PaceClock<'a> {
    pub(super) clock: &'a dyn Clock,
    /// Parks the thread for that long, or until it is woken.
    pub(super) sleep: &'a dyn Fn(Duration),
    pub(super) stats: &'a PacingStats,
    pub(super) interlock: &'a Interlock,
    /// Frames a second of the rig's camera.
    pub(super) frame_hz: f64,
    /// Decides whether the drive lease expires when control is late.
    pub(super) deadlines: DeadlinePolicy,
}

/// A rig whose plate time never runs ahead of the clock, so that a simulated plate moves at the speed of a real one.
///
/// The first frame starts it. If control is late for the next frame, the simulated plate waits for it, and from then on
/// its time is behind the clock by that delay, which is never made up for.
///
/// Under strict deadlines a plate does not wait during a pulse: if control is later than [`Interlock::LEASE_S`], for
/// example because the process was suspended, it was not there to drive the plate, and the drive lease expires.
pub(super) struct RealTimeRig<'a> {
    rig: &'a mut dyn Rig,
    pace: PaceClock<'a>,
    period: Duration,
    /// Reading of the clock at plate time zero, ns, extrapolated from the present offset; negative if the plate's time
    /// began before the clock's.
    epoch_ns: Option<i128>,
    driving_until: PlateTime,
}

impl<'a> RealTimeRig<'a> {
    pub(super) fn new(rig: &'a mut dyn Rig, pace: PaceClock<'a>) -> Self {
        pace.interlock.set_driver_thread();
        let period = Duration::try_from_secs_f64(1.0 / pace.frame_hz).unwrap_or(Duration::MAX);
        Self { rig, pace, period, epoch_ns: None, driving_until: PlateTime::ZERO }
    }

    /// Accounts for a delay before the rig continues.
    fn keep_up(&mut self) -> Result<(), RigError> {
        let late = self.late();
        if late <= self.period {
            return Ok(());
        }
        let frames = late.as_nanos().checked_div(self.period.as_nanos());
        self.pace.stats.miss(frames.and_then(|frames| frames.try_into().ok()).unwrap_or(u64::MAX));
        let is_strict = self.pace.deadlines == DeadlinePolicy::Strict;
        let lease_expired = is_strict && late.as_secs_f64() > Interlock::LEASE_S;
        if lease_expired && self.rig.now() < self.driving_until {
            self.rig.pass(self.rig.now() + late.as_secs_f64())?;
        }
        let behind = self.late();
        if behind > self.period {
            self.epoch_ns = self.epoch_ns.map(|epoch_ns| epoch_ns + behind.as_nanos() as i128);
            self.pace.stats.fall_behind(behind);
        }
        Ok(())
    }

    /// Delay of plate time against the clock; zero at first.
    fn late(&mut self) -> Duration {
        let ahead_ns = self.ahead_ns(self.pace.clock.elapsed());
        time(ahead_ns - *self.epoch_ns.get_or_insert(ahead_ns))
    }

    /// Reading of the clock, less plate time, ns.
    fn ahead_ns(&self, elapsed: Duration) -> i128 {
        elapsed.as_nanos() as i128 - i128::from(self.rig.now().nanos())
    }

    /// Waits until the clock reaches plate time. A trip ends the wait, and so does a clock that does not advance.
    fn wait(&self) {
        let Some(epoch_ns) = self.epoch_ns else { return };
        let mut elapsed = self.pace.clock.elapsed();
        while self.pace.interlock.tripped().is_none() {
            let early = time(epoch_ns - self.ahead_ns(elapsed));
            if early.is_zero() {
                return;
            }
            (self.pace.sleep)(early.min(LONGEST_SLEEP));
            let before = std::mem::replace(&mut elapsed, self.pace.clock.elapsed());
            if elapsed == before {
                return;
            }
        }
    }
}

impl Rig for RealTimeRig<'_> {
    fn now(&self) -> PlateTime {
        self.rig.now()
    }

    fn play(&mut self, drive: &Drive) -> Result<(), RigError> {
        // a delay before a pulse does not count as time without a driver
        self.keep_up()?;
        let started_at = self.rig.now();
        self.rig.play(drive)?;
        self.driving_until = started_at + drive.envelope.driven_s();
        Ok(())
    }

    fn takes_over(&self) -> bool {
        self.rig.takes_over()
    }

    fn take_over(&mut self, drive: &Drive) -> Result<PlateTime, RigError> {
        let started_at = self.rig.take_over(drive)?;
        self.driving_until = started_at + drive.envelope.driven_s();
        Ok(started_at)
    }

    fn settled_at(&self) -> PlateTime {
        self.rig.settled_at()
    }

    fn capture(&mut self, frame: &mut Frame) -> Result<(), RigError> {
        self.keep_up()?;
        self.rig.capture(frame)?;
        self.wait();
        // at once, not only when control asks for the next frame
        self.pace.interlock.tripped().map_or(Ok(()), |trip| {
            self.rig.stop();
            Err(RigError::Stopped(trip))
        })
    }

    fn trace(&self) -> AccelTrace {
        self.rig.trace()
    }

    fn stop(&mut self) {
        self.rig.stop();
    }

    fn pass(&mut self, until: PlateTime) -> Result<(), RigError> {
        self.rig.pass(until)
    }
}

/// Statistics of missed deadlines in real time, readable from any thread while a plate runs.
///
/// A deadline is missed if control is more than a frame period late for its next frame: a real camera would have taken
/// that frame unobserved. Misses are counted over all runs of a plate; the worst miss and the delay are those of the
/// present or last run.
#[derive(Debug, Default)]
pub struct PacingStats {
    misses: AtomicU64,
    /// Delay of the worst miss of this run, in whole frame periods.
    worst_frames: AtomicU64,
    behind_ns: AtomicU64,
}

impl PacingStats {
    /// Number of missed deadlines in all runs.
    pub fn misses(&self) -> u64 {
        self.misses.load(Ordering::Relaxed)
    }

    /// Total delay of plate time against the clock in this run; it is never made up for.
    pub fn behind(&self) -> Duration {
        Duration::from_nanos(self.behind_ns.load(Ordering::Relaxed))
    }

    /// The figures of a run before which `missed_before` deadlines were missed.
    pub(super) fn report(&self, missed_before: u64) -> PacingReport {
        PacingReport {
            deadline_misses: self.misses().saturating_sub(missed_before),
            worst_late_frames: self.worst_frames.load(Ordering::Relaxed),
            behind_s: rounded(self.behind().as_secs_f64()),
        }
    }

    /// Resets the figures of a run; returns the number of deadlines missed before it.
    pub(super) fn start_run(&self) -> u64 {
        self.worst_frames.store(0, Ordering::Relaxed);
        self.behind_ns.store(0, Ordering::Relaxed);
        self.misses()
    }

    pub(super) fn miss(&self, frames: u64) {
        self.misses.fetch_add(1, Ordering::Relaxed);
        self.worst_frames.fetch_max(frames, Ordering::Relaxed);
    }

    /// Adds a delay during which the plate waited for control.
    pub(super) fn fall_behind(&self, by: Duration) {
        self.behind_ns.fetch_add(u64::try_from(by.as_nanos()).unwrap_or(u64::MAX), Ordering::Relaxed);
    }
}

/// A time of `ns`; zero where that is negative.
fn time(ns: i128) -> Duration {
    Duration::from_nanos(u64::try_from(ns.max(0)).unwrap_or(u64::MAX))
}

#[cfg(test)]
mod tests;
