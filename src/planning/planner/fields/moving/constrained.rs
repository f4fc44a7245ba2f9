//! The last change of a segment's motion: a quadratic program with the gaps between parts, and to the edge, as rows.
//!
//! ```text
//!   minimise    |J δ + r|² + price · Σ s          J, r: slopes and residuals of the parts' drifts
//!   over        δ = Q z, s >= 0                   Q: a basis of the gradients of drifts and gaps
//!   subject to  g_i δ + s_i >= missing_i          for each gap that may bind
//!               |z| <= reach
//! ```
//!
//! The unconstrained step lies in the span of the gradients, and so does the constrained one: it leaves out most of the
//! coefficients. Rows are generated: the program is solved, its answer is played in the model, and the gaps closed by
//! that are added.

use nalgebra::{DMatrix, DVector};

use super::search::{Guard, SegmentProblem, Shot};
use crate::planner::fields::optimizer::NARROWER;
use crate::qp::{ColumnWriter, Cone, Program};

/// Speed that a gap has to spare below which it has a row from the start, m/s.
const NEAR_MPS: f64 = 0.02;
/// Programs solved at most.
const PROGRAMS: usize = 3;
/// Price of a metre per second that a gap lacks, and weight of its square in the merit, relative to the residuals'
/// squares: more than any part gains by it.
const PRICE: f64 = 20.0;
const MERIT: f64 = 400.0;
/// Least curvature of the objective, relative to its mean.
const CURVATURE: f64 = 1e-6;
/// Longest change, relative to the motion.
const REACH: f64 = 0.1;

impl SegmentProblem<'_> {
    /// `shot`, changed once more such that no part comes too near to others or to the edge, where that is possible.
    pub fn constrained(&self, shot: Shot) -> Shot {
        let slopes = self.task_slopes(&shot);
        let of_gaps = self.gap_slopes(&shot);
        let mut rows = self.guards(&shot.rollout, NEAR_MPS);
        let length: f64 = self.priced(&shot.motion.coefficients).iter().map(|c| c * c).sum();
        let mut better: Option<Shot> = None;
        let mut reach = REACH * length.sqrt();
        for _ in 0..PROGRAMS {
            let gap_columns = self.guard_columns(&of_gaps, &rows);
            let Some(change) = step(&slopes, &gap_columns, &shot.residual, &rows, reach) else { break };
            let changed = self.changed(&shot.motion.coefficients, &change);
            let next = self.shot(&changed, 1.0);
            let broken: Vec<Guard> =
                next.guards.iter().filter(|guard| !rows.iter().any(|row| row.is_of(guard))).copied().collect();
            let is_better = merit(&next) < merit(better.as_ref().unwrap_or(&shot));
            let other = if is_better { better.replace(next) } else { Some(next) };
            other.into_iter().for_each(|other| self.pool.keep(other.rollout));
            if broken.is_empty() && is_better {
                break;
            }
            if !is_better {
                reach *= NARROWER;
            }
            // as they are before the change
            let all = self.guards(&shot.rollout, f64::INFINITY);
            rows.extend(all.into_iter().filter(|gap| broken.iter().any(|guard| guard.is_of(gap))));
        }
        let Some(better) = better else { return shot };
        self.pool.keep(shot.rollout);
        better
    }
}

fn merit(shot: &Shot) -> f64 {
    shot.residual.norm_squared() + MERIT * shot.guards.iter().map(|guard| guard.missing * guard.missing).sum::<f64>()
}

/// The change in the span of the gradients; `None` where the solver finds none.
fn step(
    slopes: &DMatrix<f64>,
    of_gaps: &DMatrix<f64>,
    residual: &DVector<f64>,
    rows: &[Guard],
    reach: f64,
) -> Option<DVector<f64>> {
    let (tasks, gaps) = (slopes.ncols(), of_gaps.ncols());
    let mut gradients = DMatrix::zeros(slopes.nrows(), tasks + gaps);
    gradients.columns_mut(0, tasks).copy_from(slopes);
    gradients.columns_mut(tasks, gaps).copy_from(of_gaps);
    let basis = gradients.qr().q();
    let r = basis.ncols();
    let (by_task, by_gap) = (slopes.tr_mul(&basis), of_gaps.tr_mul(&basis));
    let normal = by_task.tr_mul(&by_task);
    let curvature = CURVATURE * normal.trace() / r as f64;
    let gradient = by_task.tr_mul(residual);
    let (mut hessian, mut constraints) = (ColumnWriter::default(), ColumnWriter::default());
    // rows: gaps, slacks, then the trust region
    for column in 0..r {
        (0..=column).for_each(|row| {
            hessian.put(row, normal[(row, column)] + if row == column { curvature } else { 0.0 });
        });
        hessian.end_column();
        (0..gaps).for_each(|gap| constraints.put(gap, -by_gap[(gap, column)]));
        constraints.put(2 * gaps + 1 + column, -1.0);
        constraints.end_column();
    }
    for slack in 0..gaps {
        hessian.end_column();
        constraints.put(slack, -1.0);
        constraints.put(gaps + slack, -1.0);
        constraints.end_column();
    }
    let mut bounds: Vec<f64> = rows.iter().map(|row| -row.missing).collect();
    bounds.extend(std::iter::repeat_n(0.0, gaps));
    bounds.push(reach);
    bounds.extend(std::iter::repeat_n(0.0, r));
    let program = Program {
        hessian: hessian.finish(r + gaps),
        gradient: gradient.iter().copied().chain(std::iter::repeat_n(PRICE, gaps)).collect(),
        constraints: constraints.finish(bounds.len()),
        bounds,
        cones: vec![Cone::NonnegativeConeT(2 * gaps), Cone::SecondOrderConeT(r + 1)],
    };
    let found = program.solve().ok()?;
    Some(basis * DVector::from_column_slice(&found.x[..r]))
}
