use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use crate::config::DeadlinePolicy;
use upm_core::rig::{Interlock, Rig, RigFault};
use upm_core::signal::{AccelTrace, Drive, Frame};
use upm_core::time::{Clock, PlateTime};

/// A thread that the interlock does not wake looks at it this often while it waits.
const LONGEST_NAP: Duration = Duration::from_millis(20);

/// What real time is kept by.
pub(super) struct Pace<'a> {
    pub(super) clock: &'a dyn Clock,
    /// Parks the thread for that long, or until it is woken.
    pub(super) nap: &'a dyn Fn(Duration),
    pub(super) stats: &'a PacingStats,
    pub(super) interlock: &'a Interlock,
    /// Frames a second of the rig's camera.
    pub(super) frame_hz: f64,
    /// Whether the drive lease runs out on control that is late.
    pub(super) deadlines: DeadlinePolicy,
}

/// A rig whose plate time never runs ahead of the clock: for watching a simulated plate as if it stood there.
///
/// The first frame starts it. Control that comes late for the next frame finds the plate where it left it: a simulated
/// plate waits, and from then on its time is that much further behind the clock. It never hurries to catch up.
///
/// Under strict deadlines a plate does not wait while a pulse sounds: control that comes later than
/// [`Interlock::LEASE_S`], as after the process stood still, was not there to drive it, and the drive lease runs out.
pub(super) struct Paced<'a> {
    rig: &'a mut dyn Rig,
    pace: Pace<'a>,
    period: Duration,
    /// What the clock showed at plate time zero, if time had always passed as it does now.
    epoch: Option<Epoch>,
    sounding_until: PlateTime,
}

/// Nanoseconds by the clock at plate time zero; below zero where the plate's time began before the clock's.
#[derive(Clone, Copy)]
struct Epoch(i128);

impl Epoch {
    fn of(elapsed: Duration, now: PlateTime) -> Self {
        Self(elapsed.as_nanos() as i128 - i128::from(now.nanos()))
    }

    /// Plate time passes so much later than it did.
    fn later(self, by: Duration) -> Self {
        Self(self.0 + by.as_nanos() as i128)
    }

    /// How far the clock is past plate time `now`, and how far it has still to go there.
    fn late_and_early(self, elapsed: Duration, now: PlateTime) -> (Duration, Duration) {
        let late_ns = elapsed.as_nanos() as i128 - self.0 - i128::from(now.nanos());
        let up = |nanos: i128| Duration::from_nanos(u64::try_from(nanos.max(0)).unwrap_or(u64::MAX));
        (up(late_ns), up(-late_ns))
    }
}

impl<'a> Paced<'a> {
    pub(super) fn new(rig: &'a mut dyn Rig, pace: Pace<'a>) -> Self {
        pace.interlock.driven_from_here();
        let period = Duration::try_from_secs_f64(1.0 / pace.frame_hz).unwrap_or(Duration::MAX);
        Self { rig, pace, period, epoch: None, sounding_until: PlateTime::ZERO }
    }

    /// Before the rig goes on: settles what came late.
    fn keep_up(&mut self) -> Result<(), RigFault> {
        let late = self.late();
        if late <= self.period {
            return Ok(());
        }
        let frames = late.as_nanos().checked_div(self.period.as_nanos());
        self.pace.stats.miss(frames.and_then(|frames| frames.try_into().ok()).unwrap_or(u64::MAX));
        let is_strict = self.pace.deadlines == DeadlinePolicy::Strict;
        let lease_ran_out = is_strict && late.as_secs_f64() > Interlock::LEASE_S;
        if lease_ran_out && self.rig.now() < self.sounding_until {
            self.rig.pass(self.rig.now() + late.as_secs_f64())?;
        }
        let behind = self.late();
        if behind > self.period {
            self.epoch = self.epoch.map(|epoch| epoch.later(behind));
            self.pace.stats.fall_behind(behind);
        }
        Ok(())
    }

    /// How far the clock is past the plate's time; zero at first.
    fn late(&mut self) -> Duration {
        let (elapsed, now) = (self.pace.clock.elapsed(), self.rig.now());
        self.epoch.get_or_insert(Epoch::of(elapsed, now)).late_and_early(elapsed, now).0
    }

    /// Waits until the clock is where the plate is. A trip ends the wait, and so does a clock that stands still.
    fn wait(&self) {
        let Some(epoch) = self.epoch else { return };
        let mut elapsed = self.pace.clock.elapsed();
        while self.pace.interlock.tripped().is_none() {
            let (_, early) = epoch.late_and_early(elapsed, self.rig.now());
            if early.is_zero() {
                return;
            }
            (self.pace.nap)(early.min(LONGEST_NAP));
            let before = std::mem::replace(&mut elapsed, self.pace.clock.elapsed());
            if elapsed == before {
                return;
            }
        }
    }
}

impl Rig for Paced<'_> {
    fn now(&self) -> PlateTime {
        self.rig.now()
    }

    fn play(&mut self, drive: &Drive) -> Result<(), RigFault> {
        // what was late before a pulse does not count as time without a driver
        self.keep_up()?;
        let started_at = self.rig.now();
        self.rig.play(drive)?;
        self.sounding_until = started_at + drive.envelope.sounding_s();
        Ok(())
    }

    fn quiet_at(&self) -> PlateTime {
        self.rig.quiet_at()
    }

    fn capture(&mut self, frame: &mut Frame) -> Result<(), RigFault> {
        self.keep_up()?;
        self.rig.capture(frame)?;
        self.wait();
        // at once, not when control comes back for the next frame
        self.pace.interlock.tripped().map_or(Ok(()), |trip| {
            self.rig.stop();
            Err(RigFault::Stopped(trip))
        })
    }

    fn trace(&self) -> AccelTrace {
        self.rig.trace()
    }

    fn stop(&mut self) {
        self.rig.stop();
    }

    fn pass(&mut self, until: PlateTime) -> Result<(), RigFault> {
        self.rig.pass(until)
    }
}

/// Deadlines missed in real time, to be read from any thread while a plate runs.
///
/// A deadline is missed when control comes for its next frame more than a frame's period late: a camera would have
/// taken that frame without anybody looking. The count goes on over all runs of a plate, the worst is that of its
/// present or last run, and so is how far the plate fell behind.
#[derive(Debug, Default)]
pub struct PacingStats {
    misses: AtomicU64,
    worst_frames: AtomicU64,
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

    /// How far plate time has fallen behind the clock in this run, in all: it is never made up for.
    pub fn behind(&self) -> Duration {
        Duration::from_nanos(self.behind_ns.load(Ordering::Relaxed))
    }

    /// A run starts; the deadlines missed before it.
    pub(super) fn start_run(&self) -> u64 {
        self.worst_frames.store(0, Ordering::Relaxed);
        self.behind_ns.store(0, Ordering::Relaxed);
        self.misses()
    }

    pub(super) fn miss(&self, frames: u64) {
        self.misses.fetch_add(1, Ordering::Relaxed);
        self.worst_frames.fetch_max(frames, Ordering::Relaxed);
    }

    /// The plate waited for control, and is that much further behind the clock.
    pub(super) fn fall_behind(&self, by: Duration) {
        self.behind_ns.fetch_add(nanos(by), Ordering::Relaxed);
    }
}

fn nanos(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests;
