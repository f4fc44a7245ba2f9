//! Stand-ins with the interface of this crate, for a build without Rerun.

use std::path::Path;

use upm_control::Sink;
use upm_recording::{RecordingOptions, RerunMode};

use crate::types::{RecordingError, RunContext};

/// Stand-in for a recording: accepts every fact and keeps none.
pub struct RerunSink(());

impl RerunSink {
    /// Refuses every mode but [`RerunMode::Off`].
    pub fn check(mode: &RerunMode) -> Result<(), RecordingError> {
        match mode {
            RerunMode::Off => Ok(()),
            mode => Err(RecordingError(format!("expected off (this build has no feature `rerun`), found {mode}"))),
        }
    }

    /// Starts no recording. Refuses every mode but [`RerunMode::Off`].
    pub fn start(
        mode: &RerunMode,
        _path: &Path,
        _context: RunContext,
        _keeping: &RecordingOptions,
    ) -> Result<Self, RecordingError> {
        Self::check(mode).map(Self)
    }

    /// There is no viewer.
    pub fn finish(self) -> Result<bool, RecordingError> {
        Ok(false)
    }
}

impl Sink for RerunSink {}
