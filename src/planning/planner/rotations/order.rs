//! Order in which pulses are played.

use super::motion_set::LibraryMotion;
use super::subgoals::Clearance;
use crate::planner::PartState;
use upm_core::geometry::Vec2;

/// Weight of a broken limit against the distance from the straight path.
const LIMIT: f64 = 20.0;

/// Greedy order: the next pulse is the one after which the parts are nearest to their share of the straight path by
/// `steps_m`; a broken limit costs most.
pub(super) fn order(motions: &[LibraryMotion], parts: &[PartState], steps_m: &[Vec2], room: &Clearance) -> Vec<usize> {
    let start_m: Vec<Vec2> = parts.iter().map(|part| part.position_m).collect();
    let mut at_m = start_m.clone();
    let mut left: Vec<usize> = (0..motions.len()).collect();
    let mut order = Vec::with_capacity(motions.len());
    let mut after_m = at_m.clone();
    while !left.is_empty() {
        let share = (order.len() + 1) as f64 / motions.len() as f64;
        let mut best: Option<(f64, usize, Vec<Vec2>)> = None;
        for (place, &k) in left.iter().enumerate() {
            let mut off = 0.0;
            for (i, part) in parts.iter().enumerate() {
                after_m[i] = motions[k].carry(at_m[i], part.gain).0;
                off += (after_m[i] - start_m[i] - steps_m[i] * share).norm_squared();
            }
            let broken_m = room.shortfall(&at_m, &after_m).map_or(0.0, |shortfall| shortfall.by_m)
                + room.corridor_excess(&after_m).map_or(0.0, |(_, by_m)| by_m);
            let cost = off.sqrt() + LIMIT * broken_m;
            if best.as_ref().is_none_or(|(least, ..)| cost < *least) {
                best = Some((cost, place, after_m.clone()));
            }
        }
        let Some((_, place, after)) = best else { break };
        order.push(left.remove(place));
        at_m = after;
    }
    order
}
