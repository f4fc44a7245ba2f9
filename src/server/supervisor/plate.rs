use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::sync_channel;
use std::thread::{self, JoinHandle};
use std::time::Duration;

use bytes::Bytes;

use super::latch::StopToken;
use super::{LayoutView, PlateHandle, ResetFault};
use crate::states::PauseCause;
use crate::store::{AuditEntry, JobId, NewJob, Pace};
use upm_core::rig::StopTimes;
use upm_core::time::Clock;
use upm_runner::config::{Diagnostic, JobLayout};

/// Longest waits of an emergency stop for the motors to be silent, for the latch file and for the audit log.
const MOTORS_OFF_WITHIN: Duration = Duration::from_millis(400);
const PERSISTED_WITHIN: Duration = Duration::from_millis(400);

/// Most threads of a plate that write emergency stops, more than all doors confirm at once; a disk that hangs has no
/// more of them.
const RECORDERS: usize = 16;

/// Name of an emergency stop in the audit log.
const ESTOP: &str = "estop";

impl PlateHandle {
    /// Name of the plate, as in the configuration.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Stops the plate: motors to zero, the job ends, and nothing moves until an operator resets it. Never waits for
    /// the run, the store or the disk. True when it was not stopped before.
    pub fn estop(&self) -> bool {
        let changed = self.emergency_stop.stop();
        self.wake();
        changed
    }

    /// Writes the stop to the disk, then to the audit log. Waits briefly for both. False when the stop is not on the
    /// disk by then: it holds all the same. A frozen disk holds the writing thread for as long as it is frozen.
    pub fn record_estop(self: &Arc<Self>, who: AuditEntry) -> bool {
        let (shared, entry) = (Arc::clone(self), self.audit_entry(ESTOP, who));
        let (sender, written) = sync_channel(2);
        if self.recorders.fetch_add(1, Ordering::SeqCst) >= RECORDERS {
            self.recorders.fetch_sub(1, Ordering::SeqCst);
            tracing::error!("not in the audit log, since the disk does not answer: {entry:?}");
            return false;
        }
        let record = move || {
            sender.try_send(shared.emergency_stop.persist()).ok();
            shared.note(&entry);
            shared.recorders.fetch_sub(1, Ordering::SeqCst);
        };
        if let Err(error) = thread::Builder::new().name("latch".into()).spawn(record) {
            self.recorders.fetch_sub(1, Ordering::SeqCst);
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
        let stop = &self.emergency_stop;
        if !stop.latch.is_written() {
            stop.persist();
        }
        self.note_again() && stop.latch.is_written()
    }

    /// Takes back that emergency stop once the reset is in the audit log: waits for the disk. The plate is then paused,
    /// so nothing starts. A stop made since `held` was read holds, and so does every stop once `is_listening` returns
    /// false.
    pub fn reset(&self, held: StopToken, who: AuditEntry, is_listening: impl Fn() -> bool) -> Result<(), ResetFault> {
        let mut is_written = false;
        let allow = || {
            if self.job.running().is_some() {
                return Err(ResetFault::StillStopping);
            }
            self.store.audit(&self.audit_entry("reset", who.clone())).map_err(ResetFault::NotPersisted)?;
            is_written = true;
            // asked after the wait for the disk: a client without an answer assumes that the plate is still stopped
            is_listening().then_some(()).ok_or(ResetFault::NotAwaited)
        };
        let pause = || {
            let remedy = "look at the plate, then resume";
            self.pause(PauseCause::new("reset", "reset after an emergency stop", remedy));
        };
        let reset = self.emergency_stop.reset(held, allow, pause);
        if is_written && reset.is_err() {
            self.note(&self.audit_entry("reset refused", who));
        }
        reset
    }

    /// Lets the plate take jobs again, and run its standing job. False while an emergency stop holds. Idempotent.
    pub fn resume(&self, who: AuditEntry) -> bool {
        if self.emergency_stop.holds() {
            return false;
        }
        let standing = self.standing.as_ref();
        if self.paused().is_some() || standing.is_some_and(|standing| standing.paused().is_some()) {
            self.go_on(self.audit_entry(AuditEntry::RESUME, who));
        }
        if let Some(standing) = standing {
            standing.pause(None);
        }
        self.wake();
        true
    }

    /// Notifies the plate of a queued job: its standing job gives way.
    pub fn job_queued(&self) {
        if let Some(standing) = &self.standing {
            standing.give_way();
        }
        self.wake();
    }

    /// Wakes the worker to check for work.
    pub(super) fn wake(&self) {
        if let Some(worker) = self.worker.get() {
            worker.thread().unpark();
        }
    }

    /// True once the thread of the plate has ended.
    pub(super) fn has_ended(&self) -> bool {
        self.worker.get().is_some_and(JoinHandle::is_finished)
    }

    /// Response times of the motors once they are silent; `None` without a stop, and when they take too long.
    pub fn wait_until_motors_off(&self) -> Option<StopTimes> {
        self.emergency_stop.interlock.wait_until_motors_off(MOTORS_OFF_WITHIN)
    }

    /// The newest picture of the job on the plate, a PNG file, and its age, unless it is too old to be shown; requests
    /// further ones. Encodes it, which takes some 10 ms.
    pub fn picture(&self) -> Option<(Bytes, Duration)> {
        self.preview.latest(self.clock.elapsed())
    }

    /// Share of job `id` that is done, 0 to 1, while it is on the plate.
    pub fn progress_of(&self, id: &JobId) -> Option<f64> {
        self.job.is(id).then(|| self.job.seen().0.progress)
    }

    /// A job ready to be queued, without its key, or all of its faults.
    pub fn validate(&self, text: &str, pace: Pace) -> Result<NewJob, Vec<Diagnostic>> {
        self.rules.validated(text, pace)
    }

    /// Name and layout of a job that may be queued, or all of its faults. Queues nothing.
    pub fn check(&self, text: &str) -> Result<(String, LayoutView), Vec<Diagnostic>> {
        let job = self.rules.checked(text)?;
        Ok((job.name.clone(), JobLayout::of(&job).into()))
    }

    /// Logs an operation; returns the entry for the audit log.
    fn audit_entry(&self, act: &str, who: AuditEntry) -> AuditEntry {
        let AuditEntry { operator, reason, remote, token_name, .. } = &who;
        let plate = &self.name;
        if act == ESTOP {
            tracing::warn!(plate, operator, reason, remote, token_name, "{act}");
        } else {
            tracing::info!(plate, operator, reason, remote, token_name, "{act}");
        }
        AuditEntry { plate: Some(plate.clone()), act: act.to_owned(), ..who }
    }
}
