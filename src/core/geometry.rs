//! Coordinate frames, poses, planar twists and the geometry of the pinhole camera.
//!
//! Frames are part of every name. `table` is fixed to the plate at rest: origin at its centre, x right and
//! y up as the camera sees it, z towards the camera, angles counter-clockwise. `plate` is fixed to the vibrating plate.
//! `image` is in pixels: (0, 0) is the centre of the top-left pixel, x right, y down.
//! `table_from_image` converts image coordinates to table coordinates.

mod homography;
mod lens;
mod polyline;
mod pose;
mod twist;

pub use homography::Homography;
pub use lens::Lens;
pub use polyline::{Polyline, Segment};
pub use pose::Pose;
pub use twist::Twist;

/// A planar vector or point: metres unless the name says pixels.
pub type Vec2 = nalgebra::Vector2<f64>;

/// `a` turned a quarter counter-clockwise, `a^⊥ = (-a_y, a_x)`.
#[inline]
pub fn perp(a: Vec2) -> Vec2 {
    Vec2::new(-a.y, a.x)
}

/// Square of the distance from `place` to the nearest of `points`; infinite where there is none.
pub fn nearest_distance_squared(points: &[Vec2], place: Vec2) -> f64 {
    points.iter().map(|point| (point - place).norm_squared()).fold(f64::INFINITY, f64::min)
}

/// The z component of the cross product, positive when `b` is counter-clockwise of `a`.
#[inline]
pub fn cross(a: Vec2, b: Vec2) -> f64 {
    a.x * b.y - a.y * b.x
}
