//! The conditions of a cycle: which hold, and why, in words.

use super::Cycle;
use crate::condition::Condition;

/// A part that goes less than this part of the way the library has it is slow, and no longer slow from the second on.
const SLOW: f64 = 0.7;
const NOT_SLOW: f64 = 0.75;

impl Cycle<'_> {
    /// Notes the parts that no way leads to their targets.
    pub(super) fn warn_of_blocked(&mut self, blocked: &[usize]) {
        for &part in blocked {
            let reason = format!("{} is boxed in: no way to its target is free", self.params.id(part));
            self.warn(Condition::PartBlocked { part }, reason);
        }
    }

    /// Notes each part that goes much less far than calibration has it.
    pub(super) fn tell_slow_parts(&mut self) {
        for part in 0..self.params.parts.len() {
            let (condition, gain) = (Condition::PartSlow { part }, self.planning.gains.of_part(part));
            let below = if self.conditions.holds(condition) { NOT_SLOW } else { SLOW };
            if gain < below {
                let reason =
                    format!("{} is slow: it goes {gain:.2} of the way measured in calibration", self.params.id(part));
                self.warn(condition, reason);
            }
        }
    }

    pub(super) fn warn(&mut self, condition: Condition, reason: String) {
        self.conditions.note(self.rig.now(), condition, || reason, self.sink);
    }
}
