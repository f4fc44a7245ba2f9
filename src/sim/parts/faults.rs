//! What hands and time do to parts.

use super::{PartMotion, Parts};
use crate::faults::PlantFaults;
use upm_core::geometry::{Pose, Vec2};

/// Where parts go that are taken off the plate, m: far out of every view.
const AWAY_M: f64 = 100.0;

impl Parts {
    /// From now on this is wrong, and nothing else: parts that are taken off go, those that were come back.
    pub fn set_faults(&mut self, faults: &PlantFaults) {
        for (part, body) in self.bodies.iter_mut().enumerate() {
            match (faults.removed.contains(&part), body.taken_from) {
                (true, None) if body.motion.on_plate => {
                    body.taken_from = Some(body.motion.part_in_table);
                    let away = Pose { position_m: Vec2::new(AWAY_M, AWAY_M * part as f64), heading_rad: 0.0 };
                    body.motion = PartMotion { on_plate: false, ..PartMotion::at_rest(away) };
                }
                (false, Some(place)) => {
                    body.taken_from = None;
                    body.motion = PartMotion::at_rest(place);
                }
                _ => {}
            }
        }
        self.faults = faults.clone();
    }

    /// Moves part `part` by `by_m` by hand; off the plate is where it then falls.
    pub fn shift(&mut self, part: usize, by_m: Vec2) {
        if let Some(body) = self.bodies.get_mut(part).filter(|body| body.motion.on_plate) {
            body.motion.part_in_table.position_m += by_m;
        }
    }

    /// Two parts exchange their places.
    pub fn exchange(&mut self, [a, b]: [usize; 2]) {
        if let (Some(first), Some(second)) = (self.bodies.get(a), self.bodies.get(b)) {
            let (first, second) = (first.motion, second.motion);
            (self.bodies[a].motion, self.bodies[b].motion) = (second, first);
        }
    }
}
