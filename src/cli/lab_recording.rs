use std::path::Path;

use super::failure::Failure;
use crate::lab::Outcome;
use crate::recording::RerunMode;

/// Refuses a recording that cannot go where it was said to go, before anything is played.
#[cfg(feature = "rerun")]
pub(super) fn check(mode: &RerunMode) -> Result<(), Failure> {
    crate::recording::RerunSink::check(mode).map_err(|error| Failure::bad_input(format!("--rerun: {error}")))
}

/// Refuses every recording: this build has no Rerun.
#[cfg(not(feature = "rerun"))]
pub(super) fn check(mode: &RerunMode) -> Result<(), Failure> {
    match mode {
        RerunMode::Off => Ok(()),
        _ => Err(Failure::bad_input(format!("--rerun: found {mode}, allowed: off, as this build has no Rerun"))),
    }
}

/// Records the outcome into `path` and to the viewer of `mode`.
#[cfg(feature = "rerun")]
pub(super) fn record(mode: &RerunMode, path: &Path, title: &str, outcome: &Outcome) -> Result<(), Failure> {
    let stats = crate::recording::record_lab(mode, path, title, outcome)
        .map_err(|error| Failure::failed(format!("recording: {error}")))?;
    let live = matches!(mode, RerunMode::Connect { .. } | RerunMode::Spawn);
    if live && (!stats.viewer_caught_up || stats.viewer_missed > 0) {
        tracing::warn!("the viewer did not take all of it; {} is whole", path.display());
    }
    Ok(())
}

/// There is none to make.
#[cfg(not(feature = "rerun"))]
pub(super) fn record(_: &RerunMode, _: &Path, _: &str, _: &Outcome) -> Result<(), Failure> {
    Ok(())
}
