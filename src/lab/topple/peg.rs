//! A part that slides against a low ledge, and its critical speed of toppling (Singer and Seering, section 2).

use upm_core::units::GRAVITY_MPS2;

/// Shape of a part: divisors of its half length squared and its half height squared in the squared radius of gyration
/// about the horizontal axis across its motion, 3 for an edge and 4 for a circle's diameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape([f64; 2]);

impl Shape {
    pub const BLOCK: Self = Self([3.0, 3.0]);
    /// A cylinder on its face.
    pub const CYLINDER: Self = Self([4.0, 3.0]);
    /// A cylinder on its side, its axis along the motion.
    pub const LYING_CYLINDER: Self = Self([3.0, 4.0]);
}

/// A part on a flat surface, seen from the side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Peg {
    pub shape: Shape,
    /// Length along its direction of motion, m; a standing cylinder's diameter.
    pub length_m: f64,
    /// Height, m; a lying cylinder's diameter.
    pub height_m: f64,
}

/// A part against a ledge: position of its centre of mass relative to the ledge's top edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pivot {
    /// Distance of the centre behind the edge, m.
    pub behind_m: f64,
    /// Height of the centre above the edge, m.
    pub above_m: f64,
    /// Squared radius of gyration about the centre, m².
    pub gyration_m2: f64,
}

impl Peg {
    /// The part about the top edge of a ledge of height `ledge_m`; `None` for a ledge at or above its centre.
    pub fn pivot(&self, ledge_m: f64) -> Option<Pivot> {
        let (half_length_m, half_height_m) = (0.5 * self.length_m, 0.5 * self.height_m);
        let Shape([of_length, of_height]) = self.shape;
        let above_m = half_height_m - ledge_m;
        let gyration_m2 = half_length_m.powi(2) / of_length + half_height_m.powi(2) / of_height;
        (above_m > 0.0).then_some(Pivot { behind_m: half_length_m, above_m, gyration_m2 })
    }

    /// The same part on the face that met the ledge.
    pub fn toppled(&self) -> Self {
        let Shape([of_length, of_height]) = self.shape;
        Self { shape: Shape([of_height, of_length]), length_m: self.height_m, height_m: self.length_m }
    }
}

impl Pivot {
    /// Squared radius of gyration about the edge, `I_o / m` (below Eq. 2.1), m².
    fn about_edge_m2(&self) -> f64 {
        self.gyration_m2 + self.behind_m.powi(2) + self.above_m.powi(2)
    }

    /// Least speed at which the part topples (Eq. 2.3), m/s: angular momentum about the edge is conserved in the
    /// impact, and the energy after it must lift the centre over the edge.
    pub fn critical_mps(&self) -> f64 {
        let lift_m = self.behind_m.hypot(self.above_m) - self.above_m;
        (2.0 * GRAVITY_MPS2 * self.about_edge_m2() * lift_m).sqrt() / self.above_m
    }

    /// Sine of the angle at which the centre is above the edge, and the least one for which the edge only pushes at a
    /// part that rises at the critical speed. Of the force along and normal to the table that Eq. 2.3 needs at the sine
    /// `s`, the first is forward below 2/3 and the second downward where `1 + 2 s - 3 s² > I_o/(m r²)`: there the edge
    /// would pull.
    pub fn rise(&self) -> [f64; 2] {
        let arm_m2 = self.behind_m.powi(2) + self.above_m.powi(2);
        let under_root = 1.0 - 3.0 * self.gyration_m2 / arm_m2;
        let least = if under_root > 1e-9 { (1.0 + under_root.sqrt()) / 3.0 } else { 0.0 };
        [self.above_m / arm_m2.sqrt(), least]
    }
}

/// Ratio of the critical speeds of the two orientations of a block `b` by `b (1 + δ)` on a ledge of zero height (Eq.
/// 2.4): the lying one's over the standing one's.
pub fn ratio_of_orientations(delta: f64) -> f64 {
    let standing = Peg { shape: Shape::BLOCK, length_m: 1.0, height_m: 1.0 + delta };
    let critical = |peg: Peg| peg.pivot(0.0).map_or(f64::NAN, |pivot| pivot.critical_mps());
    critical(standing.toppled()) / critical(standing)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// `I_o` of a block is `(4/3) m (l² + h²)`, of a standing cylinder `m (5/4 l² + 4/3 h²)`.
        #[test]
        fn moments_about_a_corner_are_those_of_the_tables(length_m in 1e-3..0.1f64, height_m in 1e-3..0.1f64) {
            let (l2, h2) = (0.25 * length_m * length_m, 0.25 * height_m * height_m);
            for (shape, exact) in [
                (Shape::BLOCK, 4.0 / 3.0 * (l2 + h2)),
                (Shape::CYLINDER, 1.25 * l2 + 4.0 / 3.0 * h2),
                (Shape::LYING_CYLINDER, 4.0 / 3.0 * l2 + 1.25 * h2),
            ] {
                let pivot = Peg { shape, length_m, height_m }.pivot(0.0).unwrap();
                prop_assert!((pivot.about_edge_m2() / exact - 1.0).abs() < 1e-12);
            }
        }
    }
}
