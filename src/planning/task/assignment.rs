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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use upm_core::geometry::Vec2;

    /// Least sum over every permutation of `left` after the parts assigned so far.
    fn least(cost: &dyn Fn(usize, usize) -> f64, part: usize, left: &mut Vec<usize>) -> f64 {
        if part == 0 {
            return 0.0;
        }
        let mut best = f64::INFINITY;
        for k in 0..left.len() {
            let place = left.swap_remove(k);
            best = best.min(cost(part - 1, place) + least(cost, part - 1, left));
            left.push(place);
            let last = left.len() - 1;
            left.swap(k, last);
        }
        best
    }

    fn points(count: usize) -> impl Strategy<Value = Vec<Vec2>> {
        proptest::collection::vec((-0.15..0.15f64, -0.15..0.15f64).prop_map(|(x, y)| Vec2::new(x, y)), count)
    }

    proptest! {
        #[test]
        fn no_permutation_costs_less(
            (from, to, kinds) in (1..7usize).prop_flat_map(|n| {
                (points(n), points(n), proptest::collection::vec(0..2usize, n))
            }),
        ) {
            let cost = |part: usize, place: usize| {
                if kinds[part] == kinds[place] { (from[part] - to[place]).norm_squared() } else { f64::INFINITY }
            };
            let found = assign(from.len(), to.len(), cost);
            let mut places = found.clone();
            places.sort_unstable();
            prop_assert_eq!(places, (0..to.len()).collect::<Vec<_>>());
            let sum: f64 = found.iter().enumerate().map(|(part, &place)| cost(part, place)).sum();
            let best = least(&cost, from.len(), &mut (0..to.len()).collect());
            prop_assert!((sum - best).abs() < 1e-10, "{} for {}", sum, best);
        }
    }
}
