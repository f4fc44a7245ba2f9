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

/// Largest speed anywhere on a square plate of half side `half_side_m`, m/s. It occurs at a corner, since speed has no
/// maximum inside.
pub(super) fn strongest_speed_mps(wave: &TwistWave, half_side_m: f64) -> f64 {
    let corners = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)].map(|(x, y)| Vec2::new(x, y) * half_side_m);
    let fastest = |twist: Twist| corners.map(|corner| twist.velocity_at(corner).norm()).into_iter().fold(0.0, f64::max);
    over_a_period(wave).map(fastest).fold(0.0, f64::max)
}

/// The direction in which friction pulls a part at rest at `p_m`, times its share of sliding friction: the mean of the
/// direction of the plate's velocity there (equation sheet, section 5).
pub(super) fn mean_direction(period: &[Twist], p_m: Vec2) -> Vec2 {
    period.iter().map(|twist| twist.direction_at(p_m)).sum::<Vec2>() / period.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use upm_core::signal::TwistHarmonic;

    proptest! {
        #[test]
        fn no_point_of_the_plate_is_faster(v in proptest::array::uniform12(-1.0..1.0f64)) {
            let twist = |v: &[f64]| Twist::new(v[0], v[1], 10.0 * v[2]);
            let harmonics = v.chunks(6).map(|v| TwistHarmonic { cos: twist(&v[..3]), sin: twist(&v[3..]) });
            let wave = TwistWave { base_radps: 200.0, harmonics: harmonics.collect() };
            let half_m = 0.12;
            let grid = || (0..441).map(|i| Vec2::new(f64::from(i % 21 - 10), f64::from(i / 21 - 10)) * (half_m / 10.0));
            let fastest = over_a_period(&wave).flat_map(|twist| grid().map(move |p| twist.velocity_at(p).norm()));
            let fastest = fastest.fold(0.0, f64::max);
            prop_assert!((strongest_speed_mps(&wave, half_m) - fastest).abs() < 1e-9, "the grid has the corners");
        }
    }

    #[test]
    fn a_pump_wave_pulls_along_its_field_by_the_papers_share() {
        let pump = Twist::about(Vec2::new(0.02, 0.0), 3.0);
        let period: Vec<Twist> = over_a_period(&TwistWave::pump(pump, 377.0)).collect();
        let p_m = Vec2::new(0.07, 0.03);
        let pulled = mean_direction(&period, p_m);
        assert!((pulled - pump.direction_at(p_m) * 0.2386).norm() < 6e-3, "one moment of 256 is 0.004: {pulled}");
    }
}
