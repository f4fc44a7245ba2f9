use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use super::events::{EventSubscriber, JobEvent};
use super::latch::Held;
use super::shared::Shared;
use super::validate::{laid_out, validated};
use super::{JobLayout, Pause, Picture, PlateSnapshot, ResetFault};
use crate::store::{AuditEntry, JobId, NewJob, Pace, StoredEvent};
use upm_core::rig::StopTimes;
use upm_core::time::{Clock, MonotonicClock};
use upm_runner::config::Fault;

/// How long an emergency stop that is waited for is given to silence the motors, and to reach the disk.
const SILENT_WITHIN: Duration = Duration::from_millis(400);
const KEPT_WITHIN: Duration = Duration::from_millis(400);

/// The act of stopping, as the audit log calls it.
const ESTOP: &str = "estop";

/// Who asks for something, as far as is known.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Requester {
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
    pub(super) worker: JoinHandle<()>,
    pub(super) publisher: JoinHandle<()>,
}

impl Plate {
    /// Its name.
    pub fn name(&self) -> &str {
        &self.shared.name
    }

    /// Stops it: motors to zero, the job ends, and nothing moves until somebody resets it. Waits for nobody: not for
    /// the run, not for the store, not for the disk. True when it was not stopped before.
    pub fn estop(&self) -> bool {
        let changed = self.shared.emergency_stop.stop();
        self.wake();
        changed
    }

    /// Writes down who stopped it, and waits a little for the stop to be on the disk. False when it is not by then:
    /// it holds all the same, and goes to the disk as soon as that takes it.
    pub fn record_estop(&self, who: Requester) -> bool {
        self.audit(ESTOP, who);
        self.shared.emergency_stop.wait_until_kept(KEPT_WITHIN)
    }

    /// The emergency stop that holds: what a person who asks for a reset now has seen.
    pub fn held(&self) -> Result<Held, ResetFault> {
        self.shared.emergency_stop.held()
    }

    /// Takes back that emergency stop, once this is in the audit log: waits for the disk. The plate is paused then: it
    /// starts nothing by this. A stop that came since that one was found holds, and so does every stop once `is_awaited`
    /// says that nobody waits for the reset any more.
    pub fn reset(&self, held: Held, who: Requester, is_awaited: impl Fn() -> bool) -> Result<(), ResetFault> {
        let shared = &*self.shared;
        let mut is_written = false;
        let allow = || {
            if shared.job.running().is_some() {
                return Err(ResetFault::StillStopping);
            }
            shared.ledger.write_act(self.told("reset", who.clone())).map_err(ResetFault::Unwritten)?;
            is_written = true;
            // asked after the wait for the disk: a client without an answer assumes that the plate is still stopped
            is_awaited().then_some(()).ok_or(ResetFault::NotAwaited)
        };
        let pause = || {
            let remedy = "look at the plate, then resume";
            shared.pause(Some(Pause::new("reset", "reset after an emergency stop", remedy)));
        };
        let reset = shared.emergency_stop.reset(held, allow, pause);
        if is_written && reset.is_err() {
            self.audit("reset refused", who);
        }
        reset
    }

    /// Lets it take jobs again, and run its standing job. False while an emergency stop holds. Going on twice is going on.
    pub fn resume(&self, who: Requester) -> bool {
        if self.is_stopped() {
            return false;
        }
        let standing = self.shared.standing.as_ref();
        if self.shared.paused().is_some() || standing.is_some_and(|standing| standing.paused().is_some()) {
            self.audit("resume", who);
            self.shared.pause(None);
        }
        if let Some(standing) = standing {
            standing.pause(None);
        }
        self.wake();
        true
    }

    /// Pauses it, unless it is paused already; its standing job gives way.
    pub(super) fn pause(&self, why: Pause) {
        if self.shared.paused().is_none() {
            self.shared.pause(Some(why));
        }
        if let Some(standing) = &self.shared.standing {
            standing.give_way();
        }
    }

    /// Tells it that a job was queued: a standing job on it gives way.
    pub fn job_queued(&self) {
        if let Some(standing) = &self.shared.standing {
            standing.give_way();
        }
        self.wake();
    }

