//! The flow of the parts under the library's entries, as columns of `Φ`.
//!
//! The unit field of physics.md section 1 says that a rotation by d moves every part by d. In truth the belt under a
//! part near the centre of rotation is slow and moves it less, and a long pulse widens the gap. So a column is what
//! was measured:
//!
//! ```text
//!   φ_j(i) = τ_j(P_i) · gain_i · D(a_ij, S) / D(A_j, S),      A_j = max_i a_ij
//! ```
//!
//! with `a_ij` the plate's speed amplitude under part i, D the measured distance and S the sustain. The nominal
//! distance d_j is therefore that of the part on the fastest belt: no part moves farther than |d_j| (times its gain),
//! a bound on |d_j| bounds every part, and the sustain that belongs to d_j is the one with `D(A_j, S) = |d_j|`.

use super::PartState;
use upm_core::geometry::Vec2;
use upm_library::{DisplacementModel, Entry};

/// Dense columns of `2N` numbers: x, y of each part for one metre of d.
#[derive(Clone, Debug, Default)]
pub(super) struct Columns {
    rows: usize,
    values: Vec<f64>,
}

impl Columns {
    /// No columns yet, of `rows` numbers each; keeps the storage.
    pub fn clear(&mut self, rows: usize) {
        self.rows = rows;
        self.values.clear();
    }

    /// Column `j`.
    pub fn column(&self, j: usize) -> &[f64] {
        &self.values[j * self.rows..][..self.rows]
    }

    /// Number of columns.
    pub fn len(&self) -> usize {
        self.values.len().checked_div(self.rows).unwrap_or(0)
    }

    /// Adds a column.
    pub fn push(&mut self, column: impl Iterator<Item = f64>) {
        self.values.extend(column);
    }

    /// These of the columns, in the order asked for.
    pub fn select(&self, chosen: &[usize]) -> Self {
        let values = chosen.iter().flat_map(|&j| self.column(j)).copied().collect();
        Self { rows: self.rows, values }
    }

    /// `Φᵀ y` for column `j`.
    pub fn dot(&self, j: usize, y: &[f64]) -> f64 {
        dot(self.column(j), y)
    }
}

/// `a · b`.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The displacement model at one sustain: distance over speed alone, for looking up thousands of belts.
#[derive(Clone, Debug)]
pub(super) struct Belt<'a> {
    speed_mps: &'a [f64],
    distance_m: Vec<f64>,
}

impl<'a> Belt<'a> {
    /// The slice at `sustain_s`.
    pub fn at(model: &'a DisplacementModel, sustain_s: f64) -> Self {
        let distance_m = model.speed_mps.iter().map(|&speed| model.distance(speed, sustain_s)).collect();
        Self { speed_mps: &model.speed_mps, distance_m }
    }

    /// [`DisplacementModel::distance`] at this sustain.
    pub fn distance(&self, speed_mps: f64) -> f64 {
        let above = self.speed_mps.partition_point(|&grid| grid <= speed_mps);
        let (low, at_low) = match above.checked_sub(1) {
            Some(below) => (self.speed_mps[below], self.distance_m[below]),
            None => (0.0, 0.0),
        };
        match self.speed_mps.get(above) {
            Some(&high) => at_low + (speed_mps - low) / (high - low) * (self.distance_m[above] - at_low),
            None => at_low,
        }
    }
}

/// The fastest belt under any part, m/s: A_j above.
pub(super) fn reference_speed(entry: &Entry, positions_m: impl Iterator<Item = Vec2>) -> f64 {
    positions_m.map(|p| entry.pump.velocity_at(p).norm_squared()).fold(0.0, f64::max).sqrt()
}

/// Adds the column of `entry` for parts at `positions_m`, with `distance` as the model's distance over speed (m, m/s) at
/// the pulse's sustain; zeros when the entry moves none of them.
pub(super) fn push_column(
    columns: &mut Columns,
    entry: &Entry,
    parts: &[PartState],
    positions_m: impl Iterator<Item = Vec2> + Clone,
    distance: impl Fn(f64) -> f64,
) {
    let nominal_m = distance(reference_speed(entry, positions_m.clone()));
    let per_metre = if nominal_m > 0.0 { 1.0 / nominal_m } else { 0.0 };
    columns.push(parts.iter().zip(positions_m).flat_map(|(part, p)| {
        let velocity = entry.pump.velocity_at(p);
        let speed = velocity.norm();
        let scale = if speed > 0.0 { part.gain * per_metre * distance(speed) / speed } else { 0.0 };
        [velocity.x * scale, velocity.y * scale]
    }));
}
