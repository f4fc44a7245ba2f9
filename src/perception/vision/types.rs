use nalgebra::{Matrix2, Vector3};

use upm_core::geometry::{Homography, Lens, Vec2};

/// The table as located in a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Corners, px, clockwise from top left.
    pub corners_px: [Vec2; 4],
    /// Mean length of a side, px.
    pub side_px: f64,
    /// Rotation of the table's x axis from the image's, rad, counter-clockwise, within ±π/4.
    pub rotation_rad: f64,
    /// Side of the plate, m.
    pub side_m: f64,
    /// Lens of the camera.
    pub lens: Lens,
    /// Table coordinates (m) of ideal image coordinates (px).
    pub table_from_ideal: Homography,
    /// Ideal image coordinates (px) from table coordinates (m): the inverse.
    pub ideal_from_table: Homography,
    /// Camera centre in the table frame, m: the origin of parallax.
    pub camera_in_table_m: Vector3<f64>,
}

/// A part found in a whole frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Detection {
    /// Index into the kinds searched for.
    pub kind: usize,
    /// Centre of the outline, px.
    pub center_px: Vec2,
    /// Radius of the outline, px.
    pub radius_px: f64,
    /// Centre of the part's foot on the plate, m, parallax removed.
    pub position_m: Vec2,
    /// Match with a solid disk, 0 to 1.
    pub score: f64,
    /// Covariance of the measured centre, px²; errors common to all parts (lens, corners) are not included.
    pub covariance_px2: Matrix2<f64>,
}

/// A round object on the plate.
#[derive(Clone, Debug, PartialEq)]
pub struct DetectedDisc {
    /// Middle and radius of its outline, px.
    pub center_px: Vec2,
    /// Radius of the outline, px.
    pub radius_px: f64,
    /// Middle of the outline on the plate, m; the disc is assumed flat.
    pub at_m: Vec2,
    /// Radius of the outline on the plate, m.
    pub radius_m: f64,
    /// Share of the outline that is a sharp edge, 0 to 1; stretches where neighbours touch and at the plate's edge are
    /// left out.
    pub outline_share: f64,
    /// Sharpness of that edge, 0 to 1: low where a soft shadow, a glow or a blur hides the rim.
    pub crispness: f64,
    /// Gray level of its face as a fraction of the bare plate's there.
    pub level: f64,
    /// Covariance of the middle, px².
    pub covariance_px2: Matrix2<f64>,
}

/// All round objects on a plate, and the contrast of its darkest and its lightest place.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Survey {
    /// Discs sorted from the top of the picture to the bottom.
    pub discs: Vec<DetectedDisc>,
    /// Level of the darkest place of a small disc's size, as a fraction of the bare plate's.
    pub darkest: f64,
    /// Level of the lightest such place, as a fraction of the bare plate's.
    pub lightest: f64,
}

/// A part tracked from frame to frame; it keeps its index in the list.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// The last good detection of it.
    pub seen: Detection,
    /// Frames since that detection; 0 when the newest frame shows it.
    pub frames_unseen: u32,
}

/// A gray picture of floats, for inspection of intermediate results.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FloatImage {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width * height` values, row by row.
    pub values: Vec<f32>,
}

/// Votes over lines: the line `x cos a + y sin a = distance` about the image centre, y down.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HoughArray {
    /// Columns: angles, evenly over [0, 2π) so that the two directions of an edge's gradient stay apart.
    pub angles: usize,
    /// Rows: distances, starting at 0.
    pub distances: usize,
    /// Pixels of distance per row.
    pub px_per_row: f64,
    /// `angles * distances` votes, row by row.
    pub votes: Vec<f32>,
    /// The peaks taken as the table's four sides: column and row.
    pub peaks: Vec<(usize, usize)>,
}

/// Intermediate results of the localisation, for inspection.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DebugImages {
    /// Edge strength where an edge was found, else 0.
    pub edges: FloatImage,
    /// Hough votes of those edges.
    pub hough: HoughArray,
    /// Response of the first kind's disk kernel over the whole frame, relative to the strongest one of any kind.
    pub disk_response: FloatImage,
}
