//! Two orientations of a block on one table: the drive keeps one rocking and lets the motion of the other decay (Singer
//! and Seering, Fig. 9).

use super::block::Block;
use super::motion::{Motion, Release};
use super::orbit::RockingCycle;

/// End of the upward acceleration after the impact, as a fraction of the tilt at which it begins, and of the square of
/// the restitution: a larger one removes energy that it has supplied.
const AFTER: f64 = -0.4;

/// Both orientations on the drive of one of them.
#[derive(Clone, Debug)]
pub struct Selected {
    /// Motions of the orientation that the drive is computed for and of the other.
    pub motions: [Motion; 2],
    /// Peak of each after its first impact, rad.
    pub peaks_rad: [f64; 2],
}

/// A block, standing, and the same one lying, both released at `tilt_rad`, for `length_s` on the table that keeps the
/// standing one rocking. The table's acceleration is upward around its impact, from `from` of its peak on. `None` where
/// there is no such drive.
pub fn on_drive(standing: &Release, from: f64, length_s: f64) -> Option<Selected> {
    let &Release { block, restitution, tilt_rad } = standing;
    let lying = Block { length_m: block.height_m, height_m: block.length_m };
    let from_rad = from * tilt_rad;
    let to_rad = AFTER * restitution.powi(2) * from_rad;
    let wave = RockingCycle { block, restitution, peaks_rad: [tilt_rad; 2], from_rad, to_rad }.drive()?.wave();
    let motions = [block, lying].map(|block| Release { block, ..*standing }.motion(&wave, length_s));
    let peaks_rad = [0, 1].map(|i| motions[i].peaks.first().map_or(0.0, |peak| peak[1]));
    Some(Selected { motions, peaks_rad })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn longer_window_separates_orientations_less() {
        let block = Block { length_m: 0.02, height_m: 0.022 };
        let standing = Release { block, restitution: 0.5, tilt_rad: 0.1 };
        let on_drive = |from| on_drive(&standing, from, 0.2).unwrap();
        let found = [0.1, 0.3, 0.5, 0.7, 0.9].map(on_drive);
        assert!(found.iter().all(|found| (found.peaks_rad[0] / 0.1 - 1.0).abs() < 1e-5), "the standing one rocks on");
        assert!(found.windows(2).all(|pair| pair[0].peaks_rad[1] < pair[1].peaks_rad[1]));
        assert!(found[0].peaks_rad[1] < 0.005);
    }
}
