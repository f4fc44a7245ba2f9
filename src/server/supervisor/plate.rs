use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::sync_channel;
use std::thread::{self, JoinHandle};
use std::time::Duration;

use super::latch::StopToken;
use super::shared::PlateInner;
use super::validate::{layout_of_submission, validated};
use super::{JobLayout, Pause, PlateSnapshot, PreviewPicture, ResetFault};
use crate::store::{AuditEntry, JobId, NewJob, Pace};
use upm_core::rig::StopTimes;
use upm_core::time::{Clock, MonotonicClock};
use upm_runner::config::Diagnostic;

/// Longest waits of an emergency stop for the motors to be silent, for the latch file and for the audit log.
const MOTORS_OFF_WITHIN: Duration = Duration::from_millis(400);
const PERSISTED_WITHIN: Duration = Duration::from_millis(400);

/// Most threads of a plate that write emergency stops: the disk writes one at a time, and each holds for all before it.
const RECORDERS: usize = 4;

/// Name of an emergency stop in the audit log.
const ESTOP: &str = "estop";

/// The requester of an operation, as far as known.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ResetRequester {
    /// Name that the requester gave.
    pub operator: String,
    /// Reason that the requester gave.
    pub reason: String,
    /// Network address of the requester.
    pub remote: String,
    /// Name of the token presented.
    pub token_name: String,
}

/// One plate and its thread.
#[derive(Debug)]
pub struct PlateHandle {
    pub(super) shared: Arc<PlateInner>,
    pub(super) clock: MonotonicClock,
    pub(super) worker: JoinHandle<()>,
}

impl PlateHandle {
    /// Name of the plate, as in the configuration.
    pub fn name(&self) -> &str {
        &self.shared.name
    }

    /// Stops the plate: motors to zero, the job ends, and nothing moves until an operator resets it. Never waits for
    /// the run, the store or the disk. True when it was not stopped before.
    pub fn estop(&self) -> bool {
        let changed = self.shared.emergency_stop.stop();
        self.wake();
        changed
    }

    /// Writes the stop to the disk, then to the audit log. Waits briefly for both. False when the stop is not on the
    /// disk by then: it holds all the same. A frozen disk holds the writing thread for as long as it is frozen.
    pub fn record_estop(&self, who: ResetRequester) -> bool {
        let (shared, entry) = (Arc::clone(&self.shared), self.audit_entry(ESTOP, who));
        let (sender, written) = sync_channel(2);
        if self.shared.recorders.fetch_add(1, Ordering::SeqCst) >= RECORDERS {
            self.shared.recorders.fetch_sub(1, Ordering::SeqCst);
            tracing::error!("not in the audit log, since the disk does not answer: {entry:?}");
            return false;
        }
        let record = move || {
            sender.try_send(shared.emergency_stop.persist()).ok();
            shared.note(&entry);
            shared.recorders.fetch_sub(1, Ordering::SeqCst);
        };
        if let Err(error) = thread::Builder::new().name("latch".into()).spawn(record) {
            self.shared.recorders.fetch_sub(1, Ordering::SeqCst);
            tracing::error!("an emergency stop cannot be written to the disk: {error}");
        }
        let is_persisted = written.recv_timeout(PERSISTED_WITHIN).unwrap_or(false);
        if is_persisted {
            // ends with the thread
            written.recv_timeout(PERSISTED_WITHIN).ok();
        }
        is_persisted
    }

    /// Writes what could not be written before: the latch, and the last pause or its end. False when something still is
    /// not on the disk. Waits for the disk.
    pub fn persist_again(&self) -> bool {
        let stop = &self.shared.emergency_stop;
        if !stop.is_persisted() {
            stop.persist();
        }
        self.shared.note_again() && stop.is_persisted()
    }

    /// The emergency stop that holds, as seen by an operator who requests a reset now.
    pub fn held(&self) -> Result<StopToken, ResetFault> {
        self.shared.emergency_stop.held()
    }

    /// Takes back that emergency stop once the reset is in the audit log: waits for the disk. The plate is then paused,
    /// so nothing starts. A stop made since `held` was read holds, and so does every stop once `is_listening` returns
    /// false.
    pub fn reset(
        &self,
        held: StopToken,
        who: ResetRequester,
        is_listening: impl Fn() -> bool,
    ) -> Result<(), ResetFault> {
        let shared = &*self.shared;
        let mut is_written = false;
        let allow = || {
            if shared.job.running().is_some() {
                return Err(ResetFault::StillStopping);
            }
            shared.store.audit(&self.audit_entry("reset", who.clone())).map_err(ResetFault::NotPersisted)?;
            is_written = true;
            // asked after the wait for the disk: a client without an answer assumes that the plate is still stopped
            is_listening().then_some(()).ok_or(ResetFault::NotAwaited)
        };
        let pause = || {
            let remedy = "look at the plate, then resume";
            shared.pause(Pause::new("reset", "reset after an emergency stop", remedy));
        };
        let reset = shared.emergency_stop.reset(held, allow, pause);
        if is_written && reset.is_err() {
            self.audit("reset refused", who);
        }
        reset
    }

