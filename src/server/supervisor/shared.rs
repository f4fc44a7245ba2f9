use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use parking_lot::Mutex;

use super::current_job::{CurrentJob, TimedObservation};
use super::emergency_stop::EmergencyStop;
use super::preview::FramePreview;
use super::standing::Standing;
use super::validate::JobRules;
use super::{LayoutPart, Pause, PlateSnapshot, PlateState};
use crate::store::{AuditEntry, JobId, Store};
use upm_core::job::StopCause;
use upm_core::rig::Trip;
use upm_runner::run::ExternalStop;
use upm_viewer::LiveServer;

/// State shared by the threads of a plate and its callers.
#[derive(Debug)]
pub(super) struct PlateInner {
    pub name: String,
    /// Rules that its jobs are checked against.
    pub rules: JobRules,
    pub store: Arc<Store>,
    pub emergency_stop: EmergencyStop,
    pub job: CurrentJob,
    /// True once the daemon is shutting down.
    pub ending: AtomicBool,
    pub preview: FramePreview,
    /// The live stream of its runs.
    pub live: Option<LiveServer>,
    /// The standing job.
    pub standing: Option<Standing>,
    /// The cause of the plate's pause; `None` when it is not paused.
    pub paused: Mutex<Option<Pause>>,
    /// Held while a pause or its end is written to the audit log, which keeps their order.
    pub pausing: Mutex<()>,
    /// The last pause, or its end, that could not be written to the audit log.
    pub unnoted: Mutex<Option<AuditEntry>>,
    /// Threads that write an emergency stop to the disk.
    pub recorders: AtomicUsize,
    /// How often its worker has found no work.
    #[cfg(test)]
    pub idled: std::sync::atomic::AtomicU64,
}

impl PlateInner {
    /// True when the plate may take a job.
    pub fn may_move(&self) -> bool {
        !self.emergency_stop.holds() && !self.ending.load(Ordering::SeqCst) && self.paused.lock().is_none()
    }

    /// The cause of the plate's pause.
    pub fn paused(&self) -> Option<Pause> {
        self.paused.lock().clone()
    }

    /// Pauses the plate, over a restart, too.
    pub fn pause(&self, why: Pause) {
        let _order = self.pausing.lock();
        let entry = AuditEntry::of_plate(&self.name, AuditEntry::PAUSE, &why.why);
        if self.paused.lock().replace(why).is_none() {
            self.note_pausing(entry);
        }
    }

    /// Lets the plate go on; `entry` says who did.
    pub fn resume(&self, entry: AuditEntry) {
        let _order = self.pausing.lock();
        *self.paused.lock() = None;
        self.note_pausing(entry);
    }

    fn note_pausing(&self, entry: AuditEntry) {
        *self.unnoted.lock() = Some(entry);
        if !self.note_again() {
            tracing::error!(plate = self.name, "a pause or its end is not on the disk yet");
        }
    }

    /// Writes the last pause, or its end, to the audit log if it is not there; false when it still is not.
    pub fn note_again(&self) -> bool {
        let mut unnoted = self.unnoted.lock();
        if unnoted.as_ref().is_some_and(|entry| self.store.audit(entry).is_ok()) {
            *unnoted = None;
        }
        unnoted.is_none()
    }

    /// Adds an entry to the audit log. A fault is logged: what the entry says holds in this daemon all the same.
    pub fn note(&self, entry: &AuditEntry) {
        if let Err(fault) = self.store.audit(entry) {
            tracing::error!("not in the audit log: {entry:?}: {fault}");
        }
    }

    /// The cause for which the run on the plate was ended, for its journal and its report.
    pub fn cause(&self) -> Option<ExternalStop> {
        let shutdown = || ExternalStop::of(StopCause::Shutdown, "the daemon ended");
        let is_ending = self.ending.load(Ordering::SeqCst);
        self.emergency_stop.cause().or_else(|| is_ending.then(shutdown)).or_else(|| self.job.cause())
    }

    /// Ends the run of `job` and cuts the motors because of a fault, if the run is still under control.
    pub fn fail_job(&self, job: &JobId, why: ExternalStop) {
        self.job.fail(job, why, || {
            self.emergency_stop.interlock().trip(Trip::Watchdog);
        });
    }

    /// Shuts the plate down: motors to zero, and the run ends.
    pub fn shut_down(&self) {
        self.ending.store(true, Ordering::SeqCst);
        self.emergency_stop.interlock().trip(Trip::Shutdown);
        self.job.end_run.store(true, Ordering::SeqCst);
    }

    pub fn snapshot(&self, now: Duration) -> PlateSnapshot {
        let (paused, running) = (self.paused(), self.job.running());
        let job = running.as_ref().map(|running| running.job);
        let TimedObservation { observation, at } = self.job.seen();
        let (state, why, pause) = match (self.emergency_stop.holds(), paused, job) {
            (true, ..) => (PlateState::Stopped, "emergency stop".to_owned(), None),
            (false, _, Some(_)) => (PlateState::Running, String::new(), None),
            (false, Some(pause), None) => (PlateState::Paused, pause.why.clone(), Some(pause)),
            (false, None, None) => (PlateState::Idle, String::new(), None),
        };
        let stands = running.as_ref().is_some_and(|running| running.standing);
        PlateSnapshot {
            name: self.name.clone(),
            side_m: self.rules.rig.model.plate_side_m,
            kinds: self.rules.rig.kinds.iter().map(LayoutPart::of).collect(),
            state,
            why,
            pause,
            job,
            standing: self.standing.as_ref().map(|standing| standing.snapshot(stands)),
            recording: running.map(|running| running.recording.state()),
            observation,
            age: at.map(|at| now.saturating_sub(at)),
            live: self.live.as_ref().map(|live| live.uri().to_owned()),
            deadline_misses: self.job.pacing.misses(),
            behind: self.job.pacing.behind(),
            estops: self.emergency_stop.count(),
        }
    }
}
