use std::path::PathBuf;
use std::sync::Arc;

use upm_core::ground_truth::GroundTruthHandle;
use upm_core::job::{Bin, LayoutPart, LayoutPath};
use upm_core::rig::RigModel;
use upm_planning::cor_library::Library;
use upm_planning::planner::PlanningMethod;
use upm_recording::RerunMode;

/// Data about a run for its recording.
#[derive(Clone, Debug)]
pub struct RunContext {
    /// Name of the job.
    pub name: String,
    /// Seed of the job's random numbers, shown with its name.
    pub seed: u64,
    /// Gives the centres of rotation.
    pub library: Arc<Library>,
    /// Gives the sizes of the plate and of the camera's frames.
    pub model: RigModel,
    /// Selects the views: those of rotations or of synthesised fields.
    pub method: PlanningMethod,
    /// Every part, in the order of the job.
    pub parts: Vec<LayoutPart>,
    /// The bins that parts are sorted into.
    pub bins: Vec<Bin>,
    /// Paths that parts shall follow.
    pub paths: Vec<LayoutPath>,
    /// Ground truth; `None` on a rig without it.
    pub truth: Option<GroundTruthHandle>,
}

/// Reason that a recording could not be made or is incomplete.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file could not be created.
    #[error("cannot create {path}: {reason}")]
    Create {
        /// Path of the file.
        path: PathBuf,
        /// Reason given by the system.
        reason: String,
    },
    /// The address is not that of a viewer.
    #[error("`{url}` is not a viewer address; expected something like rerun+http://127.0.0.1:9876/proxy: {reason}")]
    Address {
        /// The address given.
        url: String,
        /// The fault in it.
        reason: String,
    },
    /// The viewer could not be started.
    #[error("cannot start the Rerun viewer (`pip install rerun-sdk==0.36.3` brings one): {0}")]
    Spawn(String),
    /// A thread could not be started, or panicked.
    #[error("recorder thread: {0}")]
    Thread(String),
    /// This build does not include Rerun.
    #[error("expected off (this build has no feature `rerun`), found {mode}")]
    NotBuiltIn {
        /// The mode requested.
        mode: RerunMode,
    },
    /// Data could not be encoded or written; the file ends before them.
    #[error("recording {path} is not whole: {reason}")]
    Write {
        /// The file.
        path: PathBuf,
        /// The first failure.
        reason: String,
    },
}
