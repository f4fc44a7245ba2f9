//! Figures for the display of a synthesised motion.

use std::f64::consts::TAU;

use upm_core::geometry::{Twist, Vec2};
use upm_core::signal::TwistWave;

/// Number of moments sampled in a base period: 16 per period of the highest possible harmonic.
const MOMENTS: usize = 256;

/// The plate's velocity at moments spread evenly over one base period.
pub(super) fn over_a_period(wave: &TwistWave) -> impl Iterator<Item = Twist> + '_ {
    let step_s = TAU / wave.base_radps / MOMENTS as f64;
    (0..MOMENTS).map(move |i| wave.at(step_s * i as f64))
}

/// The direction in which friction pulls a part at rest at `p_m`, times its share of sliding friction: the mean of the
/// direction of the plate's velocity there (equation sheet, section 5).
pub(super) fn mean_direction(period: &[Twist], p_m: Vec2) -> Vec2 {
    period.iter().map(|twist| twist.direction_at(p_m)).sum::<Vec2>() / period.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pump_wave_pulls_along_its_field_by_the_papers_share() {
        let pump = Twist::about(Vec2::new(0.02, 0.0), 3.0);
        let period: Vec<Twist> = over_a_period(&TwistWave::pump(pump, 377.0)).collect();
        let p_m = Vec2::new(0.07, 0.03);
        let pulled = mean_direction(&period, p_m);
        assert!((pulled - pump.direction_at(p_m) * 0.2386).norm() < 6e-3, "one moment of 256 is 0.004: {pulled}");
    }
}
