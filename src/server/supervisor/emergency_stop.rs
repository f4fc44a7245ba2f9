//! The emergency stop of one plate: an interlock, which keeps the motors silent, and a latch, which holds the stop over
//! restarts until an operator resets it. Each changes atomically, but the pair in two steps, so the states between are
//! states, too.
//!
//! | interlock | latch | state | a stop leads to | a reset with the token of the stop leads to |
//! |---|---|---|---|---|
//! | free | released | [`StopState::Released`] | `Held` | refused: `NotStopped` |
//! | tripped | released | [`StopState::Tripping`] | `Held` | refused: `StillStopping` |
//! | tripped | stopped | [`StopState::Held`] | `Held`, older tokens void | `Released`; refused while attached |
//! | free | stopped | [`StopState::Resetting`] | `Held`, the reset fails | waits for the one under way |
//!
//! An interlock that tripped for another reason counts as free: an emergency stop overrides it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use parking_lot::Mutex;

use super::ResetError;
use super::latch::{Latch, StopToken};
use upm_core::job::StopRequest;
use upm_core::rig::{Interlock, Trip};
use upm_runner::run::ExternalStop;

/// The state of a plate's emergency stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopState {
    /// No stop holds.
    Released,
    /// The motors are cut, and the latch is about to be set.
    Tripping,
    /// The stop holds until an operator resets it.
    Held,
    /// A reset has freed the motors, and the latch is about to be released.
    Resetting,
}

/// The emergency stop of one plate. Stopping takes no lock and never waits for the run, the store or the disk.
#[derive(Debug)]
pub struct EmergencyStop {
    /// The interlock of the motors of the plate's rig.
    pub interlock: Interlock,
    pub latch: Latch,
    /// Ends the run on the plate.
    end_run: Arc<AtomicBool>,
    /// Stops since the daemon started that changed the state.
    pub count: AtomicU64,
    /// Held for the whole of a reset, and by nothing else.
    resetting: Mutex<()>,
}

impl EmergencyStop {
    /// The emergency stop of a plate whose latch was found as `latch`; a stop that holds trips the interlock.
    pub fn new(latch: Latch, interlock: Interlock, end_run: Arc<AtomicBool>) -> Self {
        if latch.is_stopped() {
            interlock.trip(Trip::EStop);
        }
        let count = AtomicU64::new(0);
        Self { interlock, latch, end_run, count, resetting: Mutex::default() }
    }

    /// Sets the motors to zero; nothing moves until a reset. True when no stop held before. [`Self::persist`] then
    /// makes it hold over a restart.
    pub fn stop(&self) -> bool {
        let mut changed = false;
        // a reset under way may have released the trip before it could see the stop: then both steps once more
        loop {
            self.interlock.trip(Trip::EStop);
            changed |= self.latch.stop();
            if self.interlock.tripped() == Some(Trip::EStop) {
                break;
            }
        }
        self.count.fetch_add(changed.into(), Ordering::Relaxed);
        self.end_run.store(true, Ordering::SeqCst);
        changed
    }

    /// The state now.
    pub fn state(&self) -> StopState {
        // the latch first: a reset frees it last
        let is_latched = self.latch.is_stopped();
        match (self.interlock.tripped() == Some(Trip::EStop), is_latched) {
            (false, false) => StopState::Released,
            (true, false) => StopState::Tripping,
            (true, true) => StopState::Held,
            (false, true) => StopState::Resetting,
        }
    }

    /// True from a stop until its reset has finished.
    pub fn holds(&self) -> bool {
        self.state() != StopState::Released
    }

    /// The cause of a run's end, if this stop ended it.
    pub fn cause(&self) -> Option<ExternalStop> {
        self.holds().then(|| ExternalStop::of(StopRequest::Estop, "emergency stop"))
    }

    /// Writes the latch to the disk; true when a stop is there. Waits for the disk.
    pub fn persist(&self) -> bool {
        let written = self.latch.write();
        written.map_err(|error| tracing::error!("an emergency stop cannot be written: {error}")).unwrap_or(false)
    }

    /// The stop that holds, as the token for its reset.
    pub fn held(&self) -> Result<StopToken, ResetError> {
        match self.latch.held() {
            Some(held) => Ok(held),
            None if self.holds() => Err(ResetError::StillStopping),
            None => Err(ResetError::NotStopped),
        }
    }

    /// Takes back the stop `held`, one reset at a time. `allow` may wait and refuse; `pause` keeps the plate still once
    /// the motors are free. A stop made since `held` was taken holds.
    pub fn reset(
        &self,
        held: StopToken,
        allow: impl FnOnce() -> Result<(), ResetError>,
        pause: impl FnOnce(),
    ) -> Result<(), ResetError> {
        let _alone = self.resetting.lock();
        if self.held()? != held {
            return Err(ResetError::StoppedAgain);
        }
        allow()?;
        let is_tripped = self.interlock.tripped() == Some(Trip::EStop);
        if is_tripped && !self.interlock.release(Trip::EStop) {
            return Err(ResetError::StillStopping);
        }
        pause();
        if !self.latch.release(held) {
            // the newer stop may have found the interlock still tripped
            self.interlock.trip(Trip::EStop);
            return Err(ResetError::StoppedAgain);
        }
        if let Err(error) = self.latch.write() {
            tracing::error!("a reset cannot be written to the disk, the plate is stopped after a restart: {error}");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
