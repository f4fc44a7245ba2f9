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

/// Measured value of the figure called `name`.
pub(super) fn measured(outcome: &ExperimentResult, name: &str) -> f64 {
    let figure = outcome.figures.iter().find(|figure| figure.name == name);
    figure.unwrap_or_else(|| panic!("no figure {name:?}")).measured
}

/// Points of the layer with this label in a chart.
pub(super) fn curve<'a>(outcome: &'a ExperimentResult, chart: &str, label: &str) -> &'a [[f64; 2]] {
    let chart = outcome.charts.iter().find(|one| one.name == chart).unwrap();
    &chart.layers.iter().find(|layer| layer.label == label).unwrap().points
}

/// Panics where a source is longer than fits a table.
pub(super) fn assert_sources_are_short(outcome: &ExperimentResult) {
    for figure in &outcome.figures {
        assert!(figure.source.chars().count() <= 70, "{}: {}", figure.name, figure.source);
    }
}
