use rand::seq::SliceRandom;

use super::fleet::{Fleet, Step};
use super::search::{Obstacle, Query};
use crate::geometry::Vec2;
use crate::random::Rng;

/// Gap between rims that ways are planned with, m.
pub(super) const PLANNED_GAP_M: f64 = 3e-3;

/// How ways are looked for, in one order of precedence after another: longest move along x or y from one moment to
/// the next, m, and the moments for which those whose way is still to be found are not driven from where they are.
/// In a crowd they need time to make room, and short moves.
const MANNERS: [(f64, usize); 4] = [(7e-3, 0), (7e-3, 4), (5e-3, 4), (5e-3, 8)];

/// Orders of precedence tried before a part counts as boxed in.
const ORDERS: usize = 24;

/// Places and moments looked at for one part's way, and for all ways in all orders.
const EFFORT: (usize, usize) = (5_000, 50_000);

/// Ways of all parts: `ways_m[i][k]` is where part i is at moment k. From one moment to the next all move in
/// straight lines, in step.
#[derive(Clone, Debug, Default)]
pub(super) struct Routes {
    pub(super) ways_m: Vec<Vec<Vec2>>,
    /// Parts that found no way; theirs ends where it begins.
    pub(super) boxed_in: Vec<usize>,
}

/// Finds ways from `starts_m` to the fleet's targets on which nobody comes too near to another. Parts are given ways
/// one after another; one that finds none comes first in the next order (prioritised planning, Erdmann and
/// Lozano-Pérez 1987, with the restarts of Bennewitz et al. 2002).
pub(super) fn find_routes(fleet: &Fleet, starts_m: &[Vec2], rng: &mut Rng) -> Routes {
    let mut search = Search { fleet, starts_m, boxed_in: Vec::new(), failed: vec![0; fleet.len()] };
    loop {
        if let Some(mut ways_m) = search.try_orders(rng) {
            let moments = ways_m.iter().map(Vec::len).max().unwrap_or(0);
            for (way_m, start_m) in ways_m.iter_mut().zip(starts_m) {
                way_m.resize(moments, way_m.last().copied().unwrap_or(*start_m));
            }
            return Routes { ways_m, boxed_in: search.boxed_in };
        }
        search.give_one_up();
    }
}

struct Search<'a> {
    fleet: &'a Fleet,
    starts_m: &'a [Vec2],
    boxed_in: Vec<usize>,
    /// How often each part has found no way.
    failed: Vec<usize>,
}

