use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::states::{PauseCause, PlateFinding, PlateState, StandingJob};
use crate::store::StoreError;
use upm_core::job::LayoutPart;
use upm_recording::{RecordingState, StopReport};

impl PauseCause {
    /// A pause after a job that ended for `reason`, which is followed by the remedy of its cause.
    pub(crate) fn after(stop: Option<&StopReport>, reason: &str) -> Self {
        let stated = stop.and_then(|stop| stop.remedy.as_deref());
        let code = stop.map_or("stopped", |stop| stop.code.code());
        let why = format!("the last job was stopped: {reason}");
        let remedy = stated.unwrap_or("look at the plate and its parts");
        Self { remedy_in_why: stated.is_some(), ..Self::new(code, &why, remedy) }
    }
}

/// A plate at one moment.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Plate {
    /// Name of the plate.
    pub name: String,
    /// Whether it is idle, runs a job, or is held by a pause or an emergency stop.
    pub state: PlateState,
    /// Why it is idle; empty when it runs a job or could.
    pub why: String,
    /// The cause of its pause; null unless it is paused.
    pub pause: Option<PauseCause>,
    /// The operator who let it go on after its last pause; null where none is known, or the daemon has begun since.
    #[serde(default)]
    pub resumed_by: Option<String>,
    /// The newest observation of the run on it.
    #[serde(flatten)]
    pub observation: Observation,
    /// Id of the job on it; null when there is none.
    pub job: Option<String>,
    /// The job that runs whenever its queue is empty; null when none is configured.
    pub standing_job: Option<StandingJob>,
    /// Number of jobs queued for it.
    pub queued: u64,
    /// Wall time since that observation, s; null before the first.
    pub age_s: Option<f64>,
    /// Side of the square plate, mm. Its centre is the origin of all positions.
    pub side_mm: f64,
    /// The kinds of parts that its rig knows.
    pub kinds: Vec<LayoutPart>,
    /// Frames that came more than one frame late, since the daemon started.
    pub deadline_misses: u64,
    /// Those of the job on it.
    pub job_deadline_misses: u64,
    /// Lag of plate time behind the clock in the present or last run, s: this computer was too slow.
    pub behind_s: f64,
    /// Size of the recording being written, MB; null while none is.
    pub recording_mb: Option<f64>,
    /// Emergency stops since the daemon started.
    #[serde(skip)]
    pub estops: u64,
    /// State of the recording of the job on it.
    #[serde(skip)]
    pub recording: Option<RecordingState>,
}

/// A run at one moment.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Observation {
    /// Current findings of the run on it that an operator should know of.
    pub findings: Vec<PlateFinding>,
    /// Plate time of the observation shown, from the start of its job, s.
    pub at_s: f64,
    /// Position of each part, mm.
    pub positions_mm: Vec<[f64; 2]>,
    /// Radius of each part, mm.
    pub radii_mm: Vec<f64>,
    /// Target position of each part, mm.
    pub targets_mm: Vec<[f64; 2]>,
    /// Share of the job that is done, 0 to 1.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub progress: f64,
    /// Current activity, as text.
    pub phase: String,
}

/// Why a plate was not reset.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum ResetError {
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
    NotPersisted(StoreError),
}
