use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use upm_core::job::{Bin, LayoutPart, LayoutPath};
use upm_core::units::{mm_from_m, places_mm};
use upm_runner::config::{JobLayout, KindSpec};

/// The layout of a job on its plate, from its file. It never changes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LayoutView {
    /// The parts, in the order of the job.
    pub parts: Vec<LayoutPartView>,
    /// Target position of each part, mm; empty for a task without target positions.
    pub targets_mm: Vec<[f64; 2]>,
    /// The bins, with positions in mm from the plate's centre.
    pub bins: Vec<Bin>,
    /// Paths that parts shall follow.
    pub paths: Vec<LayoutPathView>,
    /// True for a job that ends only at its plate time limit.
    pub endless: bool,
}

/// A part of a layout, or a kind of part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(rename = "LayoutPart")]
pub struct LayoutPartView {
    /// Name of its kind.
    pub kind: String,
    /// Radius of the kind's outline, mm.
    pub radius_mm: f64,
}

/// A path that a part shall follow.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(rename = "LayoutPath")]
pub struct LayoutPathView {
    /// Its corners, mm.
    pub waypoints_mm: Vec<[f64; 2]>,
    /// True for a path that leads from the last corner back to the first.
    pub closed: bool,
}

impl LayoutPartView {
    /// A part of the kind `spec`.
    pub(super) fn of(spec: &KindSpec) -> Self {
        Self { kind: spec.kind.name.clone(), radius_mm: mm_from_m(spec.kind.radius_m) }
    }
}

impl From<JobLayout> for LayoutView {
    fn from(layout: JobLayout) -> Self {
        let part = |part: LayoutPart| LayoutPartView { kind: part.kind, radius_mm: mm_from_m(part.radius_m) };
        let path =
            |LayoutPath { waypoints_m, closed, .. }| LayoutPathView { waypoints_mm: places_mm(&waypoints_m), closed };
        Self {
            parts: layout.parts.into_iter().map(part).collect(),
            targets_mm: places_mm(&layout.targets_m),
            bins: layout.bins,
            paths: layout.paths.into_iter().map(path).collect(),
            endless: layout.endless,
        }
    }
}
