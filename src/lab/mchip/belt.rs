//! The paper's abstract model (Fig. 11): a belt on springs that feeds a part by viscous friction, in closed form.

use std::f64::consts::TAU;

use upm_core::units::GRAVITY_MPS2;

/// A spring-loaded viscous conveyor belt and the part on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Belt {
    /// Mass of the part, kg.
    pub mass_kg: f64,
    /// Speed of the belt, m/s: the paper's v.
    pub speed_mps: f64,
    /// Stiffness of its springs, N/m: the paper's k.
    pub stiffness_npm: f64,
    /// Friction at a part at rest over its weight: the paper's μ.
    pub friction: f64,
}

impl Belt {
    /// The paper's figures: 55 µg, 1.1 mm/s, 294 dyn/cm, 1.04 (from the slope of Table I).
    pub fn published() -> Self {
        Self { mass_kg: 55e-9, speed_mps: 1.1e-3, stiffness_npm: 0.294, friction: 1.04 }
    }

    /// Depth to which the part sinks into the belt, m.
    pub fn depth_m(&self) -> f64 {
        self.mass_kg * GRAVITY_MPS2 / self.stiffness_npm
    }

    /// Natural frequency of the vertical oscillation, Hz.
    pub fn bounce_hz(&self) -> f64 {
        (self.stiffness_npm / self.mass_kg).sqrt() / TAU
    }

    /// Speed of the part under `force_n` along the feed, m/s: `F = μ M g (v' - v)/v`.
    pub fn rate_mps(&self, force_n: f64) -> f64 {
        self.speed_mps * (1.0 + force_n / (self.friction * self.mass_kg * GRAVITY_MPS2))
    }

    /// Change of the rate with the force, (m/s)/N.
    pub fn slope_mpspn(&self) -> f64 {
        self.speed_mps / (self.friction * self.mass_kg * GRAVITY_MPS2)
    }

    /// Displacement of a part under `force_n`, from rest, m.
    pub fn way_m(&self, force_n: f64, time_s: f64) -> f64 {
        let settling_s = self.slope_mpspn() * self.mass_kg;
        self.rate_mps(force_n) * (time_s - settling_s * (1.0 - (-time_s / settling_s).exp()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn published_belt_has_the_published_figures() {
        let belt = Belt::published();
        assert!((belt.bounce_hz() - 368.0).abs() < 1.0, "{}", belt.bounce_hz());
        assert!((belt.slope_mpspn() * 1e-5 * 1e3 - 19.6).abs() < 0.1);
        assert!((belt.rate_mps(-0.056e-5)).abs() < 1e-5);
        assert!((belt.depth_m() - 1.835e-6).abs() < 1e-8);
    }
}