    /// Lets the plate take jobs again, and run its standing job. False while an emergency stop holds. Idempotent.
    pub fn resume(&self, who: ResetRequester) -> bool {
        if self.is_stopped() {
            return false;
        }
        let standing = self.shared.standing.as_ref();
        if self.shared.paused().is_some() || standing.is_some_and(|standing| standing.paused().is_some()) {
            self.shared.resume(self.audit_entry(AuditEntry::RESUME, who));
        }
        if let Some(standing) = standing {
            standing.pause(None);
        }
        self.wake();
        true
    }

    /// Notifies the plate of a queued job: its standing job gives way.
    pub fn job_queued(&self) {
        if let Some(standing) = &self.shared.standing {
            standing.give_way();
        }
        self.wake();
    }

    /// Wakes the worker to check for work.
    pub(super) fn wake(&self) {
        self.worker.thread().unpark();
    }

    /// True once the thread of the plate has ended.
    pub(super) fn has_ended(&self) -> bool {
        self.worker.is_finished()
    }

    /// Ends a job that is running according to the store: it is on the plate, or about to begin on it. False when its
    /// run is over.
    pub fn cancel(&self, id: &JobId) -> bool {
        self.shared.job.cancel(id)
    }

    /// True while an emergency stop holds.
    pub fn is_stopped(&self) -> bool {
        self.shared.emergency_stop.holds()
    }

    /// The cause of its pause; `None` when it is not paused.
    pub fn paused(&self) -> Option<Pause> {
        self.shared.paused()
    }

    /// Response times of the stop that holds; `None` without one, and until the motors are silent.
    pub fn stop_times(&self) -> Option<StopTimes> {
        self.shared.emergency_stop.times()
    }

    /// The same, once the motors are silent; waits briefly for that.
    pub fn wait_until_motors_off(&self) -> Option<StopTimes> {
        self.shared.emergency_stop.wait_until_motors_off(MOTORS_OFF_WITHIN)
    }

    /// The state of the plate now.
    pub fn snapshot(&self) -> PlateSnapshot {
        self.shared.snapshot(self.clock.elapsed())
    }

    /// The newest picture of the job on the plate and its age, unless it is too old to be shown; requests further ones.
    /// Encodes it, which takes some 10 ms.
    pub fn picture(&self) -> Option<(Arc<PreviewPicture>, Duration)> {
        let now = self.clock.elapsed();
        let picture = self.shared.preview.latest(now)?;
        let age = now.saturating_sub(picture.taken);
        Some((picture, age))
    }

    /// Share of job `id` that is done, 0 to 1, while it is on the plate.
    pub fn progress_of(&self, id: &JobId) -> Option<f64> {
        let is_on_plate = self.shared.job.running().is_some_and(|running| running.job == *id);
        is_on_plate.then(|| self.shared.job.seen().observation.progress.clamp(0.0, 1.0))
    }

    /// The layout of job `id`, while it is on the plate.
    pub fn layout(&self, id: &JobId) -> Option<Arc<JobLayout>> {
        self.shared.job.layout(id)
    }

    /// A job ready to be queued, or all of its faults.
    pub fn validate(&self, text: &str, pace: Pace, key: Option<String>) -> Result<NewJob, Vec<Diagnostic>> {
        validated(&self.shared.rules, text, pace, key)
    }

    /// Name and layout of a job that may be queued, or all of its faults. Queues nothing.
    pub fn check(&self, text: &str) -> Result<(String, JobLayout), Vec<Diagnostic>> {
        layout_of_submission(&self.shared.rules, text)
    }

    /// Records an operation in the log and in the audit log.
    fn audit(&self, act: &str, who: ResetRequester) {
        self.shared.note(&self.audit_entry(act, who));
    }

    /// Logs an operation; returns the entry for the audit log.
    fn audit_entry(&self, act: &str, who: ResetRequester) -> AuditEntry {
        let ResetRequester { operator, reason, remote, token_name } = who;
        let plate = &self.shared.name;
        if act == ESTOP {
            tracing::warn!(plate, operator, reason, remote, token_name, "{act}");
        } else {
            tracing::info!(plate, operator, reason, remote, token_name, "{act}");
        }
        AuditEntry { plate: Some(plate.clone()), act: act.to_owned(), operator, reason, remote, token_name }
    }
}
