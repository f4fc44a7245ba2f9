//! Forecast of all positions after each pulse of a sequence, and its slopes by each pulse.

use nalgebra::Matrix2;

use super::motion_set::{LibraryMotion, MotionSet, Pulse};
use crate::planner::PartState;
use upm_core::geometry::Vec2;

/// Finite difference of a position, m.
const SHIFT_M: f64 = 1e-4;
/// Finite difference of a pulse's length: relative, and at least this many m.
const CHANGE: f64 = 0.02;
const LEAST_CHANGE_M: f64 = 2e-5;

/// Positions of all parts before the first pulse and after each.
#[derive(Clone, Debug, Default)]
pub(super) struct SequenceRollout {
    parts: usize,
    places_m: Vec<Vec2>,
    /// Positions halfway through each pulse, m.
    middles_m: Vec<Vec2>,
    /// Longest coasting time of a part after each pulse, s.
    pub coasts_s: Vec<f64>,
}

impl SequenceRollout {
    /// Forecast of `motions` on `parts`.
    pub fn of(motions: &[LibraryMotion], parts: &[PartState]) -> Self {
        let mut rollout = Self { parts: parts.len(), ..Self::default() };
        rollout.places_m.reserve((motions.len() + 1) * parts.len());
        rollout.places_m.extend(parts.iter().map(|part| part.position_m));
        for (k, motion) in motions.iter().enumerate() {
            let mut coasts_s = 0.0f64;
            for (i, part) in parts.iter().enumerate() {
                let from = rollout.places_m[k * parts.len() + i];
                let (end, coasts) = motion.carry(from, part.gain);
                rollout.places_m.push(end);
                rollout.middles_m.push(motion.middle(from, end));
                coasts_s = coasts_s.max(coasts);
            }
            rollout.coasts_s.push(coasts_s);
        }
        rollout
    }

    /// Positions after `stage` pulses, m.
    pub fn at(&self, stage: usize) -> &[Vec2] {
        &self.places_m[stage * self.parts..][..self.parts]
    }

    /// Positions halfway through pulse `pulse`, m.
    pub fn middle(&self, pulse: usize) -> &[Vec2] {
        &self.middles_m[pulse * self.parts..][..self.parts]
    }

    /// Positions after all pulses, m.
    pub fn end(&self) -> &[Vec2] {
        self.at(self.pulses())
    }

    pub fn pulses(&self) -> usize {
        self.coasts_s.len()
    }
}

/// Slopes of the positions at every stage by the length of every pulse before it.
#[derive(Clone, Debug)]
pub(super) struct Slopes {
    parts: usize,
    pulses: usize,
    /// `[stage - 1][pulse][part]`.
    values: Vec<Vec2>,
}

impl Slopes {
    pub fn of(
        motion_set: &MotionSet,
        pulses: &[Pulse],
        motions: &[LibraryMotion],
        rollout: &SequenceRollout,
        parts: &[PartState],
    ) -> Self {
        let (count, n) = (pulses.len(), parts.len());
        let mut values = vec![Vec2::zeros(); count * count * n];
        for (k, (&pulse, motion)) in pulses.iter().zip(motions).enumerate() {
            let change_m = (CHANGE * pulse.distance_m.abs()).max(LEAST_CHANGE_M).copysign(pulse.distance_m);
            let changed = motion_set.motion(Pulse { distance_m: pulse.distance_m + change_m, ..pulse });
            let (before, stage) = values.split_at_mut(k * count * n);
            let last = if k > 0 { &before[(k - 1) * count * n..] } else { &[] };
            for (i, part) in parts.iter().enumerate() {
                let (from, to) = (rollout.at(k)[i], rollout.at(k + 1)[i]);
                let by = |shift: Vec2| (motion.carry(from + shift, part.gain).0 - to) / SHIFT_M;
                let by_place = Matrix2::from_columns(&[by(Vec2::x() * SHIFT_M), by(Vec2::y() * SHIFT_M)]);
                for l in 0..k {
                    stage[l * n + i] = by_place * last[l * n + i];
                }
                stage[k * n + i] = (changed.carry(from, part.gain).0 - to) / change_m;
            }
        }
        Self { parts: n, pulses: count, values }
    }

    /// Slopes of all parts' positions after `stage` pulses (1 or more) by the length of `pulse`.
    pub fn at(&self, stage: usize, pulse: usize) -> &[Vec2] {
        &self.values[((stage - 1) * self.pulses + pulse) * self.parts..][..self.parts]
    }
}
