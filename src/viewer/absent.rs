//! Stand-ins with the interface of this crate, for a build without Rerun.

use std::io;
use std::path::Path;

use upm_control::Sink;
use upm_recording::{RecordingOptions, RerunMode};

use crate::types::{RecordingError, RunContext};

/// Stand-in for a recording: accepts every fact and keeps none.
pub struct RerunSink(());

impl RerunSink {
    /// Refuses every mode but [`RerunMode::Off`].
    pub fn check(mode: &RerunMode) -> Result<(), RecordingError> {
        refuse(mode)
    }

    /// Starts no recording. Refuses every mode but [`RerunMode::Off`].
    pub fn start(
        mode: &RerunMode,
        _path: &Path,
        _live: Option<&LiveServer>,
        _context: RunContext,
        _keeping: &RecordingOptions,
    ) -> Result<Self, RecordingError> {
        refuse(mode).map(Self)
    }

    /// There is no viewer.
    pub fn finish(self) -> Result<bool, RecordingError> {
        Ok(false)
    }
}

impl Sink for RerunSink {}

/// Stand-in for a live stream, without values.
#[derive(Clone, Debug)]
pub enum LiveServer {}

impl LiveServer {
    /// Always fails with [`io::ErrorKind::Unsupported`].
    pub fn start(_port: Option<u16>, _history_bytes: u64) -> io::Result<Self> {
        Err(io::Error::new(io::ErrorKind::Unsupported, "this build was made without the feature `rerun`"))
    }

    /// The address of the stream.
    pub fn uri(&self) -> &str {
        match *self {}
    }
}

fn refuse(mode: &RerunMode) -> Result<(), RecordingError> {
    match mode {
        RerunMode::Off => Ok(()),
        mode => Err(RecordingError::NotBuiltIn { mode: mode.clone() }),
    }
}
