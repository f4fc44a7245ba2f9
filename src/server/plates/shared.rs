use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use parking_lot::Mutex;

use sha2::{Digest, Sha256};

use super::crier::Taps;
use super::frames::Window;
use super::latch::Latch;
use super::standing::Standing;
use super::watchdog::{Deadlines, Vitals};
use super::{Pause, PlateSetup, PlateSnapshot, PlateState, Sight};
use crate::store::{JobId, Ledger};
use upm_core::job::StopCause;
use upm_core::rig::{Interlock, Trip};
use upm_library::Library;
use upm_recording::{RecordingSwitch, ScribeWatch};
use upm_runner::config::{DeadlinePolicy, RigSpec};
use upm_runner::run::{ExternalStop, PacingStats};
use upm_viewer::LiveServer;

/// What a plate's thread and everybody outside share.
#[derive(Debug)]
pub(super) struct Shared {
    pub name: String,
    pub rig: RigSpec,
    pub library: Arc<Library>,
    /// True to take jobs with faults.
    pub allow_faults: bool,
    library_sha256: String,
    pub ledger: Arc<dyn Ledger>,
    pub latch: Latch,
    pub interlock: Interlock,
    /// Tells the run on the plate to end.
    pub stop: Arc<AtomicBool>,
    /// The daemon ends.
    pub ending: AtomicBool,
    pub vitals: Vitals,
    /// True when the present run goes by the clock.
    pub real_time: AtomicBool,
    /// True when its deadlines are strict.
    pub strict: AtomicBool,
    pub pacing: Arc<PacingStats>,
    pub window: Window,
    pub taps: Arc<Taps>,
    /// Emergency stops since the daemon started.
    pub estops: AtomicU64,
    /// Where viewers see its runs.
    pub live: Option<LiveServer>,
    /// Runs whenever nothing is queued.
    pub standing: Option<Standing>,
    /// Whether a job may bring a library that does not agree with the plate's own.
    pub allow_inline_libraries: bool,
    /// Why the plate must not move until a person resumes it.
    paused: Mutex<Option<Pause>>,
    /// Held by a reset from its begin to its end, and by nobody else.
    pub resetting: Mutex<()>,
    turn: Mutex<Turn>,
    seen: Mutex<Seen>,
}

/// Whose turn it is on the plate.
#[derive(Debug, Default)]
struct Turn {
    running: Option<Running>,
    /// The job before it.
    last: Option<JobId>,
    /// A job that was told to end before it came onto the plate.
    unwanted: Option<JobId>,
}

/// The job on the plate.
#[derive(Clone, Debug)]
struct Running {
    job: JobId,
    /// True for a run of the standing job.
    standing: bool,
    recording: RecordingSwitch,
    journal: ScribeWatch,
    /// Why it was told to end.
    cause: Option<ExternalStop>,
}

#[derive(Clone, Debug, Default)]
struct Seen {
    sight: Sight,
    at: Option<Duration>,
}

impl Shared {
    /// A plate as it is set up, without a job of any kind.
    pub fn new(
        setup: PlateSetup,
        ledger: Arc<dyn Ledger>,
        latch: Latch,
        interlock: Interlock,
        live: Option<LiveServer>,
    ) -> Self {
        let PlateSetup { name, rig, library, paused, allow_faults, .. } = setup;
        let library_sha256 = sha256_hex(&library);
        Self {
            name,
            rig,
            library,
            allow_faults,
            library_sha256,
            ledger,
            latch,
            interlock,
            stop: Arc::default(),
            ending: AtomicBool::new(false),
            vitals: Vitals::default(),
            real_time: AtomicBool::new(false),
            strict: AtomicBool::new(false),
            pacing: Arc::default(),
            window: Window::default(),
            taps: Arc::default(),
            estops: AtomicU64::new(0),
            live,
            standing: None,
            allow_inline_libraries: false,
            paused: Mutex::new(paused),
            resetting: Mutex::default(),
            turn: Mutex::default(),
            seen: Mutex::default(),
        }
    }

    /// Notes what is seen; leaves it out while somebody looks.
    pub fn saw(&self, sight: &Sight, now: Duration) {
        let Some(mut seen) = self.seen.try_lock() else { return };
        seen.sight.clone_from(sight);
        seen.at = Some(now);
    }

    /// SHA-256 of a library's file form, in hex.
    pub fn sha256_of(&self, library: &Arc<Library>) -> String {
        if Arc::ptr_eq(library, &self.library) { self.library_sha256.clone() } else { sha256_hex(library) }
    }

    /// True from an emergency stop to its reset: the motors stop first, the latch a moment later.
    pub fn is_stopped(&self) -> bool {
        self.latch.is_stopped() || self.interlock.tripped() == Some(Trip::EStop)
    }

    /// True when the plate may take a job.
    pub fn may_move(&self) -> bool {
        !self.is_stopped() && !self.ending.load(Ordering::SeqCst) && self.paused.lock().is_none()
    }

    /// Why the plate must not move until a person resumes it.
    pub fn paused(&self) -> Option<Pause> {
        self.paused.lock().clone()
    }

    /// Pauses the plate, or lets it go on.
    pub fn pause(&self, why: Option<Pause>) {
        let paused = why.is_some();
        let before = std::mem::replace(&mut *self.paused.lock(), why);
        if before.is_some() != paused {
            self.ledger.note_paused(&self.name, paused);
        }
    }

