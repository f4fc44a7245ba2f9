//! Shapes in a job file, in place of coordinates that a person would have to work out. Units as in `job_file.rs`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::read::optional_mm;
use upm_core::geometry::Vec2;
use upm_core::units::{degrees, mm, mm_point};

/// Longest path data of a drawing, and its largest file, bytes.
pub(super) const LONGEST_DATA: usize = 4 << 20;

/// Places for the parts by one rule; exactly one of its keys.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub(crate) struct TargetRule {
    /// Evenly spaced from one point to another.
    pub(crate) line: Option<LineShape>,
    /// Row by row from the top left.
    pub(crate) grid: Option<GridShape>,
    /// Evenly spaced round a circle.
    pub(crate) circle: Option<CircleShape>,
    /// Along the lines of letters: a part at every end, corner and junction, the others evenly between them.
    pub(crate) text: Option<TextShape>,
    /// Evenly spaced along the lines of an SVG drawing.
    pub(crate) svg: Option<SvgShape>,
}

/// A straight row.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub(crate) struct LineShape {
    /// Place of the first part, mm.
    #[serde(rename = "from_mm", with = "mm_point")]
    #[schemars(with = "[f64; 2]", inner(range(min = -1000.0, max = 1000.0)))]
    pub(crate) from_m: Vec2,
    /// Place of the last part, mm.
    #[serde(rename = "to_mm", with = "mm_point")]
    #[schemars(with = "[f64; 2]", inner(range(min = -1000.0, max = 1000.0)))]
    pub(crate) to_m: Vec2,
}

/// Rows and columns. One of them may be left out: it follows from the number of parts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub(crate) struct GridShape {
    /// Middle of the grid, mm. Left out: the middle of the plate.
    #[serde(rename = "center_mm", default, with = "mm_point")]
    #[schemars(with = "[f64; 2]", inner(range(min = -1000.0, max = 1000.0)))]
    pub(crate) center_m: Vec2,
    /// Number of rows.
    #[schemars(range(min = 1, max = 64))]
    pub(crate) rows: Option<u32>,
    /// Number of columns.
    #[schemars(range(min = 1, max = 64))]
    pub(crate) columns: Option<u32>,
    /// Distance between the middles of neighbours in a row or a column, mm.
    #[serde(rename = "spacing_mm", with = "mm")]
    #[schemars(with = "f64", range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    pub(crate) spacing_m: f64,
}

/// A line of text.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub(crate) struct TextShape {
    /// Letters A to Z, digits, `+`, `-`, `/` and spaces. Small letters are written as capitals.
    #[schemars(length(min = 1, max = 32))]
    pub(crate) string: String,
    /// Height of a capital between the middles of its topmost and lowest parts, mm.
    #[serde(rename = "height_mm", with = "mm")]
    #[schemars(with = "f64", range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    pub(crate) height_m: f64,
    /// Middle of the text, mm. Left out: the middle of the plate.
    #[serde(rename = "center_mm", default, with = "mm_point")]
    #[schemars(with = "[f64; 2]", inner(range(min = -1000.0, max = 1000.0)))]
    pub(crate) center_m: Vec2,
}

/// A drawing: a file or path data, and its width or its height.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub(crate) struct SvgShape {
    /// Path of an SVG file relative to this one; its outlines are taken as a browser places them.
    pub(crate) file: Option<String>,
    /// Path data as in the attribute `d` of a `path` element, y downwards.
    #[schemars(length(min = 1, max = LONGEST_DATA))]
    pub(crate) d: Option<String>,
    /// Width of the drawing, mm; its height follows.
    #[serde(rename = "width_mm", default, with = "optional_mm")]
    #[schemars(with = "Option<f64>", skip_serializing_if = "Option::is_none")]
    #[schemars(range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    pub(crate) width_m: Option<f64>,
    /// Height of the drawing, mm; its width follows.
    #[serde(rename = "height_mm", default, with = "optional_mm")]
    #[schemars(with = "Option<f64>", skip_serializing_if = "Option::is_none")]
    #[schemars(range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    pub(crate) height_m: Option<f64>,
    /// Middle of the drawing, mm. Left out: the middle of the plate.
    #[serde(rename = "center_mm", default, with = "mm_point")]
    #[schemars(with = "[f64; 2]", inner(range(min = -1000.0, max = 1000.0)))]
    pub(crate) center_m: Vec2,
}

/// A circle, for places or to go round.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub(crate) struct CircleShape {
    /// Its centre, mm. Left out: the middle of the plate.
    #[serde(rename = "center_mm", default, with = "mm_point")]
    #[schemars(with = "[f64; 2]", inner(range(min = -1000.0, max = 1000.0)))]
    pub(crate) center_m: Vec2,
    /// Distance of the places or the path from the centre, mm.
    #[serde(rename = "radius_mm", with = "mm")]
    #[schemars(with = "f64", range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    pub(crate) radius_m: f64,
    /// Direction of its beginning from the centre, degrees counter-clockwise from x.
    #[serde(rename = "start_deg", default, with = "degrees")]
    #[schemars(with = "f64", range(min = -360.0, max = 360.0))]
    pub(crate) start_rad: f64,
    /// Runs clockwise, not counter-clockwise.
    #[serde(default)]
    pub(crate) clockwise: bool,
}

/// A closed figure: `x = w/2 sin(a t + phase)`, `y = h/2 sin(b t)`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub(crate) struct LissajousShape {
    /// Its middle, mm. Left out: the middle of the plate.
    #[serde(rename = "center_mm", default, with = "mm_point")]
    #[schemars(with = "[f64; 2]", inner(range(min = -1000.0, max = 1000.0)))]
    pub(crate) center_m: Vec2,
    /// Width and height, mm.
    #[serde(rename = "size_mm", with = "mm_point")]
    #[schemars(with = "[f64; 2]", inner(range(min = 1.0, max = 1000.0)))]
    pub(crate) size_m: Vec2,
    /// `a` and `b`, without a common factor: [1, 2] is a lying eight, [1, 1] an ellipse or a line.
    #[schemars(inner(range(min = 1, max = 9)))]
    pub(crate) frequencies: [u32; 2],
    /// Phase of x at the start, degrees.
    #[serde(rename = "phase_deg", default, with = "degrees")]
    #[schemars(with = "f64", range(min = -360.0, max = 360.0))]
    pub(crate) phase_rad: f64,
}
