use std::time::Duration;

use super::LayoutPart;
use crate::states::{PauseCause, PlateCondition, PlateState, StandingJob};
use crate::store::{JobId, StoreFault};
use upm_core::geometry::Vec2;
use upm_core::time::PlateTime;
use upm_recording::{RecordingState, StopReport};

/// The cause of the pause of a plate or of its standing job, until an operator resumes it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pause {
    /// Its code and its remedy.
    pub cause: PauseCause,
    /// The cause in words.
    pub why: String,
}

impl Pause {
    /// A pause for the cause with this code, in words, and the operator's checks or actions.
    pub fn new(code: &'static str, why: &str, remedy: &str) -> Self {
        let (code, remedy) = (code.to_owned(), remedy.to_owned());
        Self { cause: PauseCause { code, remedy, remedy_in_why: false }, why: why.to_owned() }
    }

    /// A pause after a job that ended for `reason`.
    pub fn after(stop: Option<&StopReport>, reason: &str) -> Self {
        let stated = stop.and_then(|stop| stop.remedy.as_deref());
        let code = stop.map_or("stopped", |stop| stop.code.code());
        let why = format!("the last job was stopped: {reason}");
        let mut pause = Self::new(code, &why, stated.unwrap_or("look at the plate and its parts"));
        // the reason of a run's end is followed by the remedy of its cause
        pause.cause.remedy_in_why = stated.is_some();
        pause
    }
}

/// The newest observation of the parts on a plate.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LastObservation {
    /// Plate time of the frame, from the start of its job.
    pub at: PlateTime,
    /// Position of each part, m.
    pub positions_m: Vec<Vec2>,
    /// Radius of each part, m, from its kind.
    pub radii_m: Vec<f64>,
    /// Target position of each part, m.
    pub targets_m: Vec<Vec2>,
    /// Share of the job that is done, 0 to 1.
    pub progress: f64,
    /// Current activity, as text.
    pub phase: String,
    /// Current conditions that an operator should know of, the oldest first.
    pub conditions: Vec<PlateCondition>,
}

/// A plate at one moment.
#[derive(Clone, Debug, PartialEq)]
pub struct PlateSnapshot {
    /// Name of the plate.
    pub name: String,
    /// Side of the square plate, m.
    pub side_m: f64,
    /// The kinds of parts that its rig knows.
    pub kinds: Vec<LayoutPart>,
    /// Whether it is idle, runs a job, or is held by a pause or an emergency stop.
    pub state: PlateState,
    /// Why it is idle; empty when it runs a job or could.
    pub why: String,
    /// The cause of its pause; `None` unless it is paused.
    pub pause: Option<Pause>,
    /// The job on it.
    pub job: Option<JobId>,
    /// Its standing job, if it has one.
    pub standing: Option<StandingJob>,
    /// State of that job's recording.
    pub recording: Option<RecordingState>,
    /// The parts as last seen.
    pub observation: LastObservation,
    /// Wall time since that observation; `None` before the first.
    pub age: Option<Duration>,
    /// Address of its live stream for a Rerun viewer, `rerun+http://127.0.0.1:PORT/proxy`.
    pub live: Option<String>,
    /// Deadlines missed since the daemon started.
    pub deadline_misses: u64,
    /// Lag of plate time behind the clock in the present or last run.
    pub behind: Duration,
    /// Emergency stops since the daemon started.
    pub estops: u64,
}

/// Why a plate was not reset.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ResetFault {
    /// No emergency stop holds.
    #[error("the plate is not stopped")]
    NotStopped,
    /// The stopped job has not ended.
    #[error("the plate is still stopping")]
    StillStopping,
    /// A newer stop holds than the one to be reset.
    #[error("the plate was stopped again")]
    StoppedAgain,
    /// The client no longer waits for the answer.
    #[error("the client no longer waits for this reset")]
    NotAwaited,
    /// The audit log could not store the reset.
    #[error("reset refused: it could not be recorded ({0})")]
    NotPersisted(StoreFault),
}
