use std::sync::Arc;

use upm_core::geometry::Vec2;
use upm_core::ground_truth::GroundTruthHandle;
use upm_core::job::{Bin, LayoutPart, LayoutPath};
use upm_core::rig::RigModel;
use upm_planning::cor_library::Library;
use upm_planning::planner::PlanningMethod;

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

/// Data about a run for its movie.
#[derive(Clone, Debug)]
pub struct MovieContext {
    /// Every part, in the order of the job.
    pub parts: Vec<LayoutPart>,
    /// Target of each part, m; empty for a task without targets.
    pub targets_m: Vec<Vec2>,
    /// The bins that parts are sorted into.
    pub bins: Vec<Bin>,
    /// Paths that parts shall follow.
    pub paths: Vec<LayoutPath>,
    /// Standard deviation of the camera's noise at each gray level.
    pub noise_sd: [f64; 256],
}

/// Reason that a recording could not be made or is incomplete, in words.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct RecordingError(pub(crate) String);
