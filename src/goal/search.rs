use pathfinding::prelude::astar;

use super::fleet::{ROUNDING_M, Step};
use crate::geometry::Vec2;

/// Cost of a move along x or y by one pitch.
const STRAIGHT: u32 = 10;
/// Cost of a move along a diagonal.
const DIAGONAL: u32 = 14;
/// Cost of a wait.
const WAIT: u32 = 5;

/// The way's estimate counts this much more than what lies behind, in tenths: not the shortest way, found sooner.
const HASTE_TENTHS: u32 = 18;

/// A part whose way is known: where it is at every moment, at its last place for ever after.
pub(super) struct Obstacle<'a> {
    pub(super) way_m: &'a [Vec2],
    /// How near its centre may come, m.
    pub(super) least_m: f64,
    /// Moment from which on it is in nobody's way: it will make room.
    pub(super) gone_from: usize,
}

impl Obstacle<'_> {
    fn step(&self, moment: usize) -> Step {
        let at = |moment: usize| self.way_m.get(moment).or(self.way_m.last()).copied().unwrap_or_default();
        Step { from_m: at(moment), to_m: at(moment + 1) }
    }
}

/// What one part's way has to keep to.
pub(super) struct Query<'a> {
    pub(super) start_m: Vec2,
    pub(super) target_m: Vec2,
    /// How far from the plate's centre the part may be along x and along y, m.
    pub(super) reach_m: f64,
    pub(super) obstacles: &'a [Obstacle<'a>],
    /// Longest move along x or y from one moment to the next, m.
    pub(super) pitch_m: f64,
    /// Last moment at which the part may arrive.
    pub(super) horizon: usize,
}

/// A place of the lattice about the target; `None` is the start, which is on no lattice.
type Cell = Option<(i16, i16)>;

impl Query<'_> {
    /// The straight way in `moments` equal steps, begun after `wait` moments, if it is free.
    pub(super) fn straight(&self, wait: usize, moments: usize) -> Option<Vec<Vec2>> {
        let share = |k: usize| (k.saturating_sub(wait) as f64 / moments.max(1) as f64).min(1.0);
        let at = |k: usize| self.start_m.lerp(&self.target_m, share(k));
        let end = wait + moments.max(1);
        let free = (0..end).all(|k| self.is_free(k, Step { from_m: at(k), to_m: at(k + 1) }));
        (free && end >= self.free_from()).then(|| (0..=end).map(at).collect())
    }

    /// A way from start to target and where it is at every moment, found by A* over places and moments. Takes
    /// what it looks at off `effort` and finds nothing more when that is used up.
    pub(super) fn way(&self, effort: &mut usize) -> Option<Vec<Vec2>> {
        let free_from = self.free_from();
        let successors = |&(cell, moment): &(Cell, usize)| {
            let go_on = *effort > 0 && moment < self.horizon;
            *effort = effort.saturating_sub(1);
            if go_on { self.moves(cell, moment) } else { Vec::new() }
        };
        let arrived = |&(cell, moment): &(Cell, usize)| cell == Some((0, 0)) && moment >= free_from;
        let (way, _) = astar(&(None, 0), successors, |(cell, _)| self.estimate(*cell), arrived)?;
        Some(way.into_iter().map(|(cell, _)| self.place_m(cell)).collect())
    }

    /// First moment from which on nobody comes near the target any more.
    fn free_from(&self) -> usize {
        let rest = Step::rest(self.target_m);
        let free_from = |obstacle: &Obstacle<'_>| {
            let near = |moment: &usize| rest.nearest_m(&obstacle.step(*moment)) < obstacle.least_m - ROUNDING_M;
            let last = (0..obstacle.way_m.len()).rev().find(near);
            last.map_or(0, |moment| if moment + 1 < obstacle.way_m.len() { moment + 1 } else { usize::MAX })
        };
        self.obstacles.iter().filter(|obstacle| obstacle.gone_from == usize::MAX).map(free_from).max().unwrap_or(0)
    }

    fn is_free(&self, moment: usize, step: Step) -> bool {
        self.obstacles
            .iter()
            .all(|other| moment >= other.gone_from || step.keeps_from(&other.step(moment), other.least_m))
    }

    fn moves(&self, cell: Cell, moment: usize) -> Vec<((Cell, usize), u32)> {
        let from_m = self.place_m(cell);
        let centre = cell.unwrap_or_else(|| self.nearest());
        let near = (-1..=1).flat_map(|x| (-1..=1).map(move |y| (x, y)));
        let steps = near.map(|(x, y)| (Some((centre.0 + x, centre.1 + y)), cost(x, y)));
        let wait = cell.is_none().then_some((None, WAIT));
        steps
            .chain(wait)
            .filter(|(to, _)| {
                let to_m = self.place_m(*to);
                self.is_on_plate(from_m, to_m) && self.is_free(moment, Step { from_m, to_m })
            })
            .map(|(to, cost)| ((to, moment + 1), cost))
            .collect()
    }

    /// No further out than allowed, or than the part is already, or than its target.
    fn is_on_plate(&self, from_m: Vec2, to_m: Vec2) -> bool {
        let reach_m = self.reach_m.max(self.target_m.amax());
        to_m.iter().zip(from_m.iter()).all(|(to, from)| to.abs() <= reach_m.max(from.abs()))
    }

    fn place_m(&self, cell: Cell) -> Vec2 {
        cell.map_or(self.start_m, |(x, y)| self.target_m + self.pitch_m * Vec2::new(f64::from(x), f64::from(y)))
    }

    /// The lattice's place next to the start.
    fn nearest(&self) -> (i16, i16) {
        let off = (self.start_m - self.target_m) / self.pitch_m;
        (off.x.round() as i16, off.y.round() as i16)
    }

    fn estimate(&self, cell: Cell) -> u32 {
        let (x, y) = cell.unwrap_or_else(|| self.nearest());
        let (x, y) = (u32::from(x.unsigned_abs()), u32::from(y.unsigned_abs()));
        let (long, short) = (x.max(y), x.min(y));
        ((long - short) * STRAIGHT + short * DIAGONAL) * HASTE_TENTHS / 10
    }
}

fn cost(x: i16, y: i16) -> u32 {
    match x.abs() + y.abs() {
        0 => WAIT,
        1 => STRAIGHT,
        _ => DIAGONAL,
    }
}
