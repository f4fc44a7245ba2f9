//! Candidate pulses: their displacements of every part and their times.

use super::motion_set::{MotionSet, Pulse};
use super::subgoals::Clearance;
use crate::planner::PartState;
use upm_core::geometry::Vec2;

/// Distances of candidate pulses on their typical belts, m.
const LEVELS_M: [f64; 13] =
    [25e-3, 16e-3, 10e-3, 7e-3, 5e-3, 3.5e-3, 2.5e-3, 1.7e-3, 1.2e-3, 0.8e-3, 0.55e-3, 0.35e-3, 0.24e-3];

/// Lengths and centres of the candidate pulses of a sequence.
#[derive(Clone, Copy, Debug)]
pub(super) struct PulseScale {
    /// Longest candidates, relative to the root mean square of the steps: long pulses span little more than rigid
    /// motions, and the parts of them that cancel cost more than they move.
    longest: f64,
    /// Shortest candidates, and the length up to which candidates are always offered, m.
    shortest_m: (f64, f64),
    /// Least distance of a centre from a part, in radii: a nearer one spins the part more than it moves it.
    nearest_radii: f64,
}

impl PulseScale {
    /// Pulses up to the length of the steps: least time.
    pub const COARSE: Self = Self { longest: 1.4, shortest_m: (0.7e-3, 1.3e-3), nearest_radii: 0.8 };
    /// Between the two: fine pulses move parts a third as far in the same time.
    pub const MEDIUM: Self = Self { longest: 0.6, shortest_m: (0.4e-3, 0.9e-3), nearest_radii: 0.0 };
    /// Pulses much shorter than the steps, and centres among the parts. Pulses that separate parts close together
    /// nearly cancel, and the second-order terms of long pulses exceed the remainder.
    pub const FINE: Self = Self { longest: 0.35, shortest_m: (0.2e-3, 0.4e-3), nearest_radii: 0.0 };
}

/// Exact displacements of pulses on all parts, in mm, with their times.
#[derive(Clone, Debug, Default)]
pub(super) struct DisplacementMatrix {
    rows: usize,
    /// Column by column: x, y of each part, mm.
    values_mm: Vec<f64>,
    pub duration_s: Vec<f64>,
    pub pulses: Vec<Pulse>,
}

impl DisplacementMatrix {
    /// Every usable dial in both directions at every length suited to steps of `rms_m`, as far as their courses fit
    /// into the corridors of `room`.
    pub fn all(
        motion_set: &MotionSet,
        parts: &[PartState],
        room: &Clearance,
        (rms_m, scale): (f64, PulseScale),
    ) -> Self {
        let discs = parts.iter().map(|part| (part.position_m, part.radius_m));
        let usable = motion_set.usable(discs, scale.nearest_radii);
        let (shortest_m, always_m) = scale.shortest_m;
        let longest_m = (scale.longest * rms_m).max(always_m);
        let mut columns = Self { rows: 2 * parts.len(), ..Self::default() };
        for level_m in LEVELS_M.into_iter().filter(|&level_m| shortest_m <= level_m && level_m <= longest_m) {
            for &dial in &usable {
                let (low_m, high_m) = motion_set.range_m(dial);
                let distance_m = level_m.clamp(low_m, high_m);
                for distance_m in [distance_m, -distance_m] {
                    let pulse = Pulse { dial, distance_m };
                    if room.holds_course(&motion_set.motion(pulse), parts) {
                        columns.push(motion_set, parts, pulse);
                    }
                }
            }
        }
        columns
    }

    /// Columns of `pulses`.
    pub fn of(motion_set: &MotionSet, parts: &[PartState], pulses: impl Iterator<Item = Pulse>) -> Self {
        let mut columns = Self { rows: 2 * parts.len(), ..Self::default() };
        pulses.for_each(|pulse| columns.push(motion_set, parts, pulse));
        columns
    }

    fn push(&mut self, motion_set: &MotionSet, parts: &[PartState], pulse: Pulse) {
        let motion = motion_set.motion(pulse);
        let mut coasts_s = 0.0f64;
        for part in parts {
            let (end, coasts): (Vec2, f64) = motion.carry(part.position_m, part.gain);
            let step_mm = (end - part.position_m) * 1e3;
            self.values_mm.extend([step_mm.x, step_mm.y]);
            coasts_s = coasts_s.max(coasts);
        }
        self.duration_s.push(motion_set.duration_s(motion.setting, coasts_s));
        self.pulses.push(pulse);
    }

    pub fn len(&self) -> usize {
        self.pulses.len()
    }

    /// Column `j`, mm.
    pub fn column(&self, j: usize) -> &[f64] {
        &self.values_mm[j * self.rows..][..self.rows]
    }

    /// Value of column `j` at `prices` (s/mm), per second of its time.
    pub fn pay(&self, j: usize, prices: &[f64]) -> f64 {
        self.column(j).iter().zip(prices).map(|(d, y)| d * y).sum::<f64>() / self.duration_s[j]
    }
}
