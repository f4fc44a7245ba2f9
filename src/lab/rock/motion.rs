//! Simulation of a block on a moving table through its equation of motion (Singer and Seering, Eq. 3.3a), from impact
//! to impact.

use super::block::{Block, BlockTilt};
use super::wave::Wave;
use crate::numerics::{bisect, runge_kutta};
use upm_core::units::GRAVITY_MPS2;

/// Longest step, s, and over the time in which the block's tilt grows by a factor of e.
const STEP_S: f64 = 1e-4;
const STEP: f64 = 0.01;
/// Bisections of a step that contains an event.
const HALVINGS: usize = 50;
/// Rise after an impact, rad, below which a block counts as flat.
const FLAT_RAD: f64 = 1e-5;

/// Initial state of a rocking block.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Release {
    pub block: Block,
    /// Coefficient of restitution `e` of the centre's normal speed.
    pub restitution: f64,
    /// Initial tilt, rad.
    pub tilt_rad: f64,
}

/// Reason for the end of a motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// It still rocks when the time is over.
    Rocks,
    /// It is flat.
    Flat,
    /// It has passed its balance.
    Topples,
    /// The table no longer presses on its corner: the model is no longer valid.
    Lifts,
}

/// Trajectory of a block and its extreme contact forces.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// Time and tilt, s and rad.
    pub track: Vec<[f64; 2]>,
    /// Time and tilt of every peak, s and rad.
    pub peaks: Vec<[f64; 2]>,
    pub impacts_s: Vec<f64>,
    /// Least force on the corner during the motion, over the weight.
    pub least_contact: f64,
    /// Largest ratio of the force along the table to the force on the corner: the required friction.
    pub friction: f64,
    /// State when the time is over or the motion has ended.
    pub last: BlockTilt,
    pub end: End,
}

impl Motion {
    /// Time at which it ends, s.
    pub fn end_s(&self) -> f64 {
        self.track.last().map_or(f64::NAN, |at| at[0])
    }

    /// Peak number `i`, rad; NaN where there is none.
    pub fn peak_rad(&self, i: usize) -> f64 {
        self.peaks.get(i).map_or(f64::NAN, |peak| peak[1])
    }

    /// The last peak, rad: 0 for a block that lies flat.
    pub fn last_peak_rad(&self) -> f64 {
        match self.end {
            End::Rocks => self.peaks.last().map_or(f64::NAN, |peak| peak[1]),
            End::Flat => 0.0,
            End::Topples | End::Lifts => f64::NAN,
        }
    }
}

/// State of the block `step_s` later, by the fourth-order Runge-Kutta method; `weight_mps2` is `g + ẍ` as a function of
/// time from the beginning of the step.
pub fn stepped(block: &Block, turn: BlockTilt, step_s: f64, weight_mps2: impl Fn(f64) -> f64) -> BlockTilt {
    let slope =
        |[tilt_rad, speed_radps]: [f64; 2], t_s: f64| [speed_radps, block.accel_radps2(tilt_rad, weight_mps2(t_s))];
    let [tilt_rad, speed_radps] = runge_kutta([turn.tilt_rad, turn.speed_radps], step_s, slope);
    BlockTilt { tilt_rad, speed_radps }
}

impl Release {
    /// Motion for `length_s` on a table that moves as `wave`, which is repeated.
    pub fn motion(&self, wave: &Wave, length_s: f64) -> Motion {
        self.motion_from(BlockTilt { tilt_rad: self.tilt_rad, speed_radps: 0.0 }, wave, length_s)
    }

    /// The same from a state other than rest.
    pub fn motion_from(&self, turn: BlockTilt, wave: &Wave, length_s: f64) -> Motion {
        let motion = Motion {
            track: vec![[0.0, turn.tilt_rad]],
            peaks: Vec::new(),
            impacts_s: Vec::new(),
            least_contact: f64::INFINITY,
            friction: 0.0,
            last: turn,
            end: End::Rocks,
        };
        let mut rocking = Rocking { release: self, turn, t_s: 0.0, motion };
        'all: loop {
            for stretch in &wave.stretches {
                let begin_s = rocking.t_s;
                let until_s = (begin_s + stretch.length_s).min(length_s);
                let weight_mps2 = |t_s: f64| GRAVITY_MPS2 + stretch.accel_mps2(t_s - begin_s);
                if !rocking.follow(until_s, weight_mps2) || until_s >= length_s {
                    break 'all;
                }
            }
        }
        rocking.motion.last = rocking.turn;
        rocking.motion
    }
}

struct Rocking<'a> {
    release: &'a Release,
    turn: BlockTilt,
    t_s: f64,
    motion: Motion,
}

