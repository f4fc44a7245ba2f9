//! Hough array over angle and distance (Duda and Hart, 1972), each edge voting only near its own gradient's direction.

use std::f64::consts::TAU;

use super::HoughArray;
use crate::geometry::Vec2;

/// Columns: one degree each.
const ANGLES: usize = 360;
/// How far to both sides of its own direction an edge votes, columns.
const SPREAD: i32 = 3;
/// Peaks nearer than this in angle are one peak, columns.
const APART: i64 = 5;

/// An edge in ideal coordinates, where the table's sides are straight.
#[derive(Clone, Copy, Debug)]
pub(super) struct IdealEdge {
    /// Place, px.
    pub(super) at: Vec2,
    /// Unit vector from light to dark.
    pub(super) outward: Vec2,
}

/// The line `normal · p = offset` in ideal coordinates, px.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line {
    pub(super) normal: Vec2,
    pub(super) offset: f64,
}

impl Line {
    /// The line through two points, its normal a quarter turn from `a → b` towards negative angles.
    pub(super) fn through(a: Vec2, b: Vec2) -> Self {
        let along = (b - a).normalize();
        let normal = Vec2::new(along.y, -along.x);
        Self { normal, offset: normal.dot(&a) }
    }

    /// Signed distance of `p`.
    pub(super) fn distance(&self, p: Vec2) -> f64 {
        self.normal.dot(&p) - self.offset
    }

    /// Place of `p` along the line.
    pub(super) fn along(&self, p: Vec2) -> f64 {
        self.normal.x * p.y - self.normal.y * p.x
    }

    /// Where two lines meet.
    pub(super) fn meets(&self, other: &Self) -> Option<Vec2> {
        let (n, m) = (self.normal, other.normal);
        let det = n.x * m.y - n.y * m.x;
        let p = Vec2::new(self.offset * m.y - other.offset * n.y, other.offset * n.x - self.offset * m.x) / det;
        (det.abs() > 1e-6 && p.x.is_finite() && p.y.is_finite()).then_some(p)
    }
}

/// Votes of all edges about `center`. An edge votes for lines whose normal points from light to dark, the way out of
/// a bright plate; lines that would lie at negative distance are entered turned by half a turn.
pub(super) fn vote(edges: &[IdealEdge], center: Vec2, farthest_px: f64, px_per_row: f64) -> HoughArray {
    let distances = (farthest_px / px_per_row).ceil() as usize + 2;
    let mut votes = vec![0.0f32; ANGLES * distances];
    let directions: Vec<[f32; 2]> = (0..ANGLES)
        .map(|column| direction(column as f64) / px_per_row)
        .map(|step| [step.x as f32, step.y as f32])
        .collect();
    for edge in edges {
        let p = edge.at - center;
        let (x, y) = (p.x as f32, p.y as f32);
        let own = (edge.outward.y as f32).atan2(edge.outward.x as f32) * (ANGLES as f32 / std::f32::consts::TAU);
        let mut column = (own.round() as i32 - SPREAD).rem_euclid(ANGLES as i32) as usize;
        for _ in 0..=2 * SPREAD {
            let distance = x * directions[column][0] + y * directions[column][1];
            let turned = if distance >= 0.0 {
                column
            } else if column < ANGLES / 2 {
                column + ANGLES / 2
            } else {
                column - ANGLES / 2
            };
            let row = distance.abs();
            let first = row as usize;
            let share = row - first as f32;
            if first + 1 < distances {
                votes[first * ANGLES + turned] += 1.0 - share;
                votes[(first + 1) * ANGLES + turned] += share;
            }
            column = if column + 1 == ANGLES { 0 } else { column + 1 };
        }
    }
    HoughArray { angles: ANGLES, distances, px_per_row, votes, peaks: Vec::new() }
}

fn direction(column: f64) -> Vec2 {
    let (sin, cos) = (column / ANGLES as f64 * TAU).sin_cos();
    Vec2::new(cos, sin)
}

