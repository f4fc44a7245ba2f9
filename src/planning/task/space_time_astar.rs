use pathfinding::prelude::astar;

use super::multi_disc::{ROUNDING_M, keep_apart};
use upm_core::geometry::{Segment, Vec2};

/// Cost of a move along x or y by one pitch.
const STRAIGHT: u32 = 10;
/// Cost of a move along a diagonal.
const DIAGONAL: u32 = 14;
/// Cost of a wait.
const WAIT: u32 = 5;

/// Weight of the estimate of the remaining cost, in tenths: a larger one finds a route sooner, but not the shortest.
const HASTE_TENTHS: u32 = 18;

/// A part whose route is known: its position at every moment, constant after the last.
pub(super) struct MovingObstacle<'a> {
    pub(super) way_m: &'a [Vec2],
    /// Least distance of the centres, m.
    pub(super) least_m: f64,
    /// Moment from which the obstacle is ignored, because it will have made room.
    pub(super) gone_from: usize,
}

impl MovingObstacle<'_> {
    fn step(&self, moment: usize) -> Segment {
        let at = |moment: usize| self.way_m.get(moment).or(self.way_m.last()).copied().unwrap_or_default();
        Segment { from: at(moment), to: at(moment + 1) }
    }
}

/// Constraints on one part's route.
pub(super) struct PathQuery<'a> {
    pub(super) start_m: Vec2,
    pub(super) target_m: Vec2,
    /// Largest allowed |x| and |y| of the part's centre, m.
    pub(super) reach_m: f64,
    pub(super) obstacles: &'a [MovingObstacle<'a>],
    /// Longest move along x or y from one moment to the next, m.
    pub(super) pitch_m: f64,
    /// Last moment at which the part may arrive.
    pub(super) horizon: usize,
}

/// Node of the lattice about the target; `None` is the start, which is not on the lattice.
type SpaceTimeCell = Option<(i16, i16)>;

