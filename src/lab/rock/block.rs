//! A rectangular block that rocks from corner to corner on a table (Singer and Seering, section 3.1, Fig. 3).

/// A rectangular block as seen from the side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Block {
    /// Length of the face on which it stands, m.
    pub length_m: f64,
    pub height_m: f64,
}

/// Rotation of the block about the corner on which it stands: `tilt` is 0 when it is flat, whichever corner it is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BlockTilt {
    /// Angle of its face above the table, rad.
    pub tilt_rad: f64,
    /// Angular velocity, positive while the face rises, rad/s.
    pub speed_radps: f64,
}

impl Block {
    /// Distance `r` of the centre from a corner, m.
    pub fn arm_m(&self) -> f64 {
        0.5 * self.length_m.hypot(self.height_m)
    }

    /// Angle of the line from the corner to the centre above the table while the block is flat, rad.
    pub fn flat_rad(&self) -> f64 {
        self.height_m.atan2(self.length_m)
    }

    /// Tilt at which the block balances on its corner, and beyond which it topples, rad.
    pub fn balance_rad(&self) -> f64 {
        std::f64::consts::FRAC_PI_2 - self.flat_rad()
    }

    /// `m r / (I_c + m r²)` of Eq. 3.3a, 1/m; for a block `I_c = m r² / 3`.
    pub fn stiffness_pm(&self) -> f64 {
        0.75 / self.arm_m()
    }

    /// Rise of the centre between two tilts, as a fraction of `r`: `sin φ_to - sin φ_from`.
    pub fn lift(&self, from_rad: f64, to_rad: f64) -> f64 {
        let (middle, half) = (self.flat_rad() + 0.5 * (from_rad + to_rad), 0.5 * (to_rad - from_rad));
        2.0 * middle.cos() * half.sin()
    }

    /// Angular acceleration at a tilt (Eq. 3.3a), rad/s². `weight_mps2` is `g + ẍ`, with ẍ the table's acceleration.
    pub fn accel_radps2(&self, tilt_rad: f64, weight_mps2: f64) -> f64 {
        -self.stiffness_pm() * (self.flat_rad() + tilt_rad).cos() * weight_mps2
    }

    /// Force of the table on the corner over the block's mass (Eq. 3.3b), along the table and normal to it, m/s².
    pub fn contact_mps2(&self, turn: BlockTilt, weight_mps2: f64) -> [f64; 2] {
        let (sin, cos) = (self.flat_rad() + turn.tilt_rad).sin_cos();
        let accel_radps2 = self.accel_radps2(turn.tilt_rad, weight_mps2);
        let inward = turn.speed_radps.powi(2);
        let along = -sin * accel_radps2 - cos * inward;
        let normal = cos * accel_radps2 - sin * inward;
        [self.arm_m() * along, self.arm_m() * normal + weight_mps2]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use upm_core::units::GRAVITY_MPS2;

    const BLOCK: Block = Block { length_m: 0.04, height_m: 0.02 };

    #[test]
    fn balance_has_no_moment_and_a_released_long_block_a_quarter_contact_force() {
        assert!(BLOCK.accel_radps2(BLOCK.balance_rad(), GRAVITY_MPS2).abs() < 1e-12);
        let long = Block { length_m: 1.0, height_m: 1e-6 };
        let [_, normal] = long.contact_mps2(BlockTilt::default(), GRAVITY_MPS2);
        assert!((normal / GRAVITY_MPS2 - 0.25).abs() < 1e-6, "{normal}");
    }
}
