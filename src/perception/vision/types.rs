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
    /// Side of the plate, m; of a rectangle the one along x.
    pub side_m: f64,
    /// Height of the plate over its side: 1 for a square.
    pub aspect: f64,
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
}

/// A part tracked from frame to frame; it keeps its index in the list.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// The last good detection of it.
    pub seen: Detection,
    /// Frames since that detection; 0 when the newest frame shows it.
    pub frames_unseen: u32,
}
