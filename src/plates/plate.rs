use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::{JoinHandle, Thread};
use std::time::Duration;

use super::crier::TapId;
use super::shared::{Cause, Shared};
use super::told::{Tap, Told};
use super::validate::validated;
use super::{Picture, PlateSnapshot, ResetFault};
use crate::config::Fault;
use crate::rig::{StopTimes, Trip};
use crate::store::{AuditEntry, JobId, JobPace, NewJob, StoredEvent};
use crate::time::{Clock, MonotonicClock};

/// How long an emergency stop that is waited for is given to reach the disk.
const KEPT_WITHIN: Duration = Duration::from_millis(400);

/// Who asks for something, as far as is known.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Caller {
    /// Who they say they are.
    pub operator: String,
    /// Why they say they do it.
    pub reason: String,
    /// Address they come from.
    pub remote: String,
    /// Name of the token they showed.
    pub token_name: String,
}

/// One plate and its thread.
#[derive(Debug)]
pub struct Plate {
    pub(super) shared: Arc<Shared>,
    pub(super) clock: MonotonicClock,
    pub(super) keeper: Thread,
    pub(super) worker: JoinHandle<()>,
    pub(super) crier: JoinHandle<()>,
}

impl Plate {
    /// Its name.
    pub fn name(&self) -> &str {
        &self.shared.name
    }

    /// Stops it: motors to zero, the job ends, and nothing moves until somebody resets it. Waits for nobody: not for
    /// the run, not for the store, not for the disk. True when it was not stopped before.
    pub fn estop(&self) -> bool {
        self.shared.interlock.trip(Trip::EStop);
        let changed = self.shared.latch.stop();
        self.shared.estops.fetch_add(changed.into(), Ordering::Relaxed);
        self.shared.stop.store(true, Ordering::SeqCst);
        self.keeper.unpark();
        self.wake();
        changed
    }

    /// Writes down who stopped it, and waits a little for the stop to be on the disk. False when it is not by then:
    /// it holds all the same, and goes to the disk as soon as that takes it.
    pub fn account_for_estop(&self, who: Caller) -> bool {
        self.audit("estop", who);
        let until = self.clock.elapsed() + KEPT_WITHIN;
        while !self.shared.latch.is_kept() && self.clock.elapsed() < until {
            std::thread::sleep(Duration::from_millis(1));
        }
        self.shared.latch.is_kept()
    }

    /// Takes back an emergency stop. The plate is paused then: it starts nothing by this.
    pub fn reset(&self, who: Caller) -> Result<(), ResetFault> {
        let shared = &*self.shared;
        if !shared.latch.is_stopped() {
            return Err(ResetFault::NotStopped);
        }
        let tripped = shared.interlock.tripped() == Some(Trip::EStop);
        if shared.job().is_some() || (tripped && !shared.interlock.release(Trip::EStop)) {
            return Err(ResetFault::StillStopping);
        }
        shared.pause(Some("reset after an emergency stop".to_owned()));
        self.audit("reset", who);
        shared.latch.release();
        self.keeper.unpark();
        Ok(())
    }

    /// Lets it take jobs again. False while an emergency stop holds. Going on twice is going on.
    pub fn resume(&self, who: Caller) -> bool {
        if self.shared.is_stopped() {
            return false;
        }
        if self.shared.paused().is_some() {
            self.audit("resume", who);
            self.shared.pause(None);
        }
        self.wake();
        true
    }

    /// Tells it that a job was queued.
    pub fn wake(&self) {
        self.worker.thread().unpark();
    }

    /// What of it works no more, though it should.
    pub(super) fn dead(&self) -> Option<String> {
        let ended = |what: &str, thread: &JoinHandle<()>| {
            thread.is_finished().then(|| format!("the {what} of plate {} has died", self.name()))
        };
        ended("worker", &self.worker).or_else(|| ended("crier", &self.crier))
    }

    /// True once nothing of it works any more.
    pub(super) fn threads_ended(&self) -> bool {
        self.worker.is_finished() && self.crier.is_finished()
    }

    /// Tells the job on it to end; false when it has another one, or none.
    pub fn cancel(&self, id: &JobId) -> bool {
        self.shared.end_run(Some(id), Cause::Cancelled)
    }

    /// Tells those who watch a job of this plate that it has ended, though not on the plate.
    pub fn announce_end(&self, id: JobId, finished: StoredEvent) {
        self.shared.taps.offer(&Told::finished(id, finished));
    }

    /// True while an emergency stop holds.
    pub fn is_stopped(&self) -> bool {
        self.shared.is_stopped()
    }

    /// Why it waits for a person to resume it; `None` when it does not.
    pub fn paused(&self) -> Option<String> {
        self.shared.paused()
    }

    /// How the stop that holds was answered; `None` without one, and while motors still sound.
    pub fn stop_times(&self) -> Option<StopTimes> {
        self.shared.interlock.answer()
    }

    /// How it is now.
    pub fn snapshot(&self) -> PlateSnapshot {
        self.shared.snapshot(self.clock.elapsed())
    }

    /// From now on `tap` is told what happens on it.
    pub fn subscribe(&self, tap: Arc<dyn Tap>) -> TapId {
        self.shared.taps.add(tap)
    }

    /// That tap is told nothing more.
    pub fn unsubscribe(&self, id: TapId) {
        self.shared.taps.remove(id);
    }

    /// The newest picture of the job on it; wishes for newer ones.
    pub fn picture(&self) -> Option<Arc<Picture>> {
        self.shared.window.look(self.clock.elapsed())
    }

    /// A job as it may be queued, or everything that is wrong with it.
    pub fn validate(&self, text: &str, pace: JobPace, key: Option<String>) -> Result<NewJob, Vec<Fault>> {
        validated(&self.shared, text, pace, key)
    }

    fn audit(&self, act: &str, who: Caller) {
        let Caller { operator, reason, remote, token_name } = who;
        let plate = Some(self.shared.name.clone());
        self.shared.ledger.note_act(AuditEntry { plate, act: act.to_owned(), operator, reason, remote, token_name });
    }
}
