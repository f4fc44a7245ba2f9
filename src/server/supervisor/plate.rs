use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, sync_channel};
use std::sync::{Arc, OnceLock};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use bytes::Bytes;
use parking_lot::Mutex;

use super::current_job::CurrentJob;
use super::emergency_stop::EmergencyStop;
use super::job_rules::{JobRules, Standing};
use super::latch::StopToken;
use super::preview::{FramePreview, OLDEST};
use super::{Observation, Plate, PlateState, ResetError};
use crate::states::PauseCause;
use crate::store::{AuditEntry, JobId, Store};
use upm_core::job::{LayoutPart, StopRequest};
use upm_core::rig::{PartKind, Trip};
use upm_core::time::{Clock, MonotonicClock};
use upm_core::units::mm_from_m;
use upm_recording::{RecordingState, RerunMode};
use upm_runner::config::KindSpec;
use upm_runner::run::ExternalStop;

/// Most threads of a plate that write emergency stops, more than all doors confirm at once; a disk that hangs has no
/// more of them.
const RECORDERS: usize = 16;

/// Name of an emergency stop in the audit log.
const ESTOP: &str = "estop";

/// One plate, shared by its threads and its callers.
#[derive(Debug)]
pub struct PlateHandle {
    pub(super) clock: MonotonicClock,
    /// The thread that runs its jobs.
    pub(super) worker: OnceLock<JoinHandle<()>>,
    /// Rules that its jobs are checked against.
    pub(crate) rules: JobRules,
    pub(super) store: Arc<Store>,
    pub(crate) emergency_stop: EmergencyStop,
    pub(crate) job: CurrentJob,
    /// True once the daemon is shutting down.
    pub(super) ending: AtomicBool,
    pub(super) preview: FramePreview,
    /// Destination of the runs' recordings.
    pub(super) rerun: RerunMode,
    /// Free bytes below which the standing job waits.
    pub(super) min_free_bytes: u64,
    /// True if the plate pauses after each job.
    pub(super) waits_after_jobs: bool,
    /// The standing job.
    pub(super) standing: Option<Standing>,
    /// The cause of the plate's pause; `None` when it is not paused.
    pub(super) paused: Mutex<Option<PauseCause>>,
    /// The operator who let it go on after its last pause.
    pub(super) resumed_by: Mutex<Option<String>>,
    /// Held while a pause or its end is written to the audit log, which keeps their order.
    pub(super) pausing: Mutex<()>,
    /// The last pause, or its end, that could not be written to the store.
    pub(super) unnoted: Mutex<Option<AuditEntry>>,
    /// Held by each thread that writes an emergency stop to the disk.
    pub(super) recorders: Arc<()>,
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
        let entry = AuditEntry::of_plate(self.name(), AuditEntry::PAUSE, &why.why);
        let before = self.paused.lock().replace(why.clone());
        *self.resumed_by.lock() = None;
        if before != Some(why) {
            self.note_pausing(entry);
        }
    }

    /// Lets the plate go on; `entry` says who did.
    pub(super) fn go_on(&self, entry: AuditEntry) {
        let _order = self.pausing.lock();
        *self.paused.lock() = None;
        *self.resumed_by.lock() = Some(entry.operator.clone()).filter(|name| !name.is_empty());
        self.note_pausing(entry);
    }

    fn note_pausing(&self, entry: AuditEntry) {
        *self.unnoted.lock() = Some(entry);
        if !self.note_again() {
            tracing::error!(plate = self.name(), "a pause or its end is not on the disk yet");
        }
    }

    /// Writes the last pause, or its end, to the store if it is not there; false when it still is not.
    pub(super) fn note_again(&self) -> bool {
        let mut unnoted = self.unnoted.lock();
        unnoted.take_if(|entry| self.store.set_pause(self.name(), self.paused().as_ref(), entry).is_ok());
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
        let shutdown = || ExternalStop::of(StopRequest::Shutdown, "the daemon ended");
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
        self.wake();
    }

    /// The state of the plate now, without the number of jobs queued for it.
    pub fn snapshot(&self) -> Plate {
        let (paused, running) = (self.paused(), self.job.running());
        let (mut observation, at) = self.job.seen();
        // parts stay where the last job left them; what it was about is over
        if running.is_none() {
            let Observation { positions_mm, radii_mm, at_s, .. } = observation;
            observation = Observation { positions_mm, radii_mm, at_s, ..Observation::default() };
        }
        let (state, why, pause) = match (self.emergency_stop.holds(), paused, &running) {
            (true, ..) => (PlateState::Stopped, "emergency stop".to_owned(), None),
            (false, _, Some(_)) => (PlateState::Running, String::new(), None),
            (false, Some(pause), None) => (PlateState::Paused, pause.why.clone(), Some(pause)),
            (false, None, None) => (PlateState::Idle, String::new(), None),
        };
        let misses = self.job.pacing.misses();
        let stands = running.as_ref().is_some_and(|running| running.standing);
        let recording = running.as_ref().map(|running| running.recording.state());
        let kind = |spec: &KindSpec| {
            let PartKind { name, radius_m, .. } = &spec.kind;
            LayoutPart { id: String::new(), kind: name.clone(), radius_m: *radius_m }
        };
        Plate {
            name: self.name().to_owned(),
            state,
            why,
            pause,
            resumed_by: self.resumed_by.lock().clone(),
            job: running.as_ref().map(|running| running.job.to_string()),
            standing_job: self.standing.as_ref().map(|standing| standing.snapshot(stands)),
            age_s: at.map(|at| self.clock.elapsed().saturating_sub(at).as_secs_f64()),
            side_mm: mm_from_m(self.rules.rig.model.plate_side_m),
            kinds: self.rules.rig.kinds.iter().map(kind).collect(),
            deadline_misses: misses,
            job_deadline_misses: running.map_or(0, |running| misses.saturating_sub(running.missed_before)),
            behind_s: self.job.pacing.behind().as_secs_f64(),
            recording_mb: match recording {
                Some(RecordingState::Writing { bytes }) => Some(bytes as f64 * 1e-6),
                _ => None,
            },
            estops: self.emergency_stop.count.load(Ordering::Relaxed),
            recording,
            observation,
            queued: 0,
        }
    }

    /// Name of the plate, as in the configuration.
    pub fn name(&self) -> &str {
        &self.rules.plate
    }

    /// Stops the plate: motors to zero, the job ends, and nothing moves until an operator resets it. Never waits for
    /// the run, the store or the disk. True when it was not stopped before.
    pub fn estop(&self) -> bool {
        let changed = self.emergency_stop.stop();
        self.wake();
        changed
    }

    /// Has a thread write the stop to the disk, then to the audit log. It tells whether the stop is on the disk, and
    /// hangs up once both are done; the stop holds all the same. A frozen disk holds that thread for as long as it is
    /// frozen.
    pub fn record_estop(self: &Arc<Self>, who: AuditEntry) -> Receiver<bool> {
        let (shared, entry) = (Arc::clone(self), self.audit_entry(ESTOP, who));
        let (sender, written) = sync_channel(1);
        let place = Arc::clone(&self.recorders);
        if Arc::strong_count(&place) > RECORDERS + 1 {
            tracing::error!("not in the audit log, since the disk does not answer: {entry:?}");
            return written;
        }
        let record = move || {
            sender.try_send(shared.emergency_stop.persist()).ok();
            shared.note(&entry);
            drop(place);
        };
        if let Err(error) = thread::Builder::new().name("latch".into()).spawn(record) {
            tracing::error!("an emergency stop cannot be written to the disk: {error}");
        }
        written
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
    pub fn reset(&self, held: StopToken, who: AuditEntry, is_listening: impl Fn() -> bool) -> Result<(), ResetError> {
        let mut is_written = false;
        let allow = || {
            if self.job.running().is_some() {
                return Err(ResetError::StillStopping);
            }
            self.store.audit(&self.audit_entry("reset", who.clone())).map_err(ResetError::NotPersisted)?;
            is_written = true;
            // asked after the wait for the disk: a client without an answer assumes that the plate is still stopped
            is_listening().then_some(()).ok_or(ResetError::NotAwaited)
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
        if self.paused().is_some() || standing.is_some_and(|standing| standing.paused.lock().is_some()) {
            self.go_on(self.audit_entry(AuditEntry::RESUME, who));
        }
        if let Some(standing) = standing {
            *standing.paused.lock() = None;
        }
        self.wake();
        true
    }

    /// Notifies the plate of a queued job: its standing job gives way.
    pub fn job_queued(&self) {
        if let Some(standing) = &self.standing {
            standing.give_way.store(true, Ordering::SeqCst);
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

    /// The newest picture of the job on the plate, a PNG file, and its age, unless it is too old to be shown; requests
    /// further ones. After a job its last picture, however old. Encodes it, which takes some 10 ms.
    pub fn picture(&self) -> Option<(Bytes, Duration)> {
        let oldest = if self.job.running().is_some() { OLDEST } else { Duration::MAX };
        self.preview.latest(self.clock.elapsed(), oldest)
    }

    /// Logs an operation; returns the entry for the audit log.
    fn audit_entry(&self, act: &str, who: AuditEntry) -> AuditEntry {
        let AuditEntry { operator, reason, remote, token_name, .. } = &who;
        let plate = self.name();
        if act == ESTOP {
            tracing::warn!(plate, operator, reason, remote, token_name, "{act}");
        } else {
            tracing::info!(plate, operator, reason, remote, token_name, "{act}");
        }
        AuditEntry { plate: Some(plate.to_owned()), act: act.to_owned(), ..who }
    }
}
