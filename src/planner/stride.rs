//! The far way: one long pulse at a time, each the one that brings the parts nearest to home for its plate time.
//!
//! Far from the goal a complete sequence is not worth its many short pulses: whatever it leaves undone is planned anew
//! after the next look. What counts as near is not the plain distance. Some joint steps cost little (all parts along one
//! rotation), some much (neighbours in opposite directions), so the ways still to go are measured by
//!
//! ```text
//!   V² = eᵀ W e,   W = (Σ_j φ̂_j φ̂_jᵀ / m + ρ)^-p,   m the mean eigenvalue of the sum over all entries j
//! ```
//!
//! with the flows φ̂_j of unit length. With p = 0 this is the distance, with p = 1 every joint step counts by the squared
//! effort of least squares; between them lies what an L1 sequence costs.

use nalgebra::{DMatrix, DVector};

use super::Planner;
use super::field::Columns;
use super::sequence::Sequence;
use super::task::Task;
use super::{Limit, Rotation};

/// Power p and floor ρ of the metric: those with the least plate time to within 12 mm over random starts and targets.
const POWER: f64 = 0.7;
const FLOOR: f64 = 0.003;

/// Entries looked at closely, those of the best linear forecast, and sustains tried for each, evenly up to the longest.
const CLOSELY: usize = 30;
const SUSTAINS: usize = 10;

/// What is left of the ways, as a length.
struct Metric(DMatrix<f64>);

impl Metric {
    /// Of the flows in `columns`; zero columns count for nothing. `None` without any flow.
    fn of(columns: &Columns) -> Option<Self> {
        let rows = columns.column(0).len();
        let mut sum = DMatrix::<f64>::zeros(rows, rows);
        for j in 0..columns.len() {
            let column = DVector::from_column_slice(columns.column(j));
            let length_sq = column.norm_squared();
            if length_sq > 0.0 {
                sum.ger(1.0 / length_sq, &column, &column, 1.0);
            }
        }
        let mean = sum.trace() / rows as f64;
        if mean <= 0.0 {
            return None;
        }
        let eigen = (sum / mean).symmetric_eigen();
        let weights = eigen.eigenvalues.map(|value| (value.max(0.0) + FLOOR).powf(-POWER));
        Some(Self(&eigen.eigenvectors * DMatrix::from_diagonal(&weights) * eigen.eigenvectors.transpose()))
    }

    fn length(&self, ways: &DVector<f64>) -> f64 {
        ways.dot(&(&self.0 * ways)).max(0.0).sqrt()
    }
}

/// A pulse and how far it gets.
pub(super) struct Stride {
    /// The pulse alone.
    pub sequence: Sequence,
    /// Part of all ways that it makes in a second of plate time, 1/s.
    pub share_per_s: f64,
}

impl Planner {
    /// The pulse that shortens the ways most for its time, by the exact forecast, within the limits. `columns` hold the
    /// flows of all entries. `Err` has the limit that stopped a good one, if a limit it was.
    pub(super) fn stride(&self, task: &Task<'_>) -> Result<Stride, Option<Limit>> {
        if self.columns.len() == 0 {
            return Err(None);
        }
        let metric = Metric::of(&self.columns).ok_or(None)?;
        let ways = DVector::from_column_slice(&task.wanted_m);
        let before = metric.length(&ways);
        let (mut best, mut stopped_by): (Option<Stride>, _) = (None, None);
        for (entry, along) in self.promising(&metric, &ways) {
            for pulse in self.tries(entry, along, task) {
                let after = self.flow(task).after(&pulse, &task.positions_m);
                let left = &ways - DVector::from_vec(task.steps_to(&after));
                let share_per_s = (1.0 - metric.length(&left) / before) / self.plate_time_s(&pulse);
                let is_better = share_per_s > best.as_ref().map_or(0.0, |best| best.share_per_s);
                if !is_better || left.norm_squared() > ways.norm_squared() {
                    continue;
                }
                match task.clearances.broken_by(&task.positions_m, &after) {
                    Some(limit) => stopped_by = stopped_by.or(Some(limit)),
                    None => {
                        let sequence = Sequence { pulses: vec![pulse], predicted_m: vec![after] };
                        best = Some(Stride { sequence, share_per_s });
                    }
                }
            }
        }
        best.ok_or(stopped_by)
    }

    /// Entries that to first order shorten the ways most, the best first, and with what sign.
    fn promising(&self, metric: &Metric, ways: &DVector<f64>) -> Vec<(usize, f64)> {
        let weighted = &metric.0 * ways;
        let forecast = |j: usize| {
            let column = DVector::from_column_slice(self.columns.column(j));
            let (along, square) = (column.dot(&weighted), column.dot(&(&metric.0 * &column)));
            (if square > 0.0 { along * along / square } else { 0.0 }, j, along)
        };
        let mut found: Vec<(f64, usize, f64)> = (0..self.columns.len()).map(forecast).filter(|f| f.0 > 0.0).collect();
        found.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        found.into_iter().take(CLOSELY).map(|(_, entry, along)| (entry, along)).collect()
    }

    /// Time that a pulse alone takes, from one look to the end of the next, s.
    fn plate_time_s(&self, pulse: &Rotation) -> f64 {
        let rest_s = self.library.rest_after(pulse.sustain_s);
        pulse.sustain_s + 2.0 * self.library.attack_s + rest_s + self.params.look_s
    }

    /// Pulses of `entry` in the direction of `along`, from the shortest that was measured to the longest allowed.
    fn tries<'a>(&'a self, entry: usize, along: f64, task: &'a Task<'_>) -> impl Iterator<Item = Rotation> + 'a {
        let model = &self.library.displacement;
        let speed = self.reference_speed_mps(entry, &task.positions_m);
        let longest_s = model.sustain_s.last().copied().unwrap_or(0.0);
        (0..SUSTAINS).filter_map(move |k| {
            let sustain_s = longest_s * k as f64 / (SUSTAINS - 1) as f64;
            let distance_m = model.distance(speed, sustain_s);
            let useful = (self.params.min_distance_m..=self.params.max_distance_m).contains(&distance_m);
            useful.then(|| Rotation { entry, distance_m: distance_m.copysign(along), sustain_s })
        })
    }
}
