use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use upm_runner::config::BinEntry;

/// The layout of a job on its plate, from its file. It never changes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LayoutView {
    /// The parts, in the order of the job.
    pub parts: Vec<LayoutPartView>,
    /// Target position of each part, mm; empty for a task without target positions.
    pub targets_mm: Vec<[f64; 2]>,
    /// The bins, with positions in mm from the plate's centre.
    pub bins: Vec<BinEntry>,
    /// Paths that parts shall follow.
    pub paths: Vec<LayoutPathView>,
    /// True for a job that ends only at its plate time limit.
    pub endless: bool,
}

/// A job that is ready to be queued.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Checked {
    /// Name of the job.
    pub name: String,
    /// Plate to which it would go.
    pub plate: String,
    /// Parts, targets, bins and paths that the job asks for.
    pub layout: LayoutView,
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
