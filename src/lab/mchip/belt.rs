//! The paper's abstract model (Fig. 11): a spring-loaded belt that feeds a part by viscous friction, in closed form.

use std::f64::consts::TAU;

use upm_core::units::GRAVITY_MPS2;

/// Mass of the part, kg, speed of the belt, m/s, stiffness of its springs, N/m: the paper's M, v and k.
const MASS_KG: f64 = 55e-9;
const SPEED_MPS: f64 = 1.1e-3;
const STIFFNESS_NPM: f64 = 0.294;
/// Friction at a part at rest over its weight, the paper's μ: from the slope of Table I.
const FRICTION: f64 = 1.04;

/// Depth to which the part sinks into the belt, m.
pub fn depth_m() -> f64 {
    MASS_KG * GRAVITY_MPS2 / STIFFNESS_NPM
}

/// Natural frequency of the vertical oscillation, Hz.
pub fn bounce_hz() -> f64 {
    (STIFFNESS_NPM / MASS_KG).sqrt() / TAU
}

/// Speed of the part under `force_n` along the feed, m/s: `F = μ M g (v' - v)/v`.
pub fn rate_mps(force_n: f64) -> f64 {
    SPEED_MPS * (1.0 + force_n / (FRICTION * MASS_KG * GRAVITY_MPS2))
}

/// Change of the rate with the force, (m/s)/N.
pub fn slope_mpspn() -> f64 {
    SPEED_MPS / (FRICTION * MASS_KG * GRAVITY_MPS2)
}

/// Displacement of a part from rest without a force, m.
pub fn way_m(time_s: f64) -> f64 {
    let settling_s = slope_mpspn() * MASS_KG;
    rate_mps(0.0) * (time_s - settling_s * (1.0 - (-time_s / settling_s).exp()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn published_belt_has_the_published_figures() {
        assert!((bounce_hz() - 368.0).abs() < 1.0, "{}", bounce_hz());
        assert!((slope_mpspn() * 1e-5 * 1e3 - 19.6).abs() < 0.1);
        assert!((rate_mps(-0.056e-5)).abs() < 1e-5);
        assert!((depth_m() - 1.835e-6).abs() < 1e-8);
    }
}
