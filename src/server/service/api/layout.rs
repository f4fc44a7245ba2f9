use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use upm_runner::config::RawBin;

/// The layout of a job on its plate as its file has it. It never changes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Layout {
    /// The parts, in the order of the job.
    pub parts: Vec<LayoutPart>,
    /// Where parts shall end, mm; empty for a task that names no places.
    pub targets_mm: Vec<[f64; 2]>,
    /// The bins, whose places are in mm from the plate's centre.
    pub bins: Vec<RawBin>,
    /// The paths to be followed.
    pub paths: Vec<LayoutPath>,
    /// True for a job that only its plate time limit ends.
    pub endless: bool,
}

/// A job that may be queued as it is.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Checked {
    /// Its name.
    pub name: String,
    /// The plate it would go to.
    pub plate: String,
    /// Its layout.
    pub layout: Layout,
}

/// A part of a layout, or a kind of part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LayoutPart {
    /// Name of its kind.
    pub kind: String,
    /// Its radius, mm.
    pub radius_mm: f64,
}

/// A path that a part shall follow.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LayoutPath {
    /// Its corners, mm.
    pub waypoints_mm: Vec<[f64; 2]>,
    /// True where it leads from the last corner back to the first.
    pub closed: bool,
}
