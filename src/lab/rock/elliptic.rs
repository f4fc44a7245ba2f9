//! Time that a block takes from one tilt to another under constant acceleration of the table: an elliptic integral of
//! the first kind (Singer and Seering, Eqs. 3.7 to 3.15).

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

use super::block::{Block, BlockTilt};
use crate::numerics::elliptic_f;

impl Block {
    /// Time from `from` to the tilt `to_rad`, without a turning point between them, s. `weight_mps2`, not negative, is
    /// `g + ẍ`. `None` for a tilt that the block does not reach.
    pub fn time_s(&self, from: BlockTilt, to_rad: f64, weight_mps2: f64) -> Option<f64> {
        let pull = self.stiffness_pm() * weight_mps2;
        if pull <= 0.0 {
            let time_s = (to_rad - from.tilt_rad) / from.speed_radps;
            return Some(time_s).filter(|time_s| *time_s >= 0.0);
        }
        let [from_rad, to_rad] = [from.tilt_rad, to_rad].map(|tilt_rad| self.flat_rad() + tilt_rad);
        // the constant A of Eq. 3.6: the sine of the angle at which the block would turn back
        let level = from_rad.sin() + 0.5 * from.speed_radps.powi(2) / pull;
        let starts_at_rest = from.speed_radps == 0.0;
        let [a, b] =
            [(from_rad, starts_at_rest), (to_rad, false)].map(|(angle_rad, turns)| part(angle_rad, level, turns));
        Some((b? - a?).abs() / (2.0 * pull).sqrt())
    }

    /// Angular speed at the tilt `to_rad`, rad/s, by energy; `None` for a tilt that is not reached.
    pub fn speed_radps(&self, from: BlockTilt, to_rad: f64, weight_mps2: f64) -> Option<f64> {
        let gained = 2.0 * self.stiffness_pm() * weight_mps2 * self.lift(to_rad, from.tilt_rad);
        let squared = from.speed_radps.powi(2) + gained;
        (squared >= 0.0).then(|| squared.sqrt())
    }
}

/// Indefinite integral of `1 / sqrt(level - sin φ)` at an angle; `turns` where the block turns back at that angle.
fn part(angle_rad: f64, level: f64, turns: bool) -> Option<f64> {
    let amplitude = FRAC_PI_4 + 0.5 * angle_rad;
    if level > 1.0 {
        let parameter = 2.0 / (level + 1.0);
        return Some(2.0 / (level + 1.0).sqrt() * elliptic_f(amplitude, parameter)).filter(|part| part.is_finite());
    }
    let parameter = 0.5 * (1.0 + level);
    let sine = amplitude.sin() / parameter.sqrt();
    let amplitude = if turns { FRAC_PI_2 } else { Some(sine).filter(|sine| *sine <= 1.0 + 1e-12)?.min(1.0).asin() };
    Some(std::f64::consts::SQRT_2 * elliptic_f(amplitude, parameter)).filter(|part| part.is_finite())
}

#[cfg(test)]
mod tests {
    use super::super::motion::stepped;
    use super::*;
    use crate::numerics::bisect;
    use proptest::prelude::*;
    use upm_core::units::GRAVITY_MPS2;

    /// The same time by stepping the equation of motion until the tilt is passed.
    fn integrated_s(block: &Block, from: BlockTilt, to_rad: f64, weight_mps2: f64) -> f64 {
        let (mut turn, mut t_s, step_s) = (from, 0.0, 1e-4);
        let rises = to_rad > from.tilt_rad;
        let passes = |turn: BlockTilt| (turn.tilt_rad >= to_rad) == rises;
        loop {
            let next = stepped(block, turn, step_s, |_| weight_mps2);
            if passes(next) {
                break;
            }
            (turn, t_s) = (next, t_s + step_s);
        }
        let passed = |after_s: f64| passes(stepped(block, turn, after_s, |_| weight_mps2));
        t_s + bisect([0.0, step_s], 60, passed)[1]
    }

    proptest! {
        /// The tolerance is 1e-6 of the time.
        #[test]
        fn time_is_that_of_the_integrated_equation(
            length_m in 0.005..0.1f64,
            slender in 0.3..3.0f64,
            share in 0.02..0.9f64,
            end in 0.0..0.95f64,
            weight in 0.05..20.0f64,
            speed in 0.0..2.0f64,
        ) {
            let block = Block { length_m, height_m: slender * length_m };
            let high_rad = share * block.balance_rad();
            let weight_mps2 = weight * GRAVITY_MPS2;
            let scale_radps = (block.stiffness_pm() * weight_mps2).sqrt();
            // falls from a tilt, initially at rest or not
            let falls = BlockTilt { tilt_rad: high_rad, speed_radps: -speed * scale_radps };
            let time_s = block.time_s(falls, end * high_rad, weight_mps2).unwrap();
            let exact_s = integrated_s(&block, falls, end * high_rad, weight_mps2);
            prop_assert!((time_s / exact_s - 1.0).abs() < 1e-6, "{time_s} {exact_s}");
            // rises with more speed than it needs, with more energy than at the balance or less
            let least = block.speed_radps(BlockTilt { tilt_rad: high_rad, speed_radps: 0.0 }, end * high_rad, weight_mps2).unwrap();
            let rises = BlockTilt { tilt_rad: end * high_rad, speed_radps: least * (1.001 + speed) };
            let time_s = block.time_s(rises, high_rad, weight_mps2).unwrap();
            let exact_s = integrated_s(&block, rises, high_rad, weight_mps2);
            prop_assert!((time_s / exact_s - 1.0).abs() < 1e-6, "{time_s} {exact_s}");
        }
    }
}