    /// How the pacing of the run on the plate goes.
    pub fn deadlines(&self) -> Deadlines {
        let is_strict = self.strict.load(Ordering::Relaxed);
        Deadlines {
            policy: if is_strict { DeadlinePolicy::Strict } else { DeadlinePolicy::Relaxed },
            real_time: self.real_time.load(Ordering::Relaxed),
            misses: self.pacing.misses(),
            worst_frames: self.pacing.worst_frames(),
        }
    }

    /// The job on the plate.
    pub fn job(&self) -> Option<JobId> {
        self.turn.lock().running.as_ref().map(|running| running.job)
    }

    /// A job comes onto the plate; to end at once when it was told to before.
    pub fn begins(&self, job: JobId, standing: bool, recording: RecordingSwitch, journal: ScribeWatch) {
        *self.seen.lock() = Seen::default();
        self.vitals.clear();
        self.window.clear();
        let mut turn = self.turn.lock();
        let cause = (turn.unwanted.take() == Some(job)).then(cancelled);
        if cause.is_some() {
            self.stop.store(true, Ordering::SeqCst);
        }
        turn.running = Some(Running { job, standing, recording, journal, cause });
    }

    /// The recording of the job on the plate.
    pub fn recording(&self) -> Option<RecordingSwitch> {
        self.turn.lock().running.as_ref().map(|running| running.recording.clone())
    }

    /// The job that is driven on the plate, and its journal: not one of which only recording, journal and report are
    /// still to be written.
    pub fn driven(&self) -> Option<(JobId, ScribeWatch)> {
        let turn = self.turn.lock();
        let running = turn.running.as_ref().filter(|_| !self.vitals.is_over())?;
        Some((running.job, running.journal.clone()))
    }

    /// Why the run on the plate was told to end, for its journal and its report.
    pub fn cause(&self) -> Option<ExternalStop> {
        if self.is_stopped() {
            return Some(ExternalStop::of(StopCause::Estop, "emergency stop"));
        }
        if self.ending.load(Ordering::SeqCst) {
            return Some(ExternalStop::of(StopCause::Shutdown, "the daemon ended"));
        }
        self.turn.lock().running.as_ref()?.cause.clone()
    }

    /// The job on the plate is over; why it was told to end, if it was.
    pub fn ends(&self) -> Option<ExternalStop> {
        let mut turn = self.turn.lock();
        let running = turn.running.take()?;
        turn.last = Some(running.job);
        running.cause
    }

    /// Tells `job`, which the store has as running, to end: now, or as soon as it comes onto the plate. False when its
    /// run is over.
    pub fn cancel(&self, job: &JobId) -> bool {
        let Turn { running, last, unwanted } = &mut *self.turn.lock();
        match running {
            Some(running) if running.job == *job => {
                running.cause.get_or_insert_with(cancelled);
                self.stop.store(true, Ordering::SeqCst);
                true
            }
            None if *last != Some(*job) => {
                *unwanted = Some(*job);
                true
            }
            _ => false,
        }
    }

    /// Stops `job` because something is wrong with it, as long as it is driven on the plate: what is seen of it later
    /// is no fault of the next one, nor of a plate at rest.
    pub fn bark(&self, job: &JobId, why: ExternalStop) {
        let mut turn = self.turn.lock();
        let driven = turn.running.as_mut().filter(|running| running.job == *job && !self.vitals.is_over());
        if let Some(running) = driven {
            running.cause.get_or_insert(why);
            self.stop.store(true, Ordering::SeqCst);
            self.interlock.trip(Trip::Watchdog);
        }
    }

    pub fn snapshot(&self, now: Duration) -> PlateSnapshot {
        let (paused, running) = (self.paused(), self.turn.lock().running.clone());
        let job = running.as_ref().map(|running| running.job);
        let Seen { sight, at } = self.seen.lock().clone();
        let (state, why, pause) = match (self.is_stopped(), paused, job) {
            (true, ..) => (PlateState::Stopped, "emergency stop".to_owned(), None),
            (false, _, Some(_)) => (PlateState::Running, String::new(), None),
            (false, Some(pause), None) => (PlateState::Paused, pause.why.clone(), Some(pause)),
            (false, None, None) => (PlateState::Idle, String::new(), None),
        };
        let age = at.map(|at| now.saturating_sub(at));
        let stands = running.as_ref().is_some_and(|running| running.standing);
        PlateSnapshot {
            name: self.name.clone(),
            side_m: self.rig.model.plate_side_m,
            state,
            why,
            pause,
            job,
            standing: self.standing.as_ref().map(|standing| standing.snapshot(stands)),
            recording: running.map(|running| running.recording.state()),
            sight,
            age,
            live: self.live.as_ref().map(|live| live.uri().to_owned()),
            deadline_misses: self.pacing.misses(),
            behind: self.pacing.behind(),
            estops: self.estops.load(Ordering::Relaxed),
        }
    }
}

fn cancelled() -> ExternalStop {
    ExternalStop::of(StopCause::Cancelled, "cancelled by request")
}

fn sha256_hex(library: &Library) -> String {
    Sha256::digest(library.to_json().as_bytes()).iter().map(|byte| format!("{byte:02x}")).collect()
}
