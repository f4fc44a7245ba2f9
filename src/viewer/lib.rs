//! The Rerun viewer's side of a run: recordings in files and live streams.
//!
//! The feature `rerun` brings the Rerun SDK. Without it this crate has the same interface and makes no recordings;
//! [`BUILT_IN`] tells which it is. Nothing outside this crate asks for the feature.

#[cfg(not(feature = "rerun"))]
mod absent;
#[cfg(feature = "rerun")]
mod rerun;
mod types;

pub use types::{Experiment, PartLook, RecordingError, RecordingStats, Repaired, RunContext};

#[cfg(not(feature = "rerun"))]
pub use absent::{LiveServer, RerunSink, record_experiment, record_located, repair_recording};
#[cfg(feature = "rerun")]
pub use rerun::{LiveServer, RerunSink, record_experiment, record_located, repair_recording};

/// True where this build makes recordings.
pub const BUILT_IN: bool = cfg!(feature = "rerun");