impl PathQuery<'_> {
    /// The straight route in `moments` equal steps, begun after `wait` moments, if it is free.
    pub(super) fn straight(&self, wait: usize, moments: usize) -> Option<Vec<Vec2>> {
        let share = |k: usize| (k.saturating_sub(wait) as f64 / moments.max(1) as f64).min(1.0);
        let at = |k: usize| self.start_m.lerp(&self.target_m, share(k));
        let end = wait + moments.max(1);
        let free = (0..end).all(|k| self.is_free(k, Segment { from: at(k), to: at(k + 1) }));
        (free && end >= self.free_from()).then(|| (0..=end).map(at).collect())
    }

    /// A route from start to target, its position at every moment, found by A* over positions and moments. Each
    /// expanded node is subtracted from `effort`; the search fails when that is used up.
    pub(super) fn way(&self, effort: &mut usize) -> Option<Vec<Vec2>> {
        let free_from = self.free_from();
        let successors = |&(cell, moment): &(SpaceTimeCell, usize)| {
            let go_on = *effort > 0 && moment < self.horizon;
            *effort = effort.saturating_sub(1);
            if go_on { self.moves(cell, moment) } else { Vec::new() }
        };
        let arrived = |&(cell, moment): &(SpaceTimeCell, usize)| cell == Some((0, 0)) && moment >= free_from;
        let (way, _) = astar(&(None, 0), successors, |(cell, _)| self.estimate(*cell), arrived)?;
        Some(way.into_iter().map(|(cell, _)| self.place_m(cell)).collect())
    }

    /// First moment from which no obstacle comes near the target.
    fn free_from(&self) -> usize {
        let free_from = |obstacle: &MovingObstacle<'_>| {
            let near = |moment: &usize| obstacle.step(*moment).distance(self.target_m) < obstacle.least_m - ROUNDING_M;
            let last = (0..obstacle.way_m.len()).rev().find(near);
            last.map_or(0, |moment| if moment + 1 < obstacle.way_m.len() { moment + 1 } else { usize::MAX })
        };
        self.obstacles.iter().filter(|obstacle| obstacle.gone_from == usize::MAX).map(free_from).max().unwrap_or(0)
    }

    fn is_free(&self, moment: usize, step: Segment) -> bool {
        self.obstacles
            .iter()
            .all(|other| moment >= other.gone_from || keep_apart(&step, &other.step(moment), other.least_m))
    }

    fn moves(&self, cell: SpaceTimeCell, moment: usize) -> Vec<((SpaceTimeCell, usize), u32)> {
        let from_m = self.place_m(cell);
        let centre = cell.unwrap_or_else(|| self.nearest());
        let near = (-1..=1).flat_map(|x| (-1..=1).map(move |y| (x, y)));
        let cost = |x: i16, y: i16| [WAIT, STRAIGHT, DIAGONAL][usize::from(x.unsigned_abs() + y.unsigned_abs())];
        let steps = near.map(|(x, y)| (Some((centre.0 + x, centre.1 + y)), cost(x, y)));
        let wait = cell.is_none().then_some((None, WAIT));
        steps
            .chain(wait)
            .filter(|(to, _)| {
                let to_m = self.place_m(*to);
                self.is_on_plate(from_m, to_m) && self.is_free(moment, Segment { from: from_m, to: to_m })
            })
            .map(|(to, cost)| ((to, moment + 1), cost))
            .collect()
    }

    /// True when the move ends no further out than allowed, or than the part already is, or than its target.
    fn is_on_plate(&self, from_m: Vec2, to_m: Vec2) -> bool {
        let reach_m = self.reach_m.max(self.target_m.amax());
        to_m.iter().zip(from_m.iter()).all(|(to, from)| to.abs() <= reach_m.max(from.abs()))
    }

    fn place_m(&self, cell: SpaceTimeCell) -> Vec2 {
        cell.map_or(self.start_m, |(x, y)| self.target_m + self.pitch_m * Vec2::new(f64::from(x), f64::from(y)))
    }

    /// The node of the lattice nearest to the start.
    fn nearest(&self) -> (i16, i16) {
        let off = (self.start_m - self.target_m) / self.pitch_m;
        (off.x.round() as i16, off.y.round() as i16)
    }

    fn estimate(&self, cell: SpaceTimeCell) -> u32 {
        let (x, y) = cell.unwrap_or_else(|| self.nearest());
        let (x, y) = (u32::from(x.unsigned_abs()), u32::from(y.unsigned_abs()));
        let (long, short) = (x.max(y), x.min(y));
        ((long - short) * STRAIGHT + short * DIAGONAL) * HASTE_TENTHS / 10
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn query<'a>(start_m: Vec2, target_m: Vec2, obstacles: &'a [MovingObstacle<'a>]) -> PathQuery<'a> {
        PathQuery { start_m, target_m, reach_m: 0.14, obstacles, pitch_m: 0.005, horizon: 200 }
    }

    fn length_m(way_m: &[Vec2]) -> f64 {
        way_m.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum()
    }

    /// Discs all round a position, `apart_m` from each other and `out_m` from it.
    fn wall(about_m: Vec2, out_m: f64, apart_m: f64) -> Vec<[Vec2; 1]> {
        let count = (std::f64::consts::TAU * out_m / apart_m) as usize;
        let at = |i: usize| std::f64::consts::TAU * i as f64 / count as f64;
        (0..count).map(|i| [about_m + out_m * Vec2::new(at(i).cos(), at(i).sin())]).collect()
    }

    fn obstacles(ways_m: &[[Vec2; 1]], least_m: f64) -> Vec<MovingObstacle<'_>> {
        ways_m.iter().map(|way_m| MovingObstacle { way_m, least_m, gone_from: usize::MAX }).collect()
    }

    #[test]
    fn path_leads_around_a_standing_obstacle() {
        let (start, target) = (Vec2::new(-0.05, 0.001), Vec2::new(0.05, 0.0));
        let standing = [[Vec2::zeros()]];
        let way_m = query(start, target, &obstacles(&standing, 0.03)).way(&mut 5000).unwrap();
        // tangents to a circle of 30 mm and the arc between them
        let shortest_m = 2.0 * (0.05_f64.powi(2) - 0.03_f64.powi(2)).sqrt() + 0.03 * 2.0 * (0.03_f64 / 0.05).asin();
        assert!(length_m(&way_m) > shortest_m - 0.001 && length_m(&way_m) < 1.15 * shortest_m);
        assert!(query(start, target, &obstacles(&standing, 0.03)).straight(0, 20).is_none());
        assert_eq!(query(start, target, &[]).straight(2, 20).unwrap().len(), 23);
    }

    #[test]
    fn no_way_leads_out_of_a_closed_wall() {
        let (start, target) = (Vec2::zeros(), Vec2::new(0.1, 0.0));
        for (apart_m, open) in [(0.02, false), (0.045, true)] {
            let standing = wall(start, 0.05, apart_m);
            let way_m = query(start, target, &obstacles(&standing, 0.02)).way(&mut 100_000);
            assert_eq!(way_m.is_some(), open, "{apart_m}");
        }
    }

    #[test]
    fn it_waits_until_the_target_is_free_for_good() {
        let target = Vec2::new(0.03, 0.0);
        // passes over the target at moment 20
        let passing: Vec<Vec2> = (0..=40).map(|k| target + Vec2::new(0.0, 0.005 * f64::from(k - 20))).collect();
        let obstacles = [MovingObstacle { way_m: &passing, least_m: 0.02, gone_from: usize::MAX }];
        let way_m = query(Vec2::zeros(), target, &obstacles).way(&mut 5000).unwrap();
        assert!(way_m.len() > 24 && *way_m.last().unwrap() == target, "{}", way_m.len());
        let leaving = [MovingObstacle { way_m: &passing[20..=20], least_m: 0.02, gone_from: 3 }];
        assert!(query(Vec2::zeros(), target, &leaving).way(&mut 5000).unwrap().len() < 12);
    }
}
