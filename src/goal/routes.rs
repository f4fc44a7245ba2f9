use rand::seq::SliceRandom;

use super::fleet::Fleet;
use super::search::{Obstacle, Query};
use upm_core::geometry::Vec2;
use upm_core::random::Rng;

/// Gap between rims that ways are planned with, m.
pub(super) const PLANNED_GAP_M: f64 = 3e-3;

/// How ways are looked for, in one order of precedence after another: longest move along x or y from one moment to
/// the next, m, and the moments for which those whose way is still to be found are not driven from where they are.
/// In a crowd they need time to make room, and short moves.
const MANNERS: [(f64, usize); 4] = [(7e-3, 0), (7e-3, 4), (5e-3, 4), (5e-3, 8)];

/// Orders of precedence tried before a part counts as boxed in.
const ORDERS: usize = 24;

/// Places and moments looked at for one part's way, and for all ways in all orders.
const EFFORT: (usize, usize) = (5_000, 30_000);

/// Ways of all parts: `ways_m[i][k]` is where part i is at moment k. From one moment to the next all move in
/// straight lines, in step.
#[derive(Clone, Debug, Default)]
pub(super) struct Routes {
    pub(super) ways_m: Vec<Vec<Vec2>>,
    /// Parts that found no way; theirs ends where it begins.
    pub(super) boxed_in: Vec<usize>,
}

/// Finds ways from starts to the fleet's targets on which nobody comes too near to another. Parts are given ways one
/// after another; one that finds none comes first in the next order (prioritised planning, Erdmann and Lozano-Pérez
/// 1987, with the restarts of Bennewitz et al. 2002).
pub(super) struct Search<'a> {
    fleet: &'a Fleet,
    starts_m: &'a [Vec2],
    /// Places and moments that may still be looked at.
    effort: usize,
    boxed_in: Vec<usize>,
    /// Parts that have found no way in some order.
    failed: Vec<bool>,
}

impl<'a> Search<'a> {
    pub(super) fn new(fleet: &'a Fleet, starts_m: &'a [Vec2]) -> Self {
        Self { fleet, starts_m, effort: EFFORT.1, boxed_in: Vec::new(), failed: vec![false; fleet.len()] }
    }

    /// Ways of all parts; those of parts that have none end where they begin.
    pub(super) fn routes(&mut self, rng: &mut Rng) -> Routes {
        loop {
            if let Some(routes) = self.try_orders(self.first_order(), rng) {
                return routes;
            }
            self.give_one_up();
        }
    }

    /// Other ways, if there are any: found in an order of precedence that is drawn.
    pub(super) fn other_routes(&mut self, rng: &mut Rng) -> Option<Routes> {
        let mut order = self.first_order();
        order.shuffle(rng);
        if self.boxed_in.is_empty() { self.try_orders(order, rng) } else { None }
    }

    /// Ways of all parts but those boxed in, which stay where they are.
    fn try_orders(&mut self, mut order: Vec<usize>, rng: &mut Rng) -> Option<Routes> {
        for manner in MANNERS.iter().cycle().take(ORDERS) {
            if self.effort == 0 {
                break;
            }
            let part = match self.ways(&order, *manner) {
                Ok(ways_m) => return Some(Routes { ways_m, boxed_in: self.boxed_in.clone() }),
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

    /// Those whose straight way is free come first and keep it.
    fn first_order(&self) -> Vec<usize> {
        let mut conflicts = vec![0; self.fleet.len()];
        for (a, b) in self.fleet.conflicts(self.starts_m, self.fleet.targets_m(), PLANNED_GAP_M) {
            conflicts[a] += 1;
            conflicts[b] += 1;
        }
        let mut order: Vec<usize> = (0..self.fleet.len()).filter(|part| !self.boxed_in.contains(part)).collect();
        order.sort_by_key(|&part| conflicts[part]);
        order
    }

    /// Ways in this order of precedence, or the first part that has none.
    fn ways(&mut self, order: &[usize], (pitch_m, grace): (f64, usize)) -> Result<Vec<Vec<Vec2>>, usize> {
        let mut ways_m: Vec<Vec<Vec2>> = vec![Vec::new(); self.fleet.len()];
        for &part in &self.boxed_in {
            ways_m[part] = vec![self.starts_m[part]];
        }
        let moments = self.moments(pitch_m);
        for &part in order {
            let obstacle = |other: usize| {
                let least_m = self.fleet.least_m(part, other, PLANNED_GAP_M);
                if ways_m[other].is_empty() {
                    Obstacle { way_m: &self.starts_m[other..=other], least_m, gone_from: grace }
                } else {
                    Obstacle { way_m: &ways_m[other], least_m, gone_from: usize::MAX }
                }
            };
            let obstacles: Vec<Obstacle<'_>> =
                (0..self.fleet.len()).filter(|&other| other != part).map(obstacle).collect();
            let query = Query {
                start_m: self.starts_m[part],
                target_m: self.fleet.targets_m()[part],
                reach_m: self.fleet.reach_m(part),
                obstacles: &obstacles,
                pitch_m,
                horizon: 4 * moments + 60,
            };
            let straight = [0, grace].iter().find_map(|&wait| query.straight(wait, moments));
            let granted = EFFORT.0.min(self.effort);
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

    /// Moments that the longest straight way takes.
    fn moments(&self, pitch_m: f64) -> usize {
        let ways = self.starts_m.iter().zip(self.fleet.targets_m()).map(|(start, target)| (target - start).norm());
        (ways.fold(0.0, f64::max) / pitch_m).ceil() as usize
    }

    /// Of the parts that found no way the one furthest from its target stays where it is from now on.
    fn give_one_up(&mut self) {
        let way_m = |part: usize| (self.fleet.targets_m()[part] - self.starts_m[part]).norm();
        let left = (0..self.fleet.len()).filter(|part| !self.boxed_in.contains(part));
        let furthest = left.max_by(|&a, &b| self.failed[a].cmp(&self.failed[b]).then(way_m(a).total_cmp(&way_m(b))));
        self.boxed_in.extend(furthest);
        self.failed.fill(false);
        self.effort = self.effort.max(EFFORT.1 / 5);
    }
}
