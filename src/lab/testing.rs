//! Rigs for the lab's tests, and an assertion for every table.

use std::path::PathBuf;

use super::{ExperimentResult, LabRig};
use upm_runner::config::RigSpec;

/// The rig of `configs/rigs/<name>.json` with its penny.
pub(super) fn lab_rig(name: &str) -> LabRig {
    let file = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join(format!("configs/rigs/{name}.json"));
    let spec = RigSpec::load(&file).unwrap();
    let penny = &spec.kinds[spec.kind("penny").unwrap()];
    LabRig { penny: penny.part(), model: spec.model, sim: spec.sim, seed: 1 }
}

/// Panics where a source is longer than fits a table.
pub(super) fn assert_sources_are_short(outcome: &ExperimentResult) {
    for figure in &outcome.figures {
        assert!(figure.source.chars().count() <= 70, "{}: {}", figure.name, figure.source);
    }
}
