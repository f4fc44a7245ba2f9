//! Rerun recordings of pictures, which are not runs.

use std::path::Path;

use upm_recording::{LocalisedRecord, RerunMode};
use upm_viewer::{RerunSink, record_located};

use super::output::Failure;

/// Refuses a recording that cannot be made.
pub(super) fn check_mode(mode: &RerunMode) -> Result<(), Failure> {
    RerunSink::check(mode).map_err(|error| Failure::bad_input(format!("--rerun: {error}")))
}

/// Records how table and parts, of those kinds, were found in a picture, into `path` and to the viewer of `mode`.
pub(super) fn located(
    mode: &RerunMode,
    path: &Path,
    title: &str,
    found: &LocalisedRecord,
    kinds: &[&str],
) -> Result<(), Failure> {
    let made = record_located(mode, path, title, found, kinds);
    let stats = made.map_err(|error| Failure::failed(format!("recording: {error}")))?;
    let live = matches!(mode, RerunMode::Connect { .. } | RerunMode::Spawn);
    if live && (!stats.viewer_caught_up || stats.viewer_missed > 0) {
        tracing::warn!("the viewer did not take all of it; {} is whole", path.display());
    }
    Ok(())
}
