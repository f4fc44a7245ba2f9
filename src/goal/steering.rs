use super::Disc;
use super::assignment::assign;
use crate::geometry::Vec2;

/// The present assignment stands until another costs less than this part of it: what follows positions with noise
/// would else go to and fro.
const CLEARLY_BETTER: f64 = 0.8;

/// Brings every part to a place: who goes where, and by what way.
#[derive(Clone, Debug)]
pub(super) struct Steering {
    discs: Vec<Disc>,
    places_m: Vec<Vec2>,
    /// Parts and places with the same number may be put together, m.
    groups: Vec<usize>,
    /// The place of each part.
    place_of: Vec<usize>,
    /// Where each part was last seen, m.
    seen_m: Vec<Vec2>,
    /// Sum of the parts' distances from their places at first, m.
    at_first_m: f64,
    /// Furthest so far, 0 to 1.
    progress: f64,
}

impl Steering {
    /// One place for each part; those with the same number in `groups` may be exchanged. A part without a place
    /// stays where it is seen first.
    pub(super) fn new(discs: &[Disc], places_m: &[Vec2], groups: Vec<usize>, parts_in_table_m: &[Vec2]) -> Self {
        let parts = parts_in_table_m.len();
        let seen_m: Vec<Vec2> =
            parts_in_table_m.iter().map(|part_m| if is_finite(*part_m) { *part_m } else { Vec2::zeros() }).collect();
        let place = |i: usize| places_m.get(i).copied().unwrap_or(seen_m[i]);
        let group = |i: usize| if i < places_m.len() { groups.get(i).copied().unwrap_or(i) } else { usize::MAX - i };
        let mut steering = Self {
            discs: (0..parts).map(|i| discs.get(i).copied().unwrap_or_default()).collect(),
            places_m: (0..parts).map(place).collect(),
            groups: (0..parts).map(group).collect(),
            place_of: Vec::new(),
            seen_m,
            at_first_m: 0.0,
            progress: 0.0,
        };
        steering.place_of = steering.best_assignment();
        steering.at_first_m = steering.distances_m().sum();
        steering
    }

    /// Takes note of where parts are; a position that is not a number leaves a part where it was.
    pub(super) fn look(&mut self, parts_in_table_m: &[Vec2]) {
        for (seen, part) in self.seen_m.iter_mut().zip(parts_in_table_m) {
            if is_finite(*part) {
                *seen = *part;
            }
        }
        let better = self.best_assignment();
        if self.cost_m2(&better) < CLEARLY_BETTER * self.cost_m2(&self.place_of) {
            self.place_of = better;
        }
        if self.at_first_m > 0.0 {
            let left = self.distances_m().sum::<f64>() / self.at_first_m;
            self.progress = self.progress.max(1.0 - left);
        }
    }

    /// The place of each part as things stand, m.
    pub(super) fn targets_m(&self) -> Vec<Vec2> {
        self.place_of.iter().map(|&place| self.places_m[place]).collect()
    }

    /// Where each part should go next, m.
    pub(super) fn subgoals_m(&self) -> Vec<Vec2> {
        self.targets_m()
    }

    /// Where each part was last seen, m.
    pub(super) fn seen_m(&self) -> &[Vec2] {
        &self.seen_m
    }

    /// Distance of each part from its place, m.
    pub(super) fn distances_m(&self) -> impl Iterator<Item = f64> {
        self.seen_m.iter().zip(&self.place_of).map(|(seen_m, &place)| (seen_m - self.places_m[place]).norm())
    }

    /// Part of the way that is behind the parts, 0 to 1.
    pub(super) fn progress(&self) -> f64 {
        self.progress
    }

    fn best_assignment(&self) -> Vec<usize> {
        assign(self.seen_m.len(), self.places_m.len(), |part, place| {
            if self.groups[part] == self.groups[place] {
                (self.seen_m[part] - self.places_m[place]).norm_squared()
            } else {
                f64::INFINITY
            }
        })
    }

    fn cost_m2(&self, place_of: &[usize]) -> f64 {
        self.seen_m.iter().zip(place_of).map(|(seen_m, &place)| (seen_m - self.places_m[place]).norm_squared()).sum()
    }
}

fn is_finite(p: Vec2) -> bool {
    p.iter().all(|x| x.is_finite())
}
