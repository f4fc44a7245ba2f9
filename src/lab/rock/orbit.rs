//! Square waves that carry a block from one peak to the next in one period (Singer and Seering, section 3.2, Fig. 4).

use super::block::{Block, BlockTilt};
use super::wave::Square;
use upm_core::units::GRAVITY_MPS2;

/// Bisections of the interval of accelerations.
const HALVINGS: usize = 80;
/// Energy of a kick that topples a block, as a multiple of the energy that just suffices.
const OVER: f64 = 1.05;
/// Length of the drive over the time that the block takes to its balance.
const BEYOND: f64 = 1.01;

/// One cycle of a rocking block, from a peak over an impact to the next peak.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RockingCycle {
    pub block: Block,
    /// Coefficient of restitution of its centre's normal speed.
    pub restitution: f64,
    /// Peaks at the beginning and at the end, rad.
    pub peaks_rad: [f64; 2],
    /// Tilt at which the table's acceleration turns upward, while the block falls, rad.
    pub from_rad: f64,
    /// Tilt at which it turns downward again, rad: before the impact, or after it where negative.
    pub to_rad: f64,
}

impl RockingCycle {
    /// The wave for this cycle: equal areas of acceleration upward and downward, and at no time free fall. `None` where
    /// no such wave exists.
    pub fn drive(&self) -> Option<Square> {
        let ratio = self.ratio(self.block.lift(0.0, self.peaks_rad[1]))?;
        let excess = |low_mps2: f64| {
            let [from_s, to_s, period_s] = self.times(low_mps2, ratio)?;
            let (up, down) = (ratio * low_mps2 - GRAVITY_MPS2, GRAVITY_MPS2 - low_mps2);
            Some(up * (to_s - from_s) - down * (period_s - to_s + from_s))
        };
        // the table's downward acceleration leaves some weight; the upward one adds to it
        let (mut few_mps2, mut much_mps2) = (GRAVITY_MPS2 / ratio, GRAVITY_MPS2);
        for _ in 0..HALVINGS {
            let middle_mps2 = 0.5 * (few_mps2 + much_mps2);
            *(if excess(middle_mps2)? < 0.0 { &mut few_mps2 } else { &mut much_mps2 }) = middle_mps2;
        }
        let [from_s, to_s, period_s] = self.times(much_mps2, ratio)?;
        let (up_mps2, down_mps2) = (ratio * much_mps2 - GRAVITY_MPS2, GRAVITY_MPS2 - much_mps2);
        Some(Square { up_mps2, down_mps2, from_s, to_s, period_s })
    }

    /// The wave that topples the block: downward at `down_mps2`, except in an interval that ends before the impact. It
    /// lasts until the block is beyond its balance. `None` where no acceleration suffices.
    pub fn kick(&self, down_mps2: f64) -> Option<Square> {
        let (block, low_mps2) = (self.block, GRAVITY_MPS2 - down_mps2);
        let ratio = self.ratio(OVER * block.lift(0.0, block.balance_rad()))?;
        let ([from_s, to_s, impact_s], after) = self.fall(low_mps2, ratio).filter(|_| self.to_rad >= 0.0)?;
        let rise_s = block.time_s(after, block.balance_rad(), low_mps2)?;
        let (up_mps2, period_s) = (ratio * low_mps2 - GRAVITY_MPS2, impact_s + BEYOND * rise_s);
        Some(Square { up_mps2, down_mps2, from_s, to_s, period_s })
    }

    /// Ratio of `g + ẍ` upward to that downward with which the block rises by `rise` of its arm after the impact.
    fn ratio(&self, rise: f64) -> Option<f64> {
        let &Self { block, restitution, peaks_rad: [before_rad, after_rad], from_rad, to_rad } = self;
        let is_ordered = (0.0..=before_rad).contains(&from_rad) && to_rad < from_rad && -to_rad <= after_rad;
        let kept = restitution * restitution;
        let fall = |from_rad, to_rad| block.lift(to_rad, from_rad);
        let (needed, given) = if to_rad >= 0.0 {
            (rise / kept - fall(before_rad, from_rad) - fall(to_rad, 0.0), fall(from_rad, to_rad))
        } else {
            let helped_rise = fall(-to_rad, 0.0);
            (rise - helped_rise - kept * fall(before_rad, from_rad), kept * fall(from_rad, 0.0) - helped_rise)
        };
        let ratio = needed / given;
        (is_ordered && given > 0.0 && ratio.is_finite() && ratio > 1.0).then_some(ratio)
    }

