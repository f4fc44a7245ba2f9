//! Hough array over angle and distance (Duda and Hart, 1972), each edge voting only near its own gradient's direction.
//! Equation sheet, section 7; UPM paper, section 3.4 and Fig. 10, which take the four highest peaks.

use std::f64::consts::TAU;

use upm_core::geometry::Vec2;

/// Columns: one degree each.
const ANGLES: usize = 360;
/// Columns on either side of its own direction in which an edge votes.
const SPREAD: i32 = 2;
/// Weight of one vote: an integer, so that withdrawing a vote leaves exactly nothing.
const VOTE_WEIGHT: f32 = 16.0;

/// An edge in ideal coordinates, where the table's sides are straight.
#[derive(Clone, Copy, Debug)]
pub(super) struct IdealEdge {
    /// Position, px.
    pub(super) at: Vec2,
    /// Unit vector from light to dark.
    pub(super) outward: Vec2,
}

/// The line `normal · p = offset` in ideal coordinates, px.
#[derive(Clone, Copy, Debug)]
pub(super) struct HoughLine {
    pub(super) normal: Vec2,
    pub(super) offset: f64,
}

impl HoughLine {
    /// The line through two points, its normal a quarter turn from `a → b` towards negative angles.
    pub(super) fn through(a: Vec2, b: Vec2) -> Self {
        let along = (b - a).normalize();
        let normal = Vec2::new(along.y, -along.x);
        Self { normal, offset: normal.dot(&a) }
    }

    /// Signed distance of `p` from the line, px.
    pub(super) fn distance(&self, p: Vec2) -> f64 {
        self.normal.dot(&p) - self.offset
    }

    /// Coordinate of `p` along the line, px.
    pub(super) fn along(&self, p: Vec2) -> f64 {
        self.normal.x * p.y - self.normal.y * p.x
    }

    /// Intersection of two lines.
    pub(super) fn meets(&self, other: &Self) -> Option<Vec2> {
        let (n, m) = (self.normal, other.normal);
        let det = n.x * m.y - n.y * m.x;
        let p = Vec2::new(self.offset * m.y - other.offset * n.y, other.offset * n.x - self.offset * m.x) / det;
        (det.abs() > 1e-6 && p.x.is_finite() && p.y.is_finite()).then_some(p)
    }
}

/// The votes of edges, less those of the lines already found. Withdrawing a found line's votes separates lines close to
/// each other without a neighbourhood size to choose.
pub(super) struct HoughAccumulator {
    distances: usize,
    px_per_row: f64,
    center: Vec2,
    left: Vec<i16>,
    /// Highest vote left in each row.
    tops: Vec<i16>,
    /// Unit vector of each column, in rows a pixel.
    directions: Vec<[f32; 2]>,
}

impl HoughAccumulator {
    /// Votes of all edges about `center`. An edge votes for lines whose normal points from light to dark, outwards for
    /// a bright plate; lines at negative distance are entered turned by half a turn.
    pub(super) fn new(edges: &[IdealEdge], center: Vec2, farthest_px: f64, px_per_row: f64) -> Self {
        let distances = (farthest_px / px_per_row).ceil() as usize + 2;
        let step = |column| direction(column as f64) / px_per_row;
        let directions = (0..ANGLES).map(step).map(|step| [step.x as f32, step.y as f32]).collect();
        let (left, tops) = (vec![0; ANGLES * distances], Vec::new());
        let mut ballot = Self { distances, px_per_row, center, left, tops, directions };
        edges.iter().for_each(|edge| ballot.cast(edge, 1, |_| {}));
        ballot.tops = ballot.left.chunks_exact(ANGLES).map(highest).collect();
        ballot
    }

    /// The highest peak left, column and row, and its votes.
    pub(super) fn highest(&self) -> Option<((usize, usize), f32)> {
        let top = highest(&self.tops);
        let row = self.tops.iter().position(|&value| value == top).filter(|_| top > 0)?;
        let column = self.left[row * ANGLES..][..ANGLES].iter().position(|&value| value == top)?;
        Some(((column, row), f32::from(top) / VOTE_WEIGHT))
    }

