//! Recordings of what is no run. A build without Rerun makes none.

use std::path::Path;

use super::failure::Failure;
use crate::lab::Outcome;
use crate::recording::{LocalisedRecord, RerunMode};
#[cfg(feature = "rerun")]
use crate::recording::{RecordingError, RecordingStats, RerunSink, record_lab, record_located};

/// Refuses a recording that cannot go where it was said to go, before anything is done.
#[cfg(feature = "rerun")]
pub(super) fn check(mode: &RerunMode) -> Result<(), Failure> {
    RerunSink::check(mode).map_err(|error| Failure::bad_input(format!("--rerun: {error}")))
}

/// Refuses every recording: this build has no Rerun.
#[cfg(not(feature = "rerun"))]
pub(super) fn check(mode: &RerunMode) -> Result<(), Failure> {
    match mode {
        RerunMode::Off => Ok(()),
        _ => Err(Failure::bad_input(format!("--rerun: found {mode}, allowed: off, as this build has no Rerun"))),
    }
}

/// Records an experiment's outcome into `path` and to the viewer of `mode`.
#[cfg(feature = "rerun")]
pub(super) fn lab(mode: &RerunMode, path: &Path, title: &str, outcome: &Outcome) -> Result<(), Failure> {
    ended(mode, path, record_lab(mode, path, title, outcome))
}

/// There is none to make.
#[cfg(not(feature = "rerun"))]
pub(super) fn lab(_: &RerunMode, _: &Path, _: &str, _: &Outcome) -> Result<(), Failure> {
    Ok(())
}

/// Records how table and parts, of those names, were found in a picture, into `path` and to the viewer of `mode`.
#[cfg(feature = "rerun")]
pub(super) fn located(
    mode: &RerunMode,
    path: &Path,
    title: &str,
    found: &LocalisedRecord,
    names: &[&str],
) -> Result<(), Failure> {
    ended(mode, path, record_located(mode, path, title, found, names))
}

/// There is none to make.
#[cfg(not(feature = "rerun"))]
pub(super) fn located(_: &RerunMode, _: &Path, _: &str, _: &LocalisedRecord, _: &[&str]) -> Result<(), Failure> {
    Ok(())
}

#[cfg(feature = "rerun")]
fn ended(mode: &RerunMode, path: &Path, made: Result<RecordingStats, RecordingError>) -> Result<(), Failure> {
    let stats = made.map_err(|error| Failure::failed(format!("recording: {error}")))?;
    let live = matches!(mode, RerunMode::Connect { .. } | RerunMode::Spawn);
    if live && (!stats.viewer_caught_up || stats.viewer_missed > 0) {
        tracing::warn!("the viewer did not take all of it; {} is whole", path.display());
    }
    Ok(())
}
