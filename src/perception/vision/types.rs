use nalgebra::{Matrix2, Vector3};

use upm_core::geometry::{Homography, Lens, Vec2};

/// The table as found in a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Corners, px, clockwise from top left.
    pub corners_px: [Vec2; 4],
    /// Mean length of a side, px.
    pub side_px: f64,
    /// How far the table's x axis is turned counter-clockwise from the image's, rad, within ±π/4.
    pub rotation_rad: f64,
    /// Side of the plate, m.
    pub side_m: f64,
    /// The lens it was seen through.
    pub lens: Lens,
    /// Table coordinates (m) of ideal image coordinates (px).
    pub table_from_ideal: Homography,
    /// The way back.
    pub ideal_from_table: Homography,
    /// Where the camera's centre is, m, in the table frame: what parallax is measured from.
    pub camera_in_table_m: Vector3<f64>,
}

/// A part found in a whole frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Detection {
    /// Index into the kinds looked for.
    pub kind: usize,
    /// Centre of the outline, px.
    pub center_px: Vec2,
    /// Radius of the outline, px.
    pub radius_px: f64,
    /// Where the part's foot stands on the plate, m, parallax removed.
    pub position_m: Vec2,
    /// How well a solid disk fits, 0 to 1.
    pub score: f64,
    /// Covariance of the centre as measured, px²; what all parts share (lens, corners) is not in it.
    pub covariance_px2: Matrix2<f64>,
}

/// A round thing on the plate.
#[derive(Clone, Debug, PartialEq)]
pub struct Disc {
    /// Middle and radius of its outline, px.
    pub center_px: Vec2,
    /// Radius of the outline, px.
    pub radius_px: f64,
    /// Middle of the outline on the plate, m; the disc is taken as flat.
    pub at_m: Vec2,
    /// Radius of the outline on the plate, m.
    pub radius_m: f64,
    /// Share of the outline that is a sharp edge, 0 to 1; where neighbours touch and at the plate's edge is left out.
    pub outline_share: f64,
    /// How sharp that edge is, 0 to 1: low where a soft shadow, a glow or a blur hides the rim.
    pub crispness: f64,
    /// Gray level of its face as a part of the bare plate's there.
    pub level: f64,
    /// Covariance of the middle, px².
    pub covariance_px2: Matrix2<f64>,
}

/// Everything round on a plate, and how much its darkest and its lightest places stand out.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Survey {
    /// From the top of the picture to the bottom.
    pub discs: Vec<Disc>,
    /// Level of the darkest place of a small disc's size, as a part of the bare plate's.
    pub darkest: f64,
    /// Of the lightest.
    pub lightest: f64,
}

/// A part followed from frame to frame; it keeps its place in the list.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// The last good look at it.
    pub seen: Detection,
    /// Frames since that look; 0 when the newest frame shows it.
    pub frames_unseen: u32,
}

/// A gray picture of floats, for looking at intermediate results.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plane {
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
    /// Rows: distances, 0 at the first row.
    pub distances: usize,
    /// Pixels of one row.
    pub px_per_row: f64,
    /// `angles * distances` votes, row by row.
    pub votes: Vec<f32>,
    /// The four peaks taken: column and row.
    pub peaks: Vec<(usize, usize)>,
}

/// What the localisation went through, for people to look at.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Stages {
    /// Edge strength where an edge was found, else 0.
    pub edges: Plane,
    /// Hough votes of those edges.
    pub hough: HoughArray,
    /// Response of the first kind's disk kernel over the whole frame, 1 where a part covers it all.
    pub disk_response: Plane,
}
