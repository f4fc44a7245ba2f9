//! Single rotations by number, for callers that choose them themselves.

use super::RotationPlanner;
use super::motion_set::Pulse;
use crate::planner::{PartState, Rotation};

impl RotationPlanner {
    /// Number of rotations to choose from: the library's entries but the weakest.
    pub fn rotations(&self) -> usize {
        self.motion_set.dials.len()
    }

    /// Longest distance of any of them, m.
    pub fn longest_m(&self) -> f64 {
        (0..self.rotations()).map(|number| self.motion_set.range_m(number).1).fold(0.0, f64::max)
    }

    /// Rotation number `number` over `distance_m`, at most its longest, with the rest that `parts` need after it;
    /// `None` where there is no such rotation.
    pub fn rotation(&self, number: usize, distance_m: f64, parts: &[PartState]) -> Option<Rotation> {
        let pulse = Pulse { dial: number, distance_m };
        let motion = (number < self.rotations()).then(|| self.motion_set.motion(pulse))?;
        let coasts_s = parts.iter().map(|part| motion.carry(part.position_m, part.gain).1).fold(0.0, f64::max);
        Some(self.motion_set.rotation(pulse, motion.setting, coasts_s))
    }

    /// Number of a planned rotation.
    pub fn number_of(&self, rotation: &Rotation) -> Option<usize> {
        self.motion_set.dials.iter().position(|dial| dial.entry == rotation.entry)
    }
}
