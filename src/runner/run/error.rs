use std::io;
use std::path::Path;

use upm_core::document::{Diagnostic, reason};
use upm_core::rig::RigError;

/// Reason why a job was not run, or its files were not written.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// Faults of a file, a missing file, or a job or library that cannot be run.
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))]
    Input(Vec<Diagnostic>),
    /// A file of the run folder could not be written.
    #[error("cannot write {path}: {reason}")]
    Write {
        /// Path of the file.
        path: String,
        /// Cause of the failure.
        reason: String,
    },
    /// The recording cannot go to the chosen destination.
    #[error("--rerun: {0}")]
    RerunMode(String),
    /// The recording could not be started.
    #[error("recording: {0}")]
    Recording(String),
    /// The command that judges runs does not.
    #[error("--judge: {0}")]
    Judge(String),
    /// The rig is not available for this run.
    #[error("rig: {0}")]
    Rig(#[from] RigError),
}

impl From<Vec<Diagnostic>> for RunError {
    fn from(faults: Vec<Diagnostic>) -> Self {
        Self::Input(faults)
    }
}

impl From<Diagnostic> for RunError {
    fn from(fault: Diagnostic) -> Self {
        Self::Input(vec![fault])
    }
}

impl RunError {
    /// The file at `path` could not be written.
    pub(crate) fn write(path: &Path, error: &io::Error) -> Self {
        Self::Write { path: path.display().to_string(), reason: reason(error) }
    }

    /// Message with one line per fault.
    pub fn lines(&self) -> Vec<String> {
        self.to_string().lines().map(str::to_owned).collect()
    }

    /// True if the input is at fault, not the machine.
    pub fn is_bad_input(&self) -> bool {
        matches!(self, Self::Input(_) | Self::RerunMode(_) | Self::Judge(_))
    }
}
