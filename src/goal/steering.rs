use super::Disc;
use super::assignment::assign;
use super::fleet::Fleet;
use super::routes::PLANNED_GAP_M;
use super::stages::find_stages;
use upm_core::geometry::Vec2;
use upm_core::random::{Rng, Streams};

/// The present assignment stands until another costs less than this part of it: what follows positions with noise
/// would else go to and fro.
const CLEARLY_BETTER: f64 = 0.8;

/// Gap between rims with which a way once chosen is kept, m: less than it was planned with, for parts stray from it.
const KEPT_GAP_M: f64 = 2.5e-3;

/// A stage of the ways is reached when every part is this near, m.
const STAGE_REACHED_M: f64 = 1e-3;

/// Looks after which a way is looked for again while a part is boxed in.
const PATIENCE: usize = 16;

/// Other assignments tried for parts that are boxed in.
const EXCHANGES: usize = 3;

/// Brings every part to a place: who goes where, and by what way.
#[derive(Clone, Debug)]
pub(super) struct Steering {
    discs: Vec<Disc>,
    half_side_m: f64,
    places_m: Vec<Vec2>,
    /// Parts and places with the same number may be put together.
    groups: Vec<usize>,
    /// The place of each part.
    place_of: Vec<usize>,
    /// Where each part was last seen, m.
    seen_m: Vec<Vec2>,
    /// Where all parts shall be one after another; from each to the next they go straight and in step.
    stages_m: Vec<Vec<Vec2>>,
    boxed_in: Vec<usize>,
    /// Looks since a way was looked for.
    looks: usize,
    rng: Rng,
    /// Sum of the parts' distances from their places at first, m.
    at_first_m: f64,
    /// Furthest so far, 0 to 1.
    progress: f64,
}

impl Steering {
    /// One place for each part; those with the same number in `groups` may be exchanged. A part without a place
    /// stays where it is seen first.
    pub(super) fn new(
        discs: &[Disc],
        half_side_m: f64,
        places_m: &[Vec2],
        groups: Vec<usize>,
        parts_in_table_m: &[Vec2],
    ) -> Self {
        let parts = parts_in_table_m.len();
        let seen_m: Vec<Vec2> =
            parts_in_table_m.iter().map(|part_m| if is_finite(*part_m) { *part_m } else { Vec2::zeros() }).collect();
        let place = |i: usize| places_m.get(i).copied().unwrap_or(seen_m[i]);
        let group = |i: usize| if i < places_m.len() { groups.get(i).copied().unwrap_or(i) } else { usize::MAX - i };
        let mut steering = Self {
            discs: (0..parts).map(|i| discs.get(i).copied().unwrap_or_default()).collect(),
            half_side_m,
            places_m: (0..parts).map(place).collect(),
            groups: (0..parts).map(group).collect(),
            place_of: Vec::new(),
            seen_m,
            stages_m: Vec::new(),
            boxed_in: Vec::new(),
            looks: 0,
            rng: Streams::new(0).stream("routes"),
            at_first_m: 0.0,
            progress: 0.0,
        };
        steering.place_of = steering.best_assignment(&[]);
        steering.at_first_m = steering.distances_m().sum();
        steering
    }

    /// Takes note of where parts are, m; a position that is not a number leaves a part where it was.
    pub(super) fn see(&mut self, parts_in_table_m: &[Vec2]) {
        for (seen, part) in self.seen_m.iter_mut().zip(parts_in_table_m) {
            if is_finite(*part) {
                *seen = *part;
            }
        }
    }

    /// Takes note of where parts are, m, and settles where they go.
    pub(super) fn look(&mut self, parts_in_table_m: &[Vec2]) {
        self.see(parts_in_table_m);
        self.exchange_places();
        if self.at_first_m > 0.0 {
            let left = self.distances_m().sum::<f64>() / self.at_first_m;
            self.progress = self.progress.max(1.0 - left);
        }
        self.looks += 1;
        if !self.keep_way() {
            self.find_way();
        }
    }

    /// The place of each part as things stand, m.
    pub(super) fn targets_m(&self) -> Vec<Vec2> {
        self.place_of.iter().map(|&place| self.places_m[place]).collect()
    }

    /// Where each part should go next, m: straight there and all in step they keep apart.
    pub(super) fn subgoals_m(&self) -> Vec<Vec2> {
        self.stages_m.first().unwrap_or(&self.seen_m).clone()
    }

