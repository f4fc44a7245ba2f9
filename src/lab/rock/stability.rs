//! Stability of a steady orbit: whether a block released elsewhere returns to it (Singer and Seering, Figs. 5, 6 and
//! 8).

use super::block::BlockTilt;
use super::motion::{End, Release};
use super::wave::Wave;

/// Deviation of tilt, and of angular speed in units of one per period, for finite differences.
const DEVIATION: f64 = 1e-6;
/// Periods after which a block that still rocks counts as captured.
const PERIODS: f64 = 40.0;
/// Starts tried between rest and the highest.
const STARTS: usize = 40;

impl Release {
    /// Largest magnitude of the factors by which small deviations from this orbit of period `wave` grow per period:
    /// below 1 the orbit is stable. NaN where the block does not complete a period.
    pub fn multiplier(&self, wave: &Wave) -> f64 {
        let period_s = wave.length_s();
        let scales = [DEVIATION, DEVIATION / period_s];
        let after = |deviation: [f64; 2]| {
            let turn = BlockTilt { tilt_rad: self.tilt_rad + deviation[0], speed_radps: deviation[1] };
            let motion = self.motion_from(turn, wave, period_s);
            (motion.end == End::Rocks).then_some([motion.last.tilt_rad, motion.last.speed_radps])
        };
        let column = |i: usize| {
            let mut deviation = [0.0; 2];
            deviation[i] = scales[i];
            let (more, less) = (after(deviation)?, after(deviation.map(|one| -one))?);
            Some([0, 1].map(|row| (more[row] - less[row]) / (2.0 * scales[row])))
        };
        let (Some([a, c]), Some([b, d])) = (column(0), column(1)) else { return f64::NAN };
        largest_eigenvalue([[a, b], [c, d]])
    }

    /// Lowest and highest start from which the block still rocks after forty periods, as a fraction of this one, within
    /// the contiguous range of captured starts around it. `None` where this start itself is lost.
    pub fn captured(&self, wave: &Wave) -> Option<[f64; 2]> {
        let highest_rad = 0.999 * self.block.balance_rad();
        let rocks =
            |tilt_rad: f64| Self { tilt_rad, ..*self }.motion(wave, PERIODS * wave.length_s()).end == End::Rocks;
        let reach = |to_rad: f64| {
            let starts = (1..=STARTS).map(|i| self.tilt_rad + (to_rad - self.tilt_rad) * i as f64 / STARTS as f64);
            starts.take_while(|tilt_rad| rocks(*tilt_rad)).last().unwrap_or(self.tilt_rad) / self.tilt_rad
        };
        rocks(self.tilt_rad).then(|| [reach(0.0), reach(highest_rad)])
    }
}

/// Largest magnitude of the eigenvalues of a 2×2 matrix.
fn largest_eigenvalue([[a, b], [c, d]]: [[f64; 2]; 2]) -> f64 {
    let (middle, determinant) = (0.5 * (a + d), a * d - b * c);
    let under_root = middle * middle - determinant;
    if under_root < 0.0 { determinant.sqrt() } else { middle.abs() + under_root.sqrt() }
}

#[cfg(test)]
mod tests {
    use super::super::block::Block;
    use super::super::orbit::RockingCycle;
    use super::*;

    /// A block on its orbit, and the wave for it.
    fn orbit(length_m: f64, from: f64, to: f64) -> (Release, Wave) {
        let block = Block { length_m, height_m: 0.04 };
        let peak_rad = 0.15;
        let (from_rad, to_rad) = (from * peak_rad, to * peak_rad);
        let cycle = RockingCycle { block, restitution: 0.5, peaks_rad: [peak_rad; 2], from_rad, to_rad };
        (Release { block, restitution: 0.5, tilt_rad: peak_rad }, cycle.drive().unwrap().wave())
    }

    #[test]
    fn deviation_from_an_unstable_orbit_grows_by_the_multiplier() {
        let (release, wave) = orbit(0.03, 0.8, -0.03);
        let multiplier = release.multiplier(&wave);
        let near = Release { tilt_rad: release.tilt_rad * (1.0 + 1e-7), ..release };
        let off_rad = |periods: f64| near.motion(&wave, periods * wave.length_s()).last.tilt_rad - release.tilt_rad;
        let grown = off_rad(5.0) / off_rad(4.0);
        assert!(multiplier > 1.1 && (grown / multiplier - 1.0).abs() < 0.05, "{grown} {multiplier}");
    }
}