/// The highest peaks, highest first: column and row, at most `count`, none below `least` of the highest.
pub(super) fn peaks(array: &HoughArray, count: usize, least: f32) -> Vec<(usize, usize)> {
    let mut tops: Vec<f32> = array.votes.chunks_exact(array.angles.max(1)).map(highest).collect();
    let mut found: Vec<(usize, usize)> = Vec::new();
    let mut row_left = vec![0.0; array.angles];
    let floor = (least * highest(&tops)).max(f32::MIN_POSITIVE);
    while found.len() < count {
        let top = highest(&tops);
        let Some(row) = tops.iter().position(|&value| value == top).filter(|_| top >= floor) else { break };
        left_of(array, row, &found, &mut row_left);
        let Some(column) = row_left.iter().position(|&value| value == top) else { break };
        found.push((column, row));
        // Votes fall off within so many rows of a peak that others are not touched.
        for row in row.saturating_sub(array.reach(APART))..(row + array.reach(APART) + 1).min(array.distances) {
            left_of(array, row, &found, &mut row_left);
            tops[row] = highest(&row_left);
        }
    }
    found
}

fn highest(values: &[f32]) -> f32 {
    values.iter().fold(0.0, |best, &value| if value > best { value } else { best })
}

/// A row of votes without what belongs to the peaks found: bow ties, for seen from a direction that is off a line's
/// votes spread over more distances. Across distance 0 a neighbourhood goes on half a turn further.
fn left_of(array: &HoughArray, row: usize, found: &[(usize, usize)], out: &mut [f32]) {
    let angles = array.angles as i64;
    out.copy_from_slice(&array.votes[row * array.angles..][..array.angles]);
    for peak in found {
        let sides = [(row.abs_diff(peak.1), 0), (row + peak.1, angles / 2)];
        for (apart, turn) in sides {
            for column in -APART..=APART {
                if apart <= array.reach(column.abs()) {
                    out[(peak.0 as i64 + column + turn).rem_euclid(angles) as usize] = 0.0;
                }
            }
        }
    }
}

impl HoughArray {
    /// Rows over which the votes of a line half as long as the array is wide spread `columns` off its direction.
    fn reach(&self, columns: i64) -> usize {
        3 + (TAU / ANGLES as f64 * 0.4 * self.distances as f64 * columns as f64) as usize
    }
}

/// The line of a peak, below a cell by the centroid of the votes around it.
pub(super) fn line_at(array: &HoughArray, peak: (usize, usize), center: Vec2) -> Line {
    let (mut sum, mut column, mut row) = (0.0, 0.0, 0.0);
    for dr in -1..=1i64 {
        for dc in -1..=1i64 {
            let (r, c) = (peak.1 as i64 + dr, (peak.0 as i64 + dc).rem_euclid(array.angles as i64));
            let cell = r * array.angles as i64 + c;
            let vote = if r < 0 { 0.0 } else { f64::from(array.votes.get(cell as usize).copied().unwrap_or(0.0)) };
            sum += vote;
            column += vote * dc as f64;
            row += vote * dr as f64;
        }
    }
    let (column, row) = if sum > 0.0 { (column / sum, row / sum) } else { (0.0, 0.0) };
    let normal = direction(peak.0 as f64 + column);
    Line { normal, offset: (peak.1 as f64 + row) * array.px_per_row + normal.dot(&center) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_line_of_edges_is_the_highest_peak(angle in 0.0..TAU, distance in -150.0..150.0f64) {
            // a line through the centre has two directions, and the votes of both rows at zero may part
            prop_assume!(distance.abs() > 3.0);
            let (center, outward) = (Vec2::new(200.0, 150.0), Vec2::new(angle.cos(), angle.sin()));
            let along = Vec2::new(-outward.y, outward.x);
            let edges: Vec<_> = (-80..80)
                .map(|t| IdealEdge { at: center + distance * outward + f64::from(t) * along, outward })
                .collect();
            let array = vote(&edges, center, 250.0, 1.0);
            let peak = peaks(&array, 4, 0.5)[0];
            let line = line_at(&array, peak, center);
            for edge in &edges {
                prop_assert!(line.distance(edge.at).abs() < 1.5, "{line:?} {}", line.distance(edge.at));
            }
            prop_assert_eq!(peaks(&array, 4, 0.5).len(), 1);
        }

        #[test]
        fn lines_meet_where_they_cross(x in -9.0..9.0f64, y in -9.0..9.0f64, a in 0.0..1.0f64, b in 1.5..2.5f64) {
            let p = Vec2::new(x, y);
            let [l, m] = [a, b].map(|a| Line::through(p, p + Vec2::new(a.cos(), a.sin())));
            prop_assert!((l.meets(&m).unwrap() - p).norm() < 1e-9);
            prop_assert!(l.meets(&l).is_none());
        }
    }
}