    /// Has it look what there is to do.
    pub(super) fn wake(&self) {
        self.worker.thread().unpark();
    }

    /// What of it works no more, though it should.
    pub(super) fn dead(&self) -> Option<String> {
        let ended = |what: &str, thread: &JoinHandle<()>| {
            thread.is_finished().then(|| format!("the {what} of plate {} has died", self.name()))
        };
        ended("worker", &self.worker).or_else(|| ended("event publisher", &self.publisher))
    }

    /// True once nothing of it works any more.
    pub(super) fn threads_ended(&self) -> bool {
        self.worker.is_finished() && self.publisher.is_finished()
    }

    /// Tells a job to end that the store has as running: it is on the plate, or about to come onto it. False when its
    /// run is over.
    pub fn cancel(&self, id: &JobId) -> bool {
        self.shared.job.cancel(id)
    }

    /// Tells those who watch a job of this plate that it has ended, though not on the plate.
    pub fn announce_end(&self, id: JobId, finished: StoredEvent) {
        self.shared.subscribers.offer(&JobEvent::finished(id, finished));
    }

    /// True while an emergency stop holds.
    pub fn is_stopped(&self) -> bool {
        self.shared.emergency_stop.holds()
    }

    /// Why it waits for a person to resume it; `None` when it does not.
    pub fn paused(&self) -> Option<Pause> {
        self.shared.paused()
    }

    /// How the stop that holds was answered; `None` without one, and while motors still sound.
    pub fn stop_times(&self) -> Option<StopTimes> {
        self.shared.emergency_stop.times()
    }

    /// The same, once the motors are silent; waits a moment for that.
    pub fn wait_until_silent(&self) -> Option<StopTimes> {
        self.shared.emergency_stop.wait_until_silent(SILENT_WITHIN)
    }

    /// How it is now.
    pub fn snapshot(&self) -> PlateSnapshot {
        self.shared.snapshot(self.clock.elapsed())
    }

    /// From now on `tap` is told what happens on it.
    pub fn subscribe(&self, tap: Arc<dyn EventSubscriber>) {
        self.shared.subscribers.add(tap);
    }

    /// The newest picture of the job on it and its age, unless it is too old to be shown; wishes for newer ones.
    pub fn picture(&self) -> Option<(Arc<Picture>, Duration)> {
        let now = self.clock.elapsed();
        let picture = self.shared.window.look(now)?;
        let age = now.saturating_sub(picture.taken);
        Some((picture, age))
    }

    /// The layout of the job, while that is on the plate.
    pub fn layout(&self, id: &JobId) -> Option<Arc<JobLayout>> {
        self.shared.job.layout(id)
    }

    /// A job as it may be queued, or everything that is wrong with it.
    pub fn validate(&self, text: &str, pace: Pace, key: Option<String>) -> Result<NewJob, Vec<Fault>> {
        validated(&self.shared.rules, text, pace, key)
    }

    /// Name and layout of a job that may be queued, or everything that is wrong with it. Queues nothing.
    pub fn check(&self, text: &str) -> Result<(String, JobLayout), Vec<Fault>> {
        laid_out(&self.shared.rules, text)
    }

    /// Notes what was done to it: in the log at once, in the audit log as soon as the store takes it.
    fn audit(&self, act: &str, who: Requester) {
        let entry = self.told(act, who);
        if !self.shared.ledger.note_act(entry.clone()) {
            tracing::error!("lost to the audit log, where too much waits: {entry:?}");
        }
    }

    /// Tells the log what is done to it; the same for the audit log.
    fn told(&self, act: &str, who: Requester) -> AuditEntry {
        let Requester { operator, reason, remote, token_name } = who;
        let plate = &self.shared.name;
        if act == ESTOP {
            tracing::warn!(plate, operator, reason, remote, token_name, "{act}");
        } else {
            tracing::info!(plate, operator, reason, remote, token_name, "{act}");
        }
        AuditEntry { plate: Some(plate.clone()), act: act.to_owned(), operator, reason, remote, token_name }
    }
}
