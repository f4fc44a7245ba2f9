//! Relaxed program: real-valued counts of the pulses that make the steps in the least plate time.
//!
//! ```text
//!   minimise    c · n            c_j: plate time of pulse j
//!   subject to  n >= 0,   |e - Φ n| <= leave       Φ_j: its exact displacement of all parts
//! ```
//!
//! Equation sheet, section 1.7 (ours; Φ as in Eqs. 1 and 2 of the UPM paper).
//!
//! The steps may be missed by `leave`, because the hardest part of them would cost most of the time. A larger residual
//! is allowed only where the columns cannot avoid it, at a price above all others. Solved by column generation: first
//! over the columns that pay at the last prices, then adding those that pay at the new ones.

use std::collections::BTreeSet;

use super::displacement_matrix::DisplacementMatrix;
use crate::qp::{ColumnWriter, Cone, Minimiser, Program};

/// Columns of the first program and of each addition, per coordinate.
const FIRST: usize = 6;
const MORE: usize = 5;
/// Columns per coordinate and direction while there are no prices.
const SPANNING: usize = 3;
/// Largest number of programs before the prices are accepted.
const ROUNDS: usize = 8;
/// A column is added when its value exceeds its time by this factor, and dropped below the second one.
const PAYS: f64 = 1.02;
const WORTH_KEEPING: f64 = 0.5;
/// Price of a residual beyond `leave`, s/mm.
const BEYOND_S_PER_MM: f64 = 30.0;

/// Solution: counts of pulses, and the price of a millimetre of each step.
#[derive(Clone, Debug, Default)]
pub(super) struct LeastTime {
    /// n, for each column.
    pub counts: Vec<f64>,
    /// s/mm, for x and y of each part.
    pub prices: Vec<f64>,
}

impl LeastTime {
    /// Solves the program over all of `columns`, starting from the prices `last`. `None` where the solver fails.
    pub fn solve(columns: &DisplacementMatrix, steps_mm: &[f64], leave_mm: f64, last: &[f64]) -> Option<Self> {
        let rows = steps_mm.len();
        let mut chosen: BTreeSet<usize> = if last.len() == rows {
            best_paying(columns, last, FIRST * rows, 0.0).into_iter().collect()
        } else {
            spanning(columns, steps_mm)
        };
        for _ in 1..ROUNDS {
            let found = Self::over(columns, &chosen, steps_mm, leave_mm)?;
            let new = best_paying(columns, &found.prices, MORE * rows, PAYS);
            chosen.retain(|&j| columns.pay(j, &found.prices) > WORTH_KEEPING);
            let kept = chosen.len();
            chosen.extend(new);
            if chosen.len() == kept {
                return Some(found);
            }
        }
        Self::over(columns, &chosen, steps_mm, leave_mm)
    }

    /// Solves the program over a subset of `columns`; the other counts are 0.
    pub fn over<'a>(
        columns: &DisplacementMatrix,
        chosen: impl IntoIterator<Item = &'a usize>,
        steps_mm: &[f64],
        leave_mm: f64,
    ) -> Option<Self> {
        let chosen: Vec<usize> = chosen.into_iter().copied().collect();
        let (count, rows) = (chosen.len(), steps_mm.len());
        let mut constraints = ColumnWriter::default();
        for (at, &j) in chosen.iter().enumerate() {
            constraints.put(at, -1.0);
            for (row, &value) in columns.column(j).iter().enumerate() {
                constraints.put(count + 2 + row, value);
            }
            constraints.end_column();
        }
        // the last variable is the residual beyond `leave`
        constraints.put(count, -1.0);
        constraints.put(count + 1, -1.0);
        constraints.end_column();
        let mut bounds = vec![0.0; count + 2 + rows];
        bounds[count + 1] = leave_mm;
        bounds[count + 2..].copy_from_slice(steps_mm);
        let mut hessian = ColumnWriter::default();
        (0..=count).for_each(|_| hessian.end_column());
        let program = Program {
            hessian: hessian.finish(count + 1),
            gradient: chosen.iter().map(|&j| columns.duration_s[j]).chain([BEYOND_S_PER_MM]).collect(),
            constraints: constraints.finish(bounds.len()),
            bounds,
            cones: vec![Cone::NonnegativeConeT(count + 1), Cone::SecondOrderConeT(1 + rows)],
        };
        let Minimiser { x, multipliers } = program.solve().ok()?;
        let mut counts = vec![0.0; columns.len()];
        chosen.iter().zip(&x).for_each(|(&j, &n)| counts[j] = n.max(0.0));
        let prices = multipliers[count + 2..].iter().map(|y| -y).collect();
        Some(Self { counts, prices })
    }
}

/// Up to `most` columns that pay more than `least` at `prices`, best first.
pub(super) fn best_paying(columns: &DisplacementMatrix, prices: &[f64], most: usize, least: f64) -> Vec<usize> {
    let mut paying: Vec<(f64, usize)> =
        (0..columns.len()).map(|j| (columns.pay(j, prices), j)).filter(|&(pay, _)| pay > least).collect();
    paying.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    paying.truncate(most);
    paying.into_iter().map(|(_, j)| j).collect()
}

/// Columns along the steps, and for each coordinate and sign a few that move the other coordinates little.
fn spanning(columns: &DisplacementMatrix, steps_mm: &[f64]) -> BTreeSet<usize> {
    let rows = steps_mm.len();
    let mut chosen: BTreeSet<usize> = best_paying(columns, steps_mm, FIRST * rows, 0.0).into_iter().collect();
    let lengths: Vec<f64> =
        (0..columns.len()).map(|j| columns.column(j).iter().map(|v| v * v).sum::<f64>().sqrt().max(1e-9)).collect();
    for row in 0..rows {
        for sign in [1.0, -1.0] {
            let worth = |j: usize| {
                let along = (sign * columns.column(j)[row]).max(0.0);
                along * along / (lengths[j] * columns.duration_s[j])
            };
            let mut by_worth: Vec<(f64, usize)> = (0..columns.len()).map(|j| (worth(j), j)).collect();
            let most = SPANNING.min(by_worth.len());
            if most > 0 {
                by_worth.select_nth_unstable_by(most - 1, |a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            }
            chosen.extend(by_worth.iter().take(most).map(|&(_, j)| j));
        }
    }
    chosen
}