impl Search<'_> {
    /// Ways of all parts but those boxed in, which stay where they are.
    fn try_orders(&mut self, rng: &mut Rng) -> Option<Vec<Vec<Vec2>>> {
        let mut order = self.first_order();
        let mut effort = EFFORT.1;
        self.failed.fill(0);
        for tried in 0..ORDERS {
            if effort == 0 {
                break;
            }
            match self.ways(&order, MANNERS[tried % MANNERS.len()], &mut effort) {
                Ok(ways_m) => return Some(ways_m),
                Err(part) => {
                    self.failed[part] += 1;
                    if order.first() == Some(&part) {
                        order.shuffle(rng);
                    } else {
                        order.retain(|other| *other != part);
                        order.insert(0, part);
                    }
                }
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
    fn ways(
        &self,
        order: &[usize],
        (pitch_m, grace): (f64, usize),
        effort: &mut usize,
    ) -> Result<Vec<Vec<Vec2>>, usize> {
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
            let mut left = EFFORT.0.min(*effort);
            let way_m = straight.or_else(|| query.way(&mut left));
            *effort -= EFFORT.0.min(*effort) - left;
            ways_m[part] = way_m.ok_or(part)?;
        }
        Ok(ways_m)
    }

    /// Moments that the longest straight way takes.
    fn moments(&self, pitch_m: f64) -> usize {
        let ways = self.starts_m.iter().zip(self.fleet.targets_m()).map(|(start, target)| (target - start).norm());
        (ways.fold(0.0, f64::max) / pitch_m).ceil() as usize
    }

    /// The part that failed most stays where it is; of several the one furthest from its target.
    fn give_one_up(&mut self) {
        let way_m = |part: usize| (self.fleet.targets_m()[part] - self.starts_m[part]).norm();
        let left = (0..self.fleet.len()).filter(|part| !self.boxed_in.contains(part));
        let worst = left.max_by(|&a, &b| {
            let failed = self.failed[a].min(1).cmp(&self.failed[b].min(1));
            failed.then(way_m(a).total_cmp(&way_m(b)))
        });
        self.boxed_in.extend(worst);
    }
}

/// Shortens ways: wherever a part can go straight between two moments without coming too near to another, it does.
pub(super) fn straighten(fleet: &Fleet, routes: &mut Routes) {
    let last = routes.ways_m.first().map_or(0, |way_m| way_m.len().saturating_sub(1));
    let mut span = last;
    while span > 1 {
        for part in 0..fleet.len() {
            let mut from = 0;
            while from < last {
                straighten_between(fleet, routes, part, from, (from + span).min(last));
                from += (span / 2).max(1);
            }
        }
        span = span * 2 / 3;
    }
}

fn straighten_between(fleet: &Fleet, routes: &mut Routes, part: usize, from: usize, to: usize) {
    let way_m = &routes.ways_m[part];
    let length_m: f64 = way_m[from..=to].windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum();
    let straight_m = (way_m[to] - way_m[from]).norm();
    let (a_m, b_m) = (way_m[from], way_m[to]);
    let at = |k: usize| a_m.lerp(&b_m, (k - from) as f64 / (to - from) as f64);
    let even = || (from..=to).all(|k| (way_m[k] - at(k)).norm() < 1e-6);
    if length_m - straight_m < 1e-6 && even() {
        return;
    }
    let free = (0..fleet.len()).filter(|&other| other != part).all(|other| {
        let least_m = fleet.least_m(part, other, PLANNED_GAP_M);
        let others_m = &routes.ways_m[other];
        (from..to).all(|k| {
            let step = Step { from_m: at(k), to_m: at(k + 1) };
            step.keeps_from(&Step { from_m: others_m[k], to_m: others_m[k + 1] }, least_m)
        })
    });
    if free {
        let points: Vec<Vec2> = (from..=to).map(at).collect();
        routes.ways_m[part][from..=to].copy_from_slice(&points);
    }
}

/// Where all parts are at the fewest moments between which they can go straight and in step, the start left out:
/// least sum of the longest ways.
pub(super) fn stages(fleet: &Fleet, routes: &Routes) -> Vec<Vec<Vec2>> {
    let moments = routes.ways_m.first().map_or(0, Vec::len);
    let at = |k: usize| -> Vec<Vec2> { routes.ways_m.iter().map(|way_m| way_m[k]).collect() };
    let all: Vec<Vec<Vec2>> = (0..moments).map(at).collect();
    let longest_m = |from: usize, to: usize| {
        all[from].iter().zip(&all[to]).map(|(a, b)| (b - a).norm()).fold(0.0, f64::max) + STAGE_M
    };
    let mut best: Vec<(f64, usize)> = vec![(f64::INFINITY, 0); moments];
    if let Some(first) = best.first_mut() {
        first.0 = 0.0;
    }
    for to in 1..moments {
        for from in 0..to {
            let cost = best[from].0 + longest_m(from, to);
            if cost < best[to].0 - 1e-9 && (from + 1 == to || fleet.is_clear(&all[from], &all[to], PLANNED_GAP_M)) {
                best[to] = (cost, from);
            }
        }
    }
    let mut stages = Vec::new();
    let mut k = moments.saturating_sub(1);
    while k > 0 {
        stages.push(all[k].clone());
        k = best[k].1;
    }
    stages.reverse();
    stages
}

/// What one more stage costs: as much as a way of this length, m.
const STAGE_M: f64 = 5e-3;