    /// What is being done, in words: where to, by what way and how many are there. Parts are told by their number
    /// in the order of the job, from 1.
    pub(super) fn phase(&self, to: &str, there: usize) -> String {
        let of = self.seen_m.len();
        let numbers: Vec<String> = self.boxed_in.iter().map(|part| (part + 1).to_string()).collect();
        match self.stages_m.len() {
            _ if of == 0 => "no parts".into(),
            _ if !numbers.is_empty() => format!("{to}: {there} of {of} there, part {} boxed in", numbers.join(", ")),
            0 | 1 => format!("{to}, straight: {there} of {of} there"),
            _ => format!("{to}, round each other: {there} of {of} there"),
        }
    }

    /// Parts that have no way to their places as things stand.
    pub(super) fn boxed_in(&self) -> &[usize] {
        &self.boxed_in
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

    fn best_assignment(&self, never: &[(usize, usize)]) -> Vec<usize> {
        assign(self.seen_m.len(), self.places_m.len(), |part, place| {
            if self.may((part, &place), never) {
                (self.seen_m[part] - self.places_m[place]).norm_squared()
            } else {
                f64::INFINITY
            }
        })
    }

    fn may(&self, (part, place): (usize, &usize), never: &[(usize, usize)]) -> bool {
        self.groups[part] == self.groups[*place] && !never.contains(&(part, *place))
    }

    fn cost_m2(&self, place_of: &[usize]) -> f64 {
        self.seen_m.iter().zip(place_of).map(|(seen_m, &place)| (seen_m - self.places_m[place]).norm_squared()).sum()
    }

    fn fleet(&self, place_of: &[usize]) -> Fleet {
        let targets_m = place_of.iter().map(|&place| self.places_m[place]).collect();
        Fleet::new(self.discs.clone(), self.half_side_m, targets_m)
    }

    /// Takes a clearly better assignment; on a way round only when it is straight from there, so that
    /// exchanges come to an end.
    fn exchange_places(&mut self) {
        let better = self.best_assignment(&[]);
        if self.cost_m2(&better) >= CLEARLY_BETTER * self.cost_m2(&self.place_of) {
            return;
        }
        let fleet = self.fleet(&better);
        if self.stages_m.len() < 2 || fleet.is_clear(&self.seen_m, fleet.targets_m(), PLANNED_GAP_M) {
            self.place_of = better;
            self.stages_m.clear();
        }
    }

    /// Goes on to the last stage that can be reached straight; false when there is none.
    fn keep_way(&mut self) -> bool {
        if !self.boxed_in.is_empty() && self.looks > PATIENCE {
            return false;
        }
        let fleet = self.fleet(&self.place_of);
        let clear = |stage_m: &Vec<Vec2>| fleet.is_clear(&self.seen_m, stage_m, KEPT_GAP_M);
        let Some(next) = self.stages_m.iter().rposition(clear) else { return false };
        self.stages_m.drain(..next);
        let reached = |stage_m: &Vec<Vec2>| {
            stage_m.iter().zip(&self.seen_m).all(|(to, from)| (to - from).norm() <= STAGE_REACHED_M)
        };
        self.stages_m.len() == 1 || !self.stages_m.first().is_some_and(reached)
    }

    /// Finds a way anew. Where it leaves parts boxed in, others of their kind may take their places.
    fn find_way(&mut self) {
        self.looks = 0;
        let mut best = find_stages(&self.fleet(&self.place_of), &self.seen_m, &mut self.rng);
        let mut never = Vec::new();
        for _ in 0..EXCHANGES {
            never.extend(best.boxed_in.iter().map(|&part| (part, self.place_of[part])));
            let other = self.best_assignment(&never);
            if best.boxed_in.is_empty() || other.iter().enumerate().any(|pair| !self.may(pair, &never)) {
                break;
            }
            let found = find_stages(&self.fleet(&other), &self.seen_m, &mut self.rng);
            if found.boxed_in.len() < best.boxed_in.len() {
                (best, self.place_of) = (found, other);
            }
        }
        (self.boxed_in, self.stages_m) = (best.boxed_in, best.places_m);
    }
}

fn is_finite(p: Vec2) -> bool {
    p.iter().all(|x| x.is_finite())
}
