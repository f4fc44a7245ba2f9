use std::ops::{Add, Mul, Neg, Sub};

use nalgebra::Vector3;

use super::{Vec2, perp};

/// A planar velocity: the velocity of the frame's origin and the spin.
/// `v(p) = velocity + spin · p^⊥` (UPM paper, section 3.1).
///
/// A rotation has a finite centre; a translation is a rotation about a distant centre, and no code special-cases it.
///
/// ```
/// use upm_core::geometry::{Twist, Vec2};
/// let twist = Twist::about(Vec2::new(0.1, 0.0), 2.0);
/// assert!(twist.velocity_at(Vec2::new(0.1, 0.0)).norm() < 1e-15);
/// assert_eq!(twist.center_of_rotation(), Some(Vec2::new(0.1, 0.0)));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Twist {
    /// Velocity of the origin, m/s.
    pub velocity_mps: Vec2,
    /// Spin, rad/s, counter-clockwise.
    pub spin_radps: f64,
}

impl Twist {
    /// The twist without motion.
    pub const ZERO: Self = Self { velocity_mps: Vec2::new(0.0, 0.0), spin_radps: 0.0 };

    /// The twist with this velocity of the origin (m/s) and spin (rad/s).
    #[inline]
    pub fn new(vx_mps: f64, vy_mps: f64, spin_radps: f64) -> Self {
        Self { velocity_mps: Vec2::new(vx_mps, vy_mps), spin_radps }
    }

    /// `(v_x, v_y, ω)`, m/s and rad/s.
    #[inline]
    pub fn vector(&self) -> Vector3<f64> {
        Vector3::new(self.velocity_mps.x, self.velocity_mps.y, self.spin_radps)
    }

    /// The inverse of [`Twist::vector`].
    #[inline]
    pub fn from_vector(vector: Vector3<f64>) -> Self {
        Self::new(vector.x, vector.y, vector.z)
    }

    /// Rotation at `spin_radps` about `center_m`.
    #[inline]
    pub fn about(center_m: Vec2, spin_radps: f64) -> Self {
        Self { velocity_mps: -spin_radps * perp(center_m), spin_radps }
    }

    /// Velocity of the point `p_m`, m/s.
    #[inline]
    pub fn velocity_at(&self, p_m: Vec2) -> Vec2 {
        self.velocity_mps + self.spin_radps * perp(p_m)
    }

    /// The point with zero velocity, `C = (-v_y, v_x)/ω` (Eq. 6); `None` for a pure translation.
    #[inline]
    pub fn center_of_rotation(&self) -> Option<Vec2> {
        let center = perp(self.velocity_mps) / self.spin_radps;
        (center.x.is_finite() && center.y.is_finite()).then_some(center)
    }

    /// The unit field `τ(p)`: the direction of flow of a part at `p_m`; zero at the centre of rotation.
    #[inline]
    pub fn direction_at(&self, p_m: Vec2) -> Vec2 {
        let velocity = self.velocity_at(p_m);
        let speed = velocity.norm();
        if speed > 0.0 { velocity / speed } else { Vec2::zeros() }
    }
}

impl Mul<f64> for Twist {
    type Output = Self;
    #[inline]
    fn mul(self, scale: f64) -> Self {
        Self { velocity_mps: self.velocity_mps * scale, spin_radps: self.spin_radps * scale }
    }
}

impl Add for Twist {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        Self { velocity_mps: self.velocity_mps + other.velocity_mps, spin_radps: self.spin_radps + other.spin_radps }
    }
}

impl Sub for Twist {
    type Output = Self;
    #[inline]
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Neg for Twist {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        self * -1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn center_of_rotation_inverts_about(x in -10.0..10.0f64, y in -10.0..10.0f64, spin in prop_oneof![-9.0..-0.1f64, 0.1..9.0f64]) {
            let center = Vec2::new(x, y);
            let read = Twist::about(center, spin).center_of_rotation().unwrap();
            prop_assert!((read - center).norm() < 1e-12 * (1.0 + center.norm()));
        }

    }
}