    /// Withdraws the votes of a line's edges, and any votes remaining at its peak.
    pub(super) fn remove_votes<'a>(&mut self, peak: (usize, usize), edges: impl Iterator<Item = &'a IdealEdge>) {
        let mut touched = vec![false; self.distances];
        for edge in edges {
            self.cast(edge, -1, |row| touched[row] = true);
        }
        let rows = self.left.chunks_exact_mut(ANGLES).zip(&mut touched);
        for (row, touched) in rows.skip(peak.1.saturating_sub(1)).take(if peak.1 == 0 { 2 } else { 3 }) {
            (0..3).for_each(|column| row[(peak.0 + ANGLES - 1 + column) % ANGLES] = 0);
            *touched = true;
        }
        for (row, _) in touched.iter().enumerate().filter(|(_, touched)| **touched) {
            self.tops[row] = highest(&self.left[row * ANGLES..][..ANGLES]);
        }
    }

    fn cast(&mut self, edge: &IdealEdge, sign: i16, mut touch: impl FnMut(usize)) {
        let p = edge.at - self.center;
        let (x, y) = (p.x as f32, p.y as f32);
        let mut column = (column_of(edge.outward) - SPREAD).rem_euclid(ANGLES as i32) as usize;
        for _ in 0..=2 * SPREAD {
            let distance = x * self.directions[column][0] + y * self.directions[column][1];
            let turned = match (distance >= 0.0, column < ANGLES / 2) {
                (true, _) => column,
                (false, true) => column + ANGLES / 2,
                (false, false) => column - ANGLES / 2,
            };
            let row = distance.abs();
            let first = row as usize;
            let share = ((row - first as f32) * VOTE_WEIGHT) as i16;
            if first + 1 < self.distances {
                let [near, far] = [first, first + 1].map(|row| row * ANGLES + turned);
                self.left[near] = self.left[near].saturating_add(sign * (VOTE_WEIGHT as i16 - share));
                self.left[far] = self.left[far].saturating_add(sign * share);
                touch(first);
                touch(first + 1);
            }
            column = if column + 1 == ANGLES { 0 } else { column + 1 };
        }
    }

    /// The line of a peak, to a fraction of a cell by the centroid of the votes left around it.
    pub(super) fn line_at(&self, peak: (usize, usize)) -> HoughLine {
        let (mut sum, mut column, mut row) = (0.0, 0.0, 0.0);
        for r in peak.1.saturating_sub(1)..(peak.1 + 2).min(self.distances) {
            for dc in 0..3 {
                let vote = f64::from(self.left[r * ANGLES + (peak.0 + ANGLES - 1 + dc) % ANGLES]).max(0.0);
                sum += vote;
                column += vote * (dc as f64 - 1.0);
                row += vote * (r as f64 - peak.1 as f64);
            }
        }
        let (column, row) = if sum > 0.0 { (column / sum, row / sum) } else { (0.0, 0.0) };
        let normal = direction(peak.0 as f64 + column);
        HoughLine { normal, offset: (peak.1 as f64 + row) * self.px_per_row + normal.dot(&self.center) }
    }
}

/// The column nearest a direction. Arctangent by Abramowitz and Stegun 4.4.49, within 1e-5: accurate enough, and
/// several times faster than one accurate to the last bit.
fn column_of(outward: Vec2) -> i32 {
    let (x, y) = (outward.x as f32, outward.y as f32);
    let (near, far) = (x.abs().min(y.abs()), x.abs().max(y.abs()));
    let t = near / far;
    let t2 = t * t;
    let polynomial = 0.999_866 + t2 * (-0.330_299_5 + t2 * (0.180_141 + t2 * (-0.085_133 + t2 * 0.020_835_1)));
    let octant = t * polynomial * (ANGLES as f32 / std::f32::consts::TAU);
    let quarter = if y.abs() > x.abs() { ANGLES as f32 / 4.0 - octant } else { octant };
    let half = if x < 0.0 { ANGLES as f32 / 2.0 - quarter } else { quarter };
    ((if y < 0.0 { ANGLES as f32 - half } else { half }) + 0.5) as i32
}

fn direction(column: f64) -> Vec2 {
    let (sin, cos) = libm::sincos(column / ANGLES as f64 * TAU);
    Vec2::new(cos, sin)
}

fn highest(values: &[i16]) -> i16 {
    values.iter().fold(0, |best, &value| best.max(value))
}