    /// Times at which the wave turns upward and downward, and the period, s, with `low_mps2` for `g + ẍ` downward.
    fn times(&self, low_mps2: f64, ratio: f64) -> Option<[f64; 3]> {
        let peak = BlockTilt { tilt_rad: self.peaks_rad[1], speed_radps: 0.0 };
        let ([from_s, to_s, impact_s], after) = self.fall(low_mps2, ratio)?;
        if self.to_rad >= 0.0 {
            return Some([from_s, to_s, impact_s + self.block.time_s(peak, 0.0, low_mps2)?]);
        }
        let to_s = impact_s + self.block.time_s(after, -self.to_rad, ratio * low_mps2)?;
        Some([from_s, to_s, to_s + self.block.time_s(peak, -self.to_rad, low_mps2)?])
    }

    /// The block's fall from the peak to the impact: switching times of the wave, time of the impact, s, and the
    /// rotation then.
    fn fall(&self, low_mps2: f64, ratio: f64) -> Option<([f64; 3], BlockTilt)> {
        let block = &self.block;
        let falls = |from: BlockTilt, to_rad, weight_mps2| {
            let speed_radps = -block.speed_radps(from, to_rad, weight_mps2)?;
            Some((block.time_s(from, to_rad, weight_mps2)?, BlockTilt { tilt_rad: to_rad, speed_radps }))
        };
        let peak = BlockTilt { tilt_rad: self.peaks_rad[0], speed_radps: 0.0 };
        let (from_s, turn) = falls(peak, self.from_rad, low_mps2)?;
        let (up_s, turn) = falls(turn, self.to_rad.max(0.0), ratio * low_mps2)?;
        let (rest_s, turn) = if turn.tilt_rad > 0.0 { falls(turn, 0.0, low_mps2)? } else { (0.0, turn) };
        let after = BlockTilt { tilt_rad: 0.0, speed_radps: -self.restitution * turn.speed_radps };
        Some(([from_s, from_s + up_s, from_s + up_s + rest_s], after))
    }
}

#[cfg(test)]
mod tests {
    use super::super::motion::{End, Release};
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Holds for every block, whichever side of the impact the upward acceleration ends on.
        #[test]
        fn drive_brings_the_block_to_its_peak_in_one_period(
            length_m in 0.01..0.1f64,
            slender in 0.4..2.5f64,
            restitution in 0.3..0.95f64,
            share in 0.05..0.5f64,
            from in 0.2..1.0f64,
            to in -0.9..0.9f64,
        ) {
            let block = Block { length_m, height_m: slender * length_m };
            let peak_rad = share * block.balance_rad();
            let from_rad = from * peak_rad;
            // after the impact little of the energy that the restitution leaves may be removed
            let to_rad = if to >= 0.0 { to * from_rad } else { 0.5 * to * restitution.powi(2) * from_rad };
            let cycle = RockingCycle { block, restitution, peaks_rad: [peak_rad; 2], from_rad, to_rad };
            let drive = cycle.drive().unwrap();
            prop_assert!(drive.down_mps2 < GRAVITY_MPS2 && drive.up_mps2 > 0.0);
            let areas = [drive.up_mps2 * (drive.to_s - drive.from_s), drive.down_mps2 * (drive.period_s - drive.to_s + drive.from_s)];
            prop_assert!((areas[0] / areas[1] - 1.0).abs() < 1e-9);
            let motion = Release { block, restitution, tilt_rad: peak_rad }.motion(&drive.wave(), 1.5 * drive.period_s);
            // a block that would leave the table is outside the model
            prop_assume!(motion.end != End::Lifts);
            let [at_s, tilt_rad] = motion.peaks[0];
            prop_assert!((tilt_rad / peak_rad - 1.0).abs() < 1e-6 && (at_s / drive.period_s - 1.0).abs() < 1e-4, "{at_s} {tilt_rad} {drive:?}");
        }
    }

    #[test]
    fn switching_at_peak_and_impact_needs_accelerations_that_the_restitution_alone_sets() {
        for (height_m, peak_rad) in [(0.02, 0.1), (0.04, 0.2)] {
            let block = Block { length_m: 0.03, height_m };
            let cycle =
                RockingCycle { block, restitution: 0.4, peaks_rad: [peak_rad; 2], from_rad: peak_rad, to_rad: 0.0 };
            let drive = cycle.drive().unwrap();
            assert!((drive.up_mps2 / GRAVITY_MPS2 - 0.6 / 0.4).abs() < 1e-9, "{drive:?}");
            assert!((drive.down_mps2 / GRAVITY_MPS2 - 0.6).abs() < 1e-9, "{drive:?}");
        }
    }
}
