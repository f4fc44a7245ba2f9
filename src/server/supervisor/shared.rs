use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};
use std::thread::JoinHandle;

use parking_lot::Mutex;

use super::current_job::CurrentJob;
use super::emergency_stop::EmergencyStop;
use super::preview::FramePreview;
use super::standing::Standing;
use super::validate::JobRules;
use super::{LayoutPartView, Plate, PlateState};
use crate::states::PauseCause;
use crate::store::{AuditEntry, JobId, Store};
use upm_core::job::StopCause;
use upm_core::rig::Trip;
use upm_core::time::{Clock, MonotonicClock};
use upm_core::units::mm_from_m;
use upm_recording::RecordingState;
use upm_runner::run::ExternalStop;

/// One plate, shared by its threads and its callers.
#[derive(Debug)]
pub struct PlateHandle {
    pub(super) name: String,
    pub(super) clock: MonotonicClock,
    /// The thread that runs its jobs.
    pub(super) worker: OnceLock<JoinHandle<()>>,
    /// Rules that its jobs are checked against.
    pub(super) rules: JobRules,
    pub(super) store: Arc<Store>,
    pub(crate) emergency_stop: EmergencyStop,
    pub(crate) job: CurrentJob,
    /// True once the daemon is shutting down.
    pub(super) ending: AtomicBool,
    pub(super) preview: FramePreview,
    /// The standing job.
    pub(super) standing: Option<Standing>,
    /// The cause of the plate's pause; `None` when it is not paused.
    pub(super) paused: Mutex<Option<PauseCause>>,
    /// Held while a pause or its end is written to the audit log, which keeps their order.
    pub(super) pausing: Mutex<()>,
    /// The last pause, or its end, that could not be written to the audit log.
    pub(super) unnoted: Mutex<Option<AuditEntry>>,
    /// Threads that write an emergency stop to the disk.
    pub(super) recorders: AtomicUsize,
    /// How often its worker has found no work.
    #[cfg(test)]
    pub(super) idled: std::sync::atomic::AtomicU64,
}

impl PlateHandle {
    /// True when the plate may take a job.
    pub(super) fn may_move(&self) -> bool {
        !self.emergency_stop.holds() && !self.ending.load(Ordering::SeqCst) && self.paused.lock().is_none()
    }

    /// The cause of the plate's pause.
    pub fn paused(&self) -> Option<PauseCause> {
        self.paused.lock().clone()
    }

    /// Pauses the plate, over a restart, too.
    pub(super) fn pause(&self, why: PauseCause) {
        let _order = self.pausing.lock();
        let entry = AuditEntry::of_plate(&self.name, AuditEntry::PAUSE, &why.why);
        if self.paused.lock().replace(why).is_none() {
            self.note_pausing(entry);
        }
    }

    /// Lets the plate go on; `entry` says who did.
    pub(super) fn go_on(&self, entry: AuditEntry) {
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
    pub(super) fn note_again(&self) -> bool {
        let mut unnoted = self.unnoted.lock();
        if unnoted.as_ref().is_some_and(|entry| self.store.audit(entry).is_ok()) {
            *unnoted = None;
        }
        unnoted.is_none()
    }

    /// Adds an entry to the audit log. A fault is logged: what the entry says holds in this daemon all the same.
    pub(super) fn note(&self, entry: &AuditEntry) {
        if let Err(fault) = self.store.audit(entry) {
            tracing::error!("not in the audit log: {entry:?}: {fault}");
        }
    }

    /// The cause for which the run on the plate was ended, for its journal and its report.
    pub(super) fn cause(&self) -> Option<ExternalStop> {
        let shutdown = || ExternalStop::of(StopCause::Shutdown, "the daemon ended");
        let is_ending = self.ending.load(Ordering::SeqCst);
        self.emergency_stop.cause().or_else(|| is_ending.then(shutdown)).or_else(|| self.job.cause())
    }

    /// Ends the run of `job` and cuts the motors because of a fault, if the run is still under control.
    pub(super) fn fail_job(&self, job: &JobId, why: ExternalStop) {
        self.job.fail(job, why, || {
            self.emergency_stop.interlock.trip(Trip::Watchdog);
        });
    }

    /// Shuts the plate down: motors to zero, and the run ends.
    pub(super) fn shut_down(&self) {
        self.ending.store(true, Ordering::SeqCst);
        self.emergency_stop.interlock.trip(Trip::Shutdown);
        self.job.end_run.store(true, Ordering::SeqCst);
    }

    /// The state of the plate now, without the number of jobs queued for it.
    pub fn snapshot(&self) -> Plate {
        let (paused, running) = (self.paused(), self.job.running());
        let (mut plate, at) = self.job.seen();
        if running.is_none() {
            plate.conditions.clear();
        }
        let (state, why, pause) = match (self.emergency_stop.holds(), paused, &running) {
            (true, ..) => (PlateState::Stopped, "emergency stop".to_owned(), None),
            (false, _, Some(_)) => (PlateState::Running, String::new(), None),
            (false, Some(pause), None) => (PlateState::Paused, pause.why.clone(), Some(pause)),
            (false, None, None) => (PlateState::Idle, String::new(), None),
        };
        let stands = running.as_ref().is_some_and(|running| running.standing);
        let recording = running.as_ref().map(|running| running.recording.state());
        Plate {
            name: self.name.clone(),
            state,
            why,
            pause,
            job: running.map(|running| running.job.to_string()),
            standing_job: self.standing.as_ref().map(|standing| standing.snapshot(stands)),
            age_s: at.map(|at| self.clock.elapsed().saturating_sub(at).as_secs_f64()),
            side_mm: mm_from_m(self.rules.rig.model.plate_side_m),
            kinds: self.rules.rig.kinds.iter().map(LayoutPartView::of).collect(),
            deadline_misses: self.job.pacing.misses(),
            behind_s: self.job.pacing.behind().as_secs_f64(),
            recording_mb: match recording {
                Some(RecordingState::Writing { bytes }) => Some(bytes as f64 * 1e-6),
                _ => None,
            },
            estops: self.emergency_stop.count.load(Ordering::Relaxed),
            recording,
            ..plate
        }
    }
}
