//! Candidates for the middles of discs: the edges of an averaged picture vote for them along their gradients.

use super::relative::Relative;
use upm_core::geometry::Vec2;

/// Radii voted for: least, cells, and largest as a fraction of the rectangle's shorter side.
const LEAST_RADIUS: f64 = 6.0;
const LARGEST_SHARE: f64 = 0.17;
/// Least steepness of an edge, in multiples of the median cell's and absolute, as a fraction of the plate's level per
/// cell.
const OVER_MEDIAN: f32 = 4.0;
const FAINTEST: f32 = 0.012;
/// Fewest votes of a middle, over a square of 3 by 3 cells.
const LEAST_VOTES: u16 = 24;
/// Most places tried.
const MOST_PEAKS: usize = 200;
/// Share of a circle that edges must cover for its radius to become a seed.
const LEAST_COVER: f64 = 0.35;
/// Least cosine between an edge's gradient and the radius of the circle it belongs to.
const ALONG_RADIUS: f64 = 0.9;
/// Distance within which edges belong to a measured circle, cells; all edges inside it do.
const OWN: f64 = 1.6;
/// Most edges kept, the steepest.
const MOST_EDGES: usize = 8_000;

/// A candidate disc.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seed {
    pub(super) cell: Vec2,
    pub(super) radius_cells: f64,
}

/// A place on the crest of a gradient.
#[derive(Clone, Copy)]
struct Edge {
    at: Vec2,
    /// Unit vector along the gradient.
    along: Vec2,
    steepness: f32,
}

/// Edges not yet attributed to a disc, and the middles they vote for.
pub(super) struct Votes {
    width: usize,
    edges: Vec<Edge>,
    radii: (f64, f64),
    /// Places by votes, most votes last.
    peaks: Vec<(u16, usize)>,
    /// Untried radii of the last place examined.
    pending: Vec<Seed>,
}

impl Votes {
    pub(super) fn of(picture: &Relative) -> Self {
        let (width, height) = (picture.width, picture.height);
        let largest = (LARGEST_SHARE * width.min(height) as f64).max(LEAST_RADIUS + 1.0);
        let edges = edges(picture);
        let mut votes = Self { width, edges, radii: (LEAST_RADIUS, largest), peaks: Vec::new(), pending: Vec::new() };
        votes.peaks = peaks(&votes.cast(height), width);
        votes
    }

    /// Votes of all edges, cell by cell.
    fn cast(&self, height: usize) -> Vec<u16> {
        let mut votes = vec![0u16; self.width * height];
        let (least, largest) = self.radii;
        for edge in &self.edges {
            for side in [1.0, -1.0] {
                let step = edge.along * side;
                let mut at = edge.at + step * least;
                for _ in 0..(largest - least) as usize {
                    let (x, y) = ((at.x + 0.5) as usize, (at.y + 0.5) as usize);
                    if at.x > 0.0 && at.y > 0.0 && x < self.width && y < height {
                        let vote = &mut votes[y * self.width + x];
                        *vote = vote.saturating_add(1);
                    }
                    at += step;
                }
            }
        }
        votes
    }

    /// The next candidate disc among the edges that are left.
    pub(super) fn next_seed(&mut self) -> Option<Seed> {
        loop {
            if let Some(seed) = self.pending.pop() {
                return Some(seed);
            }
            let (_, cell) = self.peaks.pop()?;
            let cell = Vec2::new((cell % self.width) as f64, (cell / self.width) as f64);
            self.pending = self.radii_about(cell);
        }
    }

