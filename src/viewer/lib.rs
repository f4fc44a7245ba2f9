//! Recordings of runs for the Rerun viewer, in files and to viewers, and their movies.
//!
//! The feature `rerun` adds the Rerun SDK. Without it this crate has the same interface and makes no recordings;
//! [`BUILT_IN`] reports which it is. No code outside this crate checks the feature. [`Movie`] does without it.

#![cfg_attr(test, allow(clippy::disallowed_methods))]

#[cfg(not(feature = "rerun"))]
mod absent;
mod movie;
mod pieces;
#[cfg(feature = "rerun")]
mod rerun;
mod types;

use upm_recording::RerunMode;

pub use movie::Movie;
pub use types::{MovieContext, RecordingError, RunContext};

#[cfg(not(feature = "rerun"))]
pub use absent::RerunSink;
#[cfg(feature = "rerun")]
pub use rerun::RerunSink;

/// True if this build can make recordings.
pub const BUILT_IN: bool = cfg!(feature = "rerun");

/// Destination of recordings where none is named: the run folder, if this build can make them.
pub const USUAL_MODE: RerunMode = if BUILT_IN { RerunMode::Save } else { RerunMode::Off };
