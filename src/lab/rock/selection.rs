//! Two orientations of a block on one table: the drive keeps one rocking and lets the motion of the other decay (Singer
//! and Seering, Fig. 9). And the amplitude raised from period to period until a block topples (section 3.1).

use super::block::Block;
use super::motion::{Motion, Release};
use super::orbit::RockingCycle;
use super::wave::Wave;

/// End of the upward acceleration after the impact, as a fraction of the tilt at which it begins, and of the square of
/// the restitution: a larger one removes energy that it has supplied.
const AFTER: f64 = -0.4;

/// Motions of a block, standing, and of the same one lying, both released at `tilt_rad`, for `length_s` on the table
/// that keeps the standing one rocking, and the peak of each after its first impact, rad. The table's acceleration is
/// upward around its impact, from `from` of its peak on. `None` where there is no such drive.
pub fn on_drive(standing: &Release, from: f64, length_s: f64) -> Option<([Motion; 2], [f64; 2])> {
    let &Release { block, restitution, tilt_rad } = standing;
    let lying = Block { length_m: block.height_m, height_m: block.length_m };
    let from_rad = from * tilt_rad;
    let to_rad = AFTER * restitution.powi(2) * from_rad;
    let wave = RockingCycle { block, restitution, peaks_rad: [tilt_rad; 2], from_rad, to_rad }.drive()?.wave();
    let motions = [block, lying].map(|block| Release { block, ..*standing }.motion(&wave, length_s));
    let peaks_rad = [0, 1].map(|i| motions[i].peaks.first().map_or(0.0, |peak| peak[1]));
    Some((motions, peaks_rad))
}

/// Growth factor of the peak per period.
const GROWTH: f64 = 1.15;
/// Peak, as a fraction of the balance, from which the block is kicked over instead.
const NEAR_BALANCE: f64 = 0.6;
/// Most periods until toppling.
const MOST: usize = 60;

/// A block brought from its rocking to toppling.
#[derive(Clone, Debug)]
pub struct Raised {
    /// The table's acceleration over the whole motion.
    pub wave: Wave,
    /// Peaks that the wave is computed for, rad.
    pub peaks_rad: Vec<f64>,
    pub motion: Motion,
}

/// Raises the peaks of the steady `cycle`, whose window keeps its share of each peak. `None` where no drive exists.
pub fn raise(cycle: &RockingCycle) -> Option<Raised> {
    let &RockingCycle { block, restitution, peaks_rad: [start_rad, _], from_rad, to_rad } = cycle;
    let (from, to) = (from_rad / start_rad, to_rad / start_rad);
    let with_peaks = |[before, after]: [f64; 2]| RockingCycle {
        peaks_rad: [before, after],
        from_rad: from * before,
        to_rad: to * before,
        ..*cycle
    };
    let mut peaks_rad = vec![start_rad];
    let mut wave = Wave::default();
    let mut down_mps2 = cycle.drive()?.down_mps2;
    let mut peak_rad = start_rad;
    while peak_rad < NEAR_BALANCE * block.balance_rad() && peaks_rad.len() < MOST {
        let next_rad = GROWTH * peak_rad;
        let drive = with_peaks([peak_rad, next_rad]).drive()?;
        wave.stretches.extend(drive.wave().stretches);
        (peak_rad, down_mps2) = (next_rad, drive.down_mps2);
        peaks_rad.push(peak_rad);
    }
    wave.stretches.extend(with_peaks([peak_rad; 2]).kick(down_mps2)?.wave().stretches);
    let release = Release { block, restitution, tilt_rad: start_rad };
    let motion = release.motion(&wave, wave.length_s());
    Some(Raised { wave, peaks_rad, motion })
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
        let found = found.map(|(_, peaks_rad)| peaks_rad);
        assert!(found.iter().all(|peaks_rad| (peaks_rad[0] / 0.1 - 1.0).abs() < 1e-5), "the standing one rocks on");
        assert!(found.windows(2).all(|pair| pair[0][1] < pair[1][1]));
        assert!(found[0][1] < 0.005);
    }
}

#[cfg(test)]
mod raising_tests {
    use super::super::block::Block;
    use super::super::motion::End;
    use super::*;

    #[test]
    fn block_follows_the_raised_peaks_and_topples() {
        let block = Block { length_m: 0.02, height_m: 0.04 };
        let peak_rad = 0.1;
        let cycle = RockingCycle { block, restitution: 0.5, peaks_rad: [peak_rad; 2], from_rad: 0.08, to_rad: 0.01 };
        let raised = raise(&cycle).unwrap();
        assert_eq!(raised.motion.end, End::Topples);
        let wanted = &raised.peaks_rad[1..];
        assert!(wanted.len() > 5 && raised.motion.peaks.len() == wanted.len(), "{raised:?}");
        for (peak, wanted_rad) in raised.motion.peaks.iter().zip(wanted) {
            assert!((peak[1] / wanted_rad - 1.0).abs() < 1e-3, "{peak:?} {wanted_rad}");
        }
    }
}
