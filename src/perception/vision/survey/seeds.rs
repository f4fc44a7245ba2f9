//! Candidates for the middles of discs: the edges of an averaged picture vote for them along their gradients.

use super::super::Table;
use super::super::binned::BinnedImage;
use super::super::edges::{EdgePoint, steepest_edges};
use upm_core::geometry::Vec2;

/// Radii voted for: least, cells, and largest as a fraction of the rectangle's shorter side.
const LEAST_RADIUS: f64 = 6.0;
const LARGEST_SHARE: f64 = 0.17;
/// Share of the cells among whose gradients the steepest edges are taken.
const STEEPEST: f64 = 0.25;
/// Directions that are counted apart: the sides of squares fill four, an arc all.
const SECTORS: usize = 8;
/// Least sum of the directions' roots of votes for a middle, over a square of 3 by 3 cells. Roots of counts scatter
/// alike everywhere.
const LEAST_VOTES: f32 = 10.0;
/// Most places tried.
const MOST_PEAKS: usize = 400;
/// Share of a circle that edges must cover for its radius to become a seed.
const LEAST_COVER: f64 = 0.25;
/// Least cosine between an edge's gradient and the radius of the circle it belongs to.
const ALONG_RADIUS: f64 = 0.9;
/// Distance of edges from the plate's sides, cells.
const OFF_SIDES: f64 = 2.5;
/// Distance within which edges belong to a measured circle, cells; all edges inside it do.
const OWN: f64 = 1.6;

/// Edges not yet attributed to a disc, and the middles they vote for.
pub(super) struct Votes {
    width: usize,
    /// Positions in cells.
    edges: Vec<EdgePoint>,
    largest: f64,
    /// Places by votes, most votes last.
    peaks: Vec<(f32, usize)>,
}

impl Votes {
    pub(super) fn of(picture: &BinnedImage, table: &Table) -> Self {
        let (width, height, bin) = (picture.width, picture.height, picture.bin as f64);
        let largest = (LARGEST_SHARE * width.min(height) as f64).max(LEAST_RADIUS + 1.0);
        let mut edges = steepest_edges(picture, STEEPEST);
        let margin_m = OFF_SIDES * bin / table.mean_px_per_m();
        edges.retain(|edge| table.holds(table.table_from_image(edge.at_px), margin_m));
        for edge in &mut edges {
            edge.at_px = (edge.at_px - picture.frame_from_cell(Vec2::zeros())) / bin;
        }
        let mut votes = Self { width, edges, largest, peaks: Vec::new() };
        votes.peaks = peaks(&votes.cast(height), width);
        votes
    }

    /// Votes of all edges, by cell and direction.
    fn cast(&self, height: usize) -> Vec<[u8; SECTORS]> {
        let mut votes = vec![[0u8; SECTORS]; self.width * height];
        for edge in &self.edges {
            for side in [1.0, -1.0] {
                let step = edge.outward * side;
                let turn = libm::atan2(step.y, step.x) / std::f64::consts::TAU + 1.0;
                let sector = (turn * SECTORS as f64).round() as usize % SECTORS;
                let mut at = edge.at_px + step * LEAST_RADIUS;
                for _ in 0..(self.largest - LEAST_RADIUS) as usize {
                    let (x, y) = ((at.x + 0.5) as usize, (at.y + 0.5) as usize);
                    if at.x > 0.0 && at.y > 0.0 && x < self.width && y < height {
                        let vote = &mut votes[y * self.width + x][sector];
                        *vote = vote.saturating_add(1);
                    }
                    at += step;
                }
            }
        }
        votes
    }

    /// The next likely middle, in cells.
    pub(super) fn next_middle(&mut self) -> Option<Vec2> {
        let (_, cell) = self.peaks.pop()?;
        Some(Vec2::new((cell % self.width) as f64, (cell / self.width) as f64))
    }

    /// Radii about a place with enough of the edges that are left, at most two, the one with most first.
    pub(super) fn radii_about(&self, cell: Vec2) -> Vec<f64> {
        let mut counts = vec![0.0f64; self.largest as usize + 3];
        for edge in &self.edges {
            let off = edge.at_px - cell;
            let radius = off.norm();
            if radius < self.largest + 1.0 && off.dot(&edge.outward).abs() > ALONG_RADIUS * radius {
                counts[radius.round() as usize] += 1.0;
            }
        }
        let cover = |k: &usize| counts[k - 1..=k + 1].iter().sum::<f64>() / (std::f64::consts::TAU * *k as f64);
        let is_peak = |k: &usize| counts[*k] >= counts[k - 1] && counts[*k] > counts[k + 1];
        let all = LEAST_RADIUS as usize..counts.len() - 1;
        let mut found: Vec<usize> = all.filter(|k| is_peak(k) && cover(k) > LEAST_COVER).collect();
        found.sort_by(|a, b| cover(b).total_cmp(&cover(a)));
        found.into_iter().take(2).map(|k| k as f64).collect()
    }

    /// Withdraws the edges on and within a measured disc.
    pub(super) fn remove_votes(&mut self, cell: Vec2, radius_cells: f64) {
        self.edges.retain(|edge| (edge.at_px - cell).norm() > radius_cells + OWN);
    }
}

/// Cells with more votes around them than any neighbour has, most last.
fn peaks(votes: &[[u8; SECTORS]], width: usize) -> Vec<(f32, usize)> {
    let height = votes.len() / width.max(1);
    let mut around = vec![0.0f32; votes.len()];
    for y in 1..height.saturating_sub(1) {
        for x in 1..width.saturating_sub(1) {
            let mut sums = [0u16; SECTORS];
            for row in [y - 1, y, y + 1] {
                for cell in &votes[row * width + x - 1..][..3] {
                    sums.iter_mut().zip(cell).for_each(|(sum, &n)| *sum += u16::from(n));
                }
            }
            around[y * width + x] = sums.iter().map(|&sum| f32::from(sum).sqrt()).sum();
        }
    }
    let is_peak = |&i: &usize| {
        let near = (0..25).map(|k| i + k / 5 * width + k % 5).map(|k| k.checked_sub(2 * width + 2));
        near.flatten().all(|k| around.get(k).is_none_or(|other| (*other, i) <= (around[i], k)))
    };
    let all = (0..around.len()).filter(|&i| around[i] >= LEAST_VOTES).filter(is_peak);
    let mut found: Vec<(f32, usize)> = all.map(|i| (around[i], i)).collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    found.drain(..found.len().saturating_sub(MOST_PEAKS));
    found
}
