use nalgebra::Rotation2;

use super::Vec2;

/// Position and heading of a planar body: `coin_in_table`, `plate_in_table`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Position of the body's origin, m.
    pub position_m: Vec2,
    /// Heading, rad, counter-clockwise.
    pub heading_rad: f64,
}

impl Pose {
    /// The pose of the parent frame itself.
    pub const IDENTITY: Self = Self::at(Vec2::new(0.0, 0.0));

    /// The pose at `position_m` with heading 0.
    #[inline]
    pub const fn at(position_m: Vec2) -> Self {
        Self { position_m, heading_rad: 0.0 }
    }

    /// Transforms a point of the body into the parent frame.
    #[inline]
    pub fn apply(&self, p_body_m: Vec2) -> Vec2 {
        self.position_m + Rotation2::new(self.heading_rad) * p_body_m
    }

    /// Transforms a point of the parent frame into the body's frame.
    #[inline]
    pub fn apply_inverse(&self, p_parent_m: Vec2) -> Vec2 {
        Rotation2::new(-self.heading_rad) * (p_parent_m - self.position_m)
    }
}
