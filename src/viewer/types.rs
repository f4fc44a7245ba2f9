use std::path::PathBuf;
use std::sync::Arc;

use upm_chart::{Chart, Playback};
use upm_core::ground_truth::GroundTruthHandle;
use upm_core::rig::RigModel;
use upm_library::Library;
use upm_planner::Method;
use upm_recording::RerunMode;

/// What a recording should know of its run.
#[derive(Clone, Debug)]
pub struct RunContext {
    /// Name of the job.
    pub name: String,
    /// Its seed.
    pub seed: u64,
    /// Names the centres of rotation.
    pub library: Arc<Library>,
    /// The rig.
    pub model: RigModel,
    /// How cycles are planned.
    pub method: Method,
    /// Every part, in the order of the job.
    pub parts: Vec<PartLook>,
    /// Where everything truly is, where the rig tells.
    pub truth: Option<GroundTruthHandle>,
}

/// How a part is drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct PartLook {
    /// Name in this run: `penny-1`.
    pub id: String,
    /// Its kind.
    pub kind: String,
    /// Its outline, m.
    pub radius_m: f64,
}

/// Why a recording could not be made or is not whole.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file could not be made.
    #[error("cannot create {path}: {reason}")]
    Create {
        /// Where.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// The address is not one of a viewer.
    #[error("`{url}` is no viewer's address, like rerun+http://127.0.0.1:9876/proxy: {reason}")]
    Address {
        /// What was given.
        url: String,
        /// What is wrong with it.
        reason: String,
    },
    /// No viewer could be started.
    #[error("cannot start the Rerun viewer (`pip install rerun-sdk==0.36.3` brings one): {0}")]
    Spawn(String),
    /// A thread could not be started, or died.
    #[error("recorder thread: {0}")]
    Thread(String),
    /// It could not be made whole again; it stands as it was.
    #[error("recording {path} cannot be repaired: {reason}")]
    Repair {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// This build has no Rerun.
    #[error("expected off (this build has no feature `rerun`), found {mode}")]
    NotBuiltIn {
        /// What was asked for.
        mode: RerunMode,
    },
    /// Something could not be encoded or written; the file ends before it.
    #[error("recording {path} is not whole: {reason}")]
    Write {
        /// The file.
        path: PathBuf,
        /// What failed first.
        reason: String,
    },
}

/// What a finished recording holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RecordingStats {
    /// Size of the file, bytes.
    pub file_bytes: u64,
    /// Messages in it.
    pub messages: u64,
    /// Messages a viewer missed because it lagged.
    pub viewer_missed: u64,
    /// True when a viewer was fed and took all that was left at the end.
    pub viewer_caught_up: bool,
}

/// What was done to a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Repaired {
    /// Messages in it.
    pub messages: u64,
    /// Bytes behind the last whole message, which were left out.
    pub cut_bytes: u64,
    /// True when nothing was wrong with it but its name.
    pub was_whole: bool,
}

/// One experiment as a page of the viewer.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Experiment {
    /// Names the recording.
    pub title: String,
    /// The table of figures, Markdown.
    pub figures: String,
    /// Its charts.
    pub charts: Vec<Chart>,
    /// The motion of each part.
    pub motion: Option<Playback>,
}