    /// Radii about a place with enough edges, those with most last.
    fn radii_about(&self, cell: Vec2) -> Vec<Seed> {
        let mut counts = vec![0.0f64; self.radii.1 as usize + 3];
        for edge in &self.edges {
            let off = edge.at - cell;
            let radius = off.norm();
            if radius < self.radii.1 + 1.0 && off.dot(&edge.along).abs() > ALONG_RADIUS * radius {
                counts[radius.round() as usize] += 1.0;
            }
        }
        let cover = |k: usize| (counts[k - 1] + counts[k] + counts[k + 1]) / (std::f64::consts::TAU * k as f64);
        let mut found: Vec<(f64, Seed)> = Vec::new();
        for k in LEAST_RADIUS as usize..counts.len() - 1 {
            let is_peak = counts[k] >= counts[k - 1] && counts[k] > counts[k + 1];
            if is_peak && cover(k) > LEAST_COVER {
                found.push((cover(k), Seed { cell, radius_cells: k as f64 }));
            }
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        found.into_iter().rev().take(2).rev().map(|(_, seed)| seed).collect()
    }

    /// Withdraws the edges on and within a measured disc.
    pub(super) fn remove_votes(&mut self, cell: Vec2, radius_cells: f64) {
        self.edges.retain(|edge| (edge.at - cell).norm() > radius_cells + OWN);
        self.pending.clear();
    }
}

/// Cells with more votes around them than any neighbour has, most last.
fn peaks(votes: &[u16], width: usize) -> Vec<(u16, usize)> {
    let height = votes.len() / width.max(1);
    let mut around = vec![0u16; votes.len()];
    for y in 1..height.saturating_sub(1) {
        for x in 1..width.saturating_sub(1) {
            let rows = [y - 1, y, y + 1].map(|row| &votes[row * width + x - 1..][..3]);
            around[y * width + x] = rows.into_iter().flatten().fold(0, |sum, &n| sum.saturating_add(n));
        }
    }
    let mut found = Vec::new();
    for y in 2..height.saturating_sub(2) {
        for x in 2..width.saturating_sub(2) {
            let i = y * width + x;
            let here = around[i];
            if here < LEAST_VOTES {
                continue;
            }
            let neighbours = (0..25).filter(|&k| k != 12).map(|k| (k, around[(y + k / 5 - 2) * width + x + k % 5 - 2]));
            if neighbours.into_iter().all(|(k, other)| if k < 12 { here > other } else { here >= other }) {
                found.push((here, i));
            }
        }
    }
    found.sort_unstable();
    found.drain(..found.len().saturating_sub(MOST_PEAKS));
    found
}

/// Crests of the gradient (Scharr's), steepest among their neighbours along it.
fn edges(picture: &Relative) -> Vec<Edge> {
    let (width, height) = (picture.width, picture.height);
    if width < 5 || height < 5 {
        return Vec::new();
    }
    let at = |i: usize| picture.values[i];
    let mut slopes = vec![[0.0f32; 2]; width * height];
    let mut steepness = vec![0.0f32; width * height];
    for y in 1..height - 1 {
        for i in y * width + 1..(y + 1) * width - 1 {
            let [up, down] = [i - width, i + width];
            let x = 3.0 * (at(up + 1) - at(up - 1) + at(down + 1) - at(down - 1)) + 10.0 * (at(i + 1) - at(i - 1));
            let y = 3.0 * (at(down - 1) - at(up - 1) + at(down + 1) - at(up + 1)) + 10.0 * (at(down) - at(up));
            slopes[i] = [x / 32.0, y / 32.0];
            steepness[i] = (x * x + y * y).sqrt() / 32.0;
        }
    }
    let mut some: Vec<f32> = steepness.iter().copied().step_by(7).collect();
    let median = some.len() / 2;
    let median = *some.select_nth_unstable_by(median, f32::total_cmp).1;
    let least = (OVER_MEDIAN * median).max(FAINTEST);
    let mut found = Vec::new();
    for y in 2..height - 2 {
        for i in y * width + 2..(y + 1) * width - 2 {
            if steepness[i] < least {
                continue;
            }
            let [x, dy] = slopes[i];
            let across = x.abs() >= dy.abs();
            let step = if across { 1 } else { width };
            let (before, here, after) = (steepness[i - step], steepness[i], steepness[i + step]);
            if here >= before && here > after {
                let off = f64::from(0.5 * (after - before) / (2.0 * here - after - before));
                let shift = if across { Vec2::new(off, 0.0) } else { Vec2::new(0.0, off) };
                let along = Vec2::new(f64::from(x), f64::from(dy)) / f64::from(here);
                found.push(Edge { at: Vec2::new((i % width) as f64, y as f64) + shift, along, steepness: here });
            }
        }
    }
    if found.len() > MOST_EDGES {
        found.sort_by(|a, b| b.steepness.total_cmp(&a.steepness));
        found.truncate(MOST_EDGES);
    }
    found
}