impl Rocking<'_> {
    /// Advances until `until_s`; false when the motion has ended.
    fn follow(&mut self, until_s: f64, weight_mps2: impl Fn(f64) -> f64) -> bool {
        let block = &self.release.block;
        while self.t_s < until_s {
            let at_s = self.t_s;
            let growth_s = 1.0 / (block.stiffness_pm() * weight_mps2(at_s).max(GRAVITY_MPS2)).sqrt();
            let step_s = STEP_S.min(STEP * growth_s).min(until_s - at_s);
            let after = |step_s: f64| stepped(block, self.turn, step_s, |t_s| weight_mps2(at_s + t_s));
            let next = after(step_s);
            let hits = |turn: BlockTilt| turn.tilt_rad <= 0.0;
            let peaks = |turn: BlockTilt| self.turn.speed_radps > 0.0 && turn.speed_radps <= 0.0;
            let happens = |turn: BlockTilt| hits(turn) || peaks(turn);
            let step_s =
                if happens(next) { bisect([0.0, step_s], HALVINGS, |t_s| happens(after(t_s)))[1] } else { step_s };
            let (next, is_peak) = (after(step_s), peaks(after(step_s)));
            // a step below the clock's resolution must not stop it
            self.t_s = (at_s + step_s).max(at_s * (1.0 + f64::EPSILON)).min(until_s);
            let weight_here_mps2 = weight_mps2(self.t_s);
            self.turn = next;
            if !self.presses(weight_here_mps2) {
                self.motion.end = End::Lifts;
                return false;
            }
            if hits(next) {
                // the centre's normal speed is restored in part, and the other corner then supports the block
                self.motion.impacts_s.push(self.t_s);
                self.turn = BlockTilt { tilt_rad: 0.0, speed_radps: -self.release.restitution * self.turn.speed_radps };
            } else if is_peak {
                self.motion.peaks.push([self.t_s, next.tilt_rad]);
            }
            self.motion.track.push([self.t_s, self.turn.tilt_rad]);
            if let Some(end) = self.ended() {
                self.motion.end = end;
                return false;
            }
        }
        true
    }

    /// Records the forces on the corner; false where the table would have to pull.
    fn presses(&mut self, weight_mps2: f64) -> bool {
        let [along, normal] = self.release.block.contact_mps2(self.turn, weight_mps2);
        if normal < 0.0 {
            return false;
        }
        let motion = &mut self.motion;
        motion.least_contact = motion.least_contact.min(normal / GRAVITY_MPS2);
        motion.friction = motion.friction.max(along.abs() / normal);
        true
    }

    fn ended(&self) -> Option<End> {
        let (block, turn) = (&self.release.block, self.turn);
        // enough for a table that presses no less than gravity does
        let least = 2.0 * block.stiffness_pm() * GRAVITY_MPS2 * block.lift(0.0, FLAT_RAD);
        if turn.tilt_rad <= 0.0 && turn.speed_radps.powi(2) < least {
            return Some(End::Flat);
        }
        (turn.tilt_rad >= block.balance_rad()).then_some(End::Topples)
    }
}

#[cfg(test)]
mod tests {
    use super::super::wave::WaveSegment;
    use super::*;

    const BLOCK: Block = Block { length_m: 0.03, height_m: 0.04 };

    fn still() -> Wave {
        Wave { stretches: vec![WaveSegment { length_s: 0.05, accel_mps2: [0.0; 2] }] }
    }

    #[test]
    fn block_on_a_still_table_loses_energy_only_at_impacts() {
        let release = |restitution| Release { block: BLOCK, restitution, tilt_rad: 0.2 };
        let elastic = release(1.0).motion(&still(), 3.0);
        assert_eq!(elastic.end, End::Rocks);
        assert!(
            elastic.peaks.len() > 5 && elastic.peaks.iter().all(|peak| (peak[1] - 0.2).abs() < 1e-9),
            "{elastic:?}"
        );
        let half = release(0.5).motion(&still(), 3.0);
        assert_eq!(half.end, End::Flat);
        for pair in half.peaks.windows(2).take(3) {
            let [high, low] = [pair[0][1], pair[1][1]].map(|peak| BLOCK.lift(0.0, peak));
            assert!((low / high - 0.25).abs() < 1e-9, "a quarter of the height is left");
        }
        assert!(half.least_contact > 0.0 && half.least_contact < 1.0);
    }

    #[test]
    fn block_beyond_balance_topples_and_one_in_a_falling_table_lifts() {
        let push = Wave { stretches: vec![WaveSegment { length_s: 1.0, accel_mps2: [0.0; 2] }] };
        let over = Release { block: BLOCK, restitution: 0.9, tilt_rad: BLOCK.balance_rad() + 0.01 };
        assert_eq!(over.motion(&push, 1.0).end, End::Topples);
        let drop = Wave { stretches: vec![WaveSegment { length_s: 1.0, accel_mps2: [-GRAVITY_MPS2 - 1.0; 2] }] };
        assert_eq!(Release { tilt_rad: 0.1, ..over }.motion(&drop, 1.0).end, End::Lifts);
    }
}
