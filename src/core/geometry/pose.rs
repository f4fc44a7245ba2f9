use nalgebra::Rotation2;

use super::Vec2;

/// Where a planar body is: `coin_in_table`, `plate_in_table`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Position of the body's origin, m.
    pub position_m: Vec2,
    /// Heading, rad, counter-clockwise.
    pub heading_rad: f64,
}

impl Pose {
    /// The parent frame itself.
    pub const IDENTITY: Self = Self::at(Vec2::new(0.0, 0.0));

    /// A body at `position_m` that is not turned.
    #[inline]
    pub const fn at(position_m: Vec2) -> Self {
        Self { position_m, heading_rad: 0.0 }
    }

    /// A body point in the parent frame.
    #[inline]
    pub fn apply(&self, p_body_m: Vec2) -> Vec2 {
        self.position_m + Rotation2::new(self.heading_rad) * p_body_m
    }

    /// A parent point in the body's frame.
    #[inline]
    pub fn apply_inverse(&self, p_parent_m: Vec2) -> Vec2 {
        Rotation2::new(-self.heading_rad) * (p_parent_m - self.position_m)
    }
}
