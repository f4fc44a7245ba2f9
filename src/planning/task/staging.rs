use super::multi_disc::{MultiDiscProblem, ROUNDING_M, keep_apart};
use super::routes::{PLANNED_GAP_M, PathSet, PrioritizedPlanner};
use upm_core::geometry::{Segment, Vec2};
use upm_core::random::Rng;

/// Cost of one more stage, as an equivalent length, m.
const STAGE_M: f64 = 5e-3;

/// Number of routes found before the best is taken.
const TRIES: usize = 4;

/// Paths of all parts to their targets.
#[derive(Clone, Debug, Default)]
pub(super) struct StagedPaths {
    /// Positions of all parts at successive stages, m; from each to the next they move straight and in step.
    pub(super) places_m: Vec<Vec<Vec2>>,
    /// Parts without a route, which stay at rest.
    pub(super) blocked: Vec<usize>,
    /// True where the parts cannot all go straight.
    pub(super) round: bool,
    /// Cost: the effort of rotations in pulses, or the sum over the stages of the longest displacement and a constant,
    /// m.
    pub(super) cost: f64,
}

/// The stages from `starts_m` to the problem's targets: a single one where all can go straight, else the best of a few
/// routes round each other.
pub(super) fn find_stages(problem: &MultiDiscProblem, starts_m: &[Vec2], rng: &mut Rng) -> StagedPaths {
    if problem.is_clear(starts_m, &problem.targets_m, PLANNED_GAP_M) {
        return StagedPaths { places_m: vec![problem.targets_m.clone()], ..StagedPaths::default() };
    }
    let mut search = PrioritizedPlanner::new(problem, starts_m);
    let mut best = stages(problem, search.routes(rng));
    for _ in 1..TRIES {
        let Some(routes) = search.other_routes(rng) else { break };
        let other = stages(problem, routes);
        if other.cost < best.cost {
            best = other;
        }
    }
    best
}

/// Shortens routes: replaces a part's route between two moments by a straight line wherever that is clear of the other
/// parts.
pub(super) fn straighten(problem: &MultiDiscProblem, routes: &mut PathSet) {
    let last = routes.ways_m.first().map_or(0, |way_m| way_m.len().saturating_sub(1));
    let mut span = last;
    while span > 1 {
        for part in 0..problem.len() {
            let mut from = 0;
            while from < last {
                straighten_between(problem, routes, part, from, (from + span).min(last));
                from += (span / 2).max(1);
            }
        }
        span = span * 2 / 3;
    }
}

fn straighten_between(problem: &MultiDiscProblem, routes: &mut PathSet, part: usize, from: usize, to: usize) {
    let way_m = &routes.ways_m[part];
    let (from_m, to_m) = (way_m[from], way_m[to]);
    let at = |k: usize| from_m.lerp(&to_m, (k - from) as f64 / (to - from) as f64);
    if (from..=to).all(|k| (way_m[k] - at(k)).norm() < ROUNDING_M) {
        return;
    }
    let free = (0..problem.len()).filter(|&other| other != part).all(|other| {
        let least_m = problem.least_m(part, other, PLANNED_GAP_M);
        let others_m = &routes.ways_m[other];
        (from..to).all(|k| {
            let other = Segment { from: others_m[k], to: others_m[k + 1] };
            keep_apart(&Segment { from: at(k), to: at(k + 1) }, &other, least_m)
        })
    });
    if free {
        let points: Vec<Vec2> = (from..=to).map(at).collect();
        routes.ways_m[part][from..=to].copy_from_slice(&points);
    }
}

/// Stages on straightened routes: the moments between which all parts can move straight and in step at the least cost.
fn stages(problem: &MultiDiscProblem, mut routes: PathSet) -> StagedPaths {
    straighten(problem, &mut routes);
    let all = routes.places_m();
    let moments = all.len();
    let cost_m = |from: usize, to: usize| {
        let longest_m = all[from].iter().zip(&all[to]).map(|(a, b)| (b - a).norm()).fold(0.0, f64::max);
        longest_m + STAGE_M
    };
    // for each moment the least cost up to it, and the previous stage
    let mut best = vec![(0.0, 0); moments.min(1)];
    for to in 1..moments {
        let (mut least_m, mut before) = (best[to - 1].0 + cost_m(to - 1, to), to - 1);
        for from in 0..to - 1 {
            let through_m = best[from].0 + cost_m(from, to);
            if through_m < least_m && problem.is_clear(&all[from], &all[to], PLANNED_GAP_M) {
                (least_m, before) = (through_m, from);
            }
        }
        best.push((least_m, before));
    }
    let mut places_m = Vec::new();
    let mut k = moments.saturating_sub(1);
    while k > 0 {
        places_m.push(all[k].clone());
        k = best[k].1;
    }
    places_m.reverse();
    StagedPaths { places_m, blocked: routes.blocked, round: true, cost: best.last().map_or(0.0, |last| last.0) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::task::PartOutline;
    use proptest::prelude::*;
    use rand::RngExt;
    use upm_core::random::{Rng, Streams};

    fn scattered(count: usize, rng: &mut Rng) -> Vec<Vec2> {
        let mut places_m: Vec<Vec2> = Vec::new();
        while places_m.len() < count {
            let p = Vec2::new(rng.random_range(-0.14..0.14), rng.random_range(-0.14..0.14));
            if places_m.iter().all(|q| (p - q).norm() > 0.0225) {
                places_m.push(p);
            }
        }
        places_m
    }

    /// Least distance of two parts at many moments of a straight motion in step, m.
    fn nearest_m(from_m: &[Vec2], to_m: &[Vec2]) -> f64 {
        let at = |i: usize, k: u32| from_m[i].lerp(&to_m[i], f64::from(k) / 100.0);
        let pairs = || (0..from_m.len()).flat_map(|a| (0..a).map(move |b| (a, b)));
        (0..=100).flat_map(|k| pairs().map(move |(a, b)| (at(a, k) - at(b, k)).norm())).fold(f64::INFINITY, f64::min)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        #[test]
        fn stages_end_at_the_targets_and_keep_apart_all_the_way(seed in 0u64..10_000, count in 2usize..20) {
            let mut rng = Streams::new(seed).stream("scene");
            let (starts_m, targets_m) = (scattered(count, &mut rng), scattered(count, &mut rng));
            let discs = vec![PartOutline { kind: 0, radius_m: 0.0095 }; count];
            let problem = MultiDiscProblem::new(discs, 0.1524, targets_m.clone());
            let StagedPaths { places_m, blocked, .. } = find_stages(&problem, &starts_m, &mut rng);
            prop_assert_eq!(blocked, Vec::<usize>::new());
            prop_assert_eq!(places_m.last(), Some(&targets_m));
            let mut from_m = &starts_m;
            for to_m in &places_m {
                // 19 mm and a gap of 3 mm
                prop_assert!(nearest_m(from_m, to_m) > 0.022 - 1e-6);
                from_m = to_m;
            }
            let longest_m = (0..count).map(|i| (targets_m[i] - starts_m[i]).norm()).fold(0.0, f64::max);
            let driven_m = |i: usize| {
                let ways = std::iter::once(&starts_m).chain(&places_m).map(|at| at[i]).collect::<Vec<_>>();
                ways.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum::<f64>()
            };
            prop_assert!((0..count).all(|i| driven_m(i) < 2.0 * longest_m + 0.1));
        }
    }
}
