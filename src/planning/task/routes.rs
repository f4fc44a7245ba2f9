use rand::seq::SliceRandom;

use super::multi_disc::MultiDiscProblem;
use super::space_time_astar::{MovingObstacle, PathQuery};
use upm_core::geometry::Vec2;
use upm_core::random::Rng;

/// Gap between rims for which routes are planned, m.
pub(super) const PLANNED_GAP_M: f64 = 3e-3;

/// Settings of the search, used in turn for successive orders of precedence: the longest move along x or y from one
/// moment to the next, m, and the number of moments for which parts without a route yet count as obstacles at their
/// starts. In a crowd parts need time to make room, and short moves.
const RESTART_ORDERS: [(f64, usize); 4] = [(7e-3, 0), (7e-3, 4), (5e-3, 4), (5e-3, 8)];

/// Orders of precedence tried before a part counts as blocked.
const ORDERS: usize = 24;

/// Search nodes (position and moment) for one part's route, and for all routes in all orders.
const MAX_EXPANSIONS: (usize, usize) = (5_000, 30_000);

/// Routes of all parts: `ways_m[i][k]` is the position of part i at moment k. From one moment to the next all parts
/// move in straight lines, in step.
#[derive(Clone, Debug, Default)]
pub(super) struct PathSet {
    pub(super) ways_m: Vec<Vec<Vec2>>,
    /// Parts without a route; theirs ends where it begins.
    pub(super) blocked: Vec<usize>,
}

impl PathSet {
    /// Positions of all parts at every moment, m.
    pub(super) fn places_m(&self) -> Vec<Vec<Vec2>> {
        let moments = self.ways_m.first().map_or(0, Vec::len);
        (0..moments).map(|k| self.ways_m.iter().map(|way_m| way_m[k]).collect()).collect()
    }
}

/// Search for routes from the starts to the problem's targets on which no two parts come too near to each other. Routes
/// are assigned one part after another; a part that finds none comes first in the next order (prioritised planning,
/// Erdmann and Lozano-Pérez 1987, with the restarts of Bennewitz et al. 2002).
pub(super) struct PrioritizedPlanner<'a> {
    problem: &'a MultiDiscProblem,
    starts_m: &'a [Vec2],
    /// Search nodes left.
    effort: usize,
    blocked: Vec<usize>,
    /// Parts that failed to find a route in some order.
    failed: Vec<bool>,
}

impl<'a> PrioritizedPlanner<'a> {
    pub(super) fn new(problem: &'a MultiDiscProblem, starts_m: &'a [Vec2]) -> Self {
        Self { problem, starts_m, effort: MAX_EXPANSIONS.1, blocked: Vec::new(), failed: vec![false; problem.len()] }
    }

    /// Routes of all parts; those of blocked parts end where they begin.
    pub(super) fn routes(&mut self, rng: &mut Rng) -> PathSet {
        loop {
            if let Some(routes) = self.try_orders(self.first_order(), rng) {
                return routes;
            }
            self.mark_farthest_blocked();
        }
    }

    /// Alternative routes, if any, found in a random order of precedence.
    pub(super) fn other_routes(&mut self, rng: &mut Rng) -> Option<PathSet> {
        let mut order = self.first_order();
        order.shuffle(rng);
        if self.blocked.is_empty() { self.try_orders(order, rng) } else { None }
    }

    /// Routes of all parts except those blocked, which stay at rest.
    fn try_orders(&mut self, mut order: Vec<usize>, rng: &mut Rng) -> Option<PathSet> {
        for manner in RESTART_ORDERS.iter().cycle().take(ORDERS) {
            if self.effort == 0 {
                break;
            }
            let part = match self.ways(&order, *manner) {
                Ok(ways_m) => return Some(PathSet { ways_m, blocked: self.blocked.clone() }),
                Err(part) => part,
            };
            self.failed[part] = true;
            if order.first() == Some(&part) {
                order.shuffle(rng);
            } else {
                order.retain(|other| *other != part);
                order.insert(0, part);
            }
        }
        None
    }

    /// Order of precedence with the fewest conflicts of straight routes first, so that parts with a free one keep it.
    fn first_order(&self) -> Vec<usize> {
        let mut conflicts = vec![0; self.problem.len()];
        for (a, b) in self.problem.conflicts(self.starts_m, &self.problem.targets_m, PLANNED_GAP_M) {
            conflicts[a] += 1;
            conflicts[b] += 1;
        }
        let mut order: Vec<usize> = (0..self.problem.len()).filter(|part| !self.blocked.contains(part)).collect();
        order.sort_by_key(|&part| conflicts[part]);
        order
    }

    /// Routes in this order of precedence, or the first part that has none.
    fn ways(&mut self, order: &[usize], (pitch_m, grace): (f64, usize)) -> Result<Vec<Vec<Vec2>>, usize> {
        let mut ways_m: Vec<Vec<Vec2>> = vec![Vec::new(); self.problem.len()];
        for &part in &self.blocked {
            ways_m[part] = vec![self.starts_m[part]];
        }
        // as many as the longest straight route takes
        let straight_m =
            self.starts_m.iter().zip(&self.problem.targets_m).map(|(start, target)| (target - start).norm());
        let moments = (straight_m.fold(0.0, f64::max) / pitch_m).ceil() as usize;
        for &part in order {
            let obstacle = |other: usize| {
                let least_m = self.problem.least_m(part, other, PLANNED_GAP_M);
                if ways_m[other].is_empty() {
                    MovingObstacle { way_m: &self.starts_m[other..=other], least_m, gone_from: grace }
                } else {
                    MovingObstacle { way_m: &ways_m[other], least_m, gone_from: usize::MAX }
                }
            };
            let obstacles: Vec<MovingObstacle<'_>> =
                (0..self.problem.len()).filter(|&other| other != part).map(obstacle).collect();
            let query = PathQuery {
                start_m: self.starts_m[part],
                target_m: self.problem.targets_m[part],
                reach_m: self.problem.reach_m(part),
                obstacles: &obstacles,
                pitch_m,
                horizon: 4 * moments + 60,
            };
            let straight = [0, grace].iter().find_map(|&wait| query.straight(wait, moments));
            let granted = MAX_EXPANSIONS.0.min(self.effort);
            let mut left = granted;
            let way_m = straight.or_else(|| query.way(&mut left));
            self.effort -= granted - left;
            ways_m[part] = way_m.ok_or(part)?;
        }
        let last = ways_m.iter().map(Vec::len).max().unwrap_or(0);
        for (way_m, start_m) in ways_m.iter_mut().zip(self.starts_m) {
            way_m.resize(last, way_m.last().copied().unwrap_or(*start_m));
        }
        Ok(ways_m)
    }

    /// Declares a part blocked: of those that failed to find a route, the one furthest from its target.
    fn mark_farthest_blocked(&mut self) {
        let way_m = |part: usize| (self.problem.targets_m[part] - self.starts_m[part]).norm();
        let left = (0..self.problem.len()).filter(|part| !self.blocked.contains(part));
        let furthest = left.max_by(|&a, &b| self.failed[a].cmp(&self.failed[b]).then(way_m(a).total_cmp(&way_m(b))));
        self.blocked.extend(furthest);
        self.failed.fill(false);
        self.effort = self.effort.max(MAX_EXPANSIONS.1 / 5);
    }
}
