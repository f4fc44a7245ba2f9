//! Shapes in a job file, in place of coordinates that a person would have to work out.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Places for the parts by one rule; exactly one of its keys.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(extend("minProperties" = 1, "maxProperties" = 1))]
pub struct RawTargets {
    /// Evenly spaced from one point to another.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub line: Option<RawLine>,
    /// Row by row from the top left.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub grid: Option<RawGrid>,
    /// Evenly spaced round a circle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub circle: Option<RawCircle>,
    /// Along the lines of letters: a part at every end, corner and junction, the others evenly between them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub text: Option<RawText>,
    /// Evenly spaced along the lines of an SVG drawing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub svg: Option<RawSvg>,
}

/// A straight row.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawLine {
    /// Place of the first part, mm.
    #[schemars(inner(range(min = -1000.0, max = 1000.0)))]
    pub from_mm: [f64; 2],
    /// Place of the last part, mm.
    #[schemars(inner(range(min = -1000.0, max = 1000.0)))]
    pub to_mm: [f64; 2],
}

/// Rows and columns. One of them may be left out: it follows from the number of parts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawGrid {
    /// Middle of the grid, mm. Left out: the middle of the plate.
    #[serde(default)]
    #[schemars(inner(range(min = -1000.0, max = 1000.0)))]
    pub center_mm: [f64; 2],
    /// Number of rows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1, max = 64))]
    pub rows: Option<u32>,
    /// Number of columns.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1, max = 64))]
    pub columns: Option<u32>,
    /// Distance between the middles of neighbours in a row or a column, mm.
    #[schemars(range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    pub spacing_mm: f64,
}

/// A line of text.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawText {
    /// Letters A to Z, digits, `+`, `-`, `/` and spaces. Small letters are written as capitals.
    #[schemars(length(min = 1, max = 32))]
    pub string: String,
    /// Height of a capital between the middles of its topmost and lowest parts, mm.
    #[schemars(range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    pub height_mm: f64,
    /// Middle of the text, mm. Left out: the middle of the plate.
    #[serde(default)]
    #[schemars(inner(range(min = -1000.0, max = 1000.0)))]
    pub center_mm: [f64; 2],
}

/// A drawing: a file or path data, and its width or its height.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawSvg {
    /// Path of an SVG file relative to this one; its `path` elements are taken, with their transforms.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// Path data as in the attribute `d` of a `path` element, y downwards.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 1, max = 65536))]
    pub d: Option<String>,
    /// Width of the drawing, mm; its height follows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    pub width_mm: Option<f64>,
    /// Height of the drawing, mm; its width follows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    pub height_mm: Option<f64>,
    /// Middle of the drawing, mm. Left out: the middle of the plate.
    #[serde(default)]
    #[schemars(inner(range(min = -1000.0, max = 1000.0)))]
    pub center_mm: [f64; 2],
}

/// A circle, for places or to go round.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawCircle {
    /// Its centre, mm. Left out: the middle of the plate.
    #[serde(default)]
    #[schemars(inner(range(min = -1000.0, max = 1000.0)))]
    pub center_mm: [f64; 2],
    /// Distance of the places or the path from the centre, mm.
    #[schemars(range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    pub radius_mm: f64,
    /// Direction of its beginning from the centre, degrees counter-clockwise from x.
    #[serde(default)]
    #[schemars(range(min = -360.0, max = 360.0))]
    pub start_deg: f64,
    /// Runs clockwise, not counter-clockwise.
    #[serde(default)]
    pub clockwise: bool,
}

/// A closed figure: `x = w/2 sin(a t + phase)`, `y = h/2 sin(b t)`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawLissajous {
    /// Its middle, mm. Left out: the middle of the plate.
    #[serde(default)]
    #[schemars(inner(range(min = -1000.0, max = 1000.0)))]
    pub center_mm: [f64; 2],
    /// Width and height, mm.
    #[schemars(inner(range(min = 1.0, max = 1000.0)))]
    pub size_mm: [f64; 2],
    /// `a` and `b`, without a common factor: [1, 2] is a lying eight, [1, 1] an ellipse or a line.
    #[schemars(inner(range(min = 1, max = 9)))]
    pub frequencies: [u32; 2],
    /// Phase of x at the start, degrees.
    #[serde(default)]
    #[schemars(range(min = -360.0, max = 360.0))]
    pub phase_deg: f64,
}
