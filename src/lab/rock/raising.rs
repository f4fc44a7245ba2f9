//! Amplitude raised from period to period until the block topples (Singer and Seering, section 3.1).

use super::motion::{Motion, Release};
use super::orbit::RockingCycle;
use super::wave::Wave;

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
