use pathfinding::prelude::{Matrix, kuhn_munkres_min};

/// Cost of a forbidden pair, µm²: more than all others together, but small enough to add 64 of them.
const NEVER_UM2: i64 = 1 << 56;

/// Assignment of parts to places with the least sum of costs: the index of the place for each part, all different.
/// `cost_m2` returns the cost of place `.1` for part `.0`, m²; infinite where the pair is forbidden. There are at least
/// as many places as parts.
pub(super) fn assign(parts: usize, places: usize, cost_m2: impl Fn(usize, usize) -> f64) -> Vec<usize> {
    if parts == 0 || places < parts {
        return (0..parts).collect();
    }
    let weight = |(part, place)| ((cost_m2(part, place) * 1e12).round() as i64).clamp(0, NEVER_UM2);
    kuhn_munkres_min(&Matrix::from_fn(parts, places, weight)).1
}
