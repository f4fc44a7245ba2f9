//! The quadratic program behind every plan.
//!
//! ```text
//!   minimise    ½ |u - wanted|² + Σ cost_j |d_j|
//!   over        d (one for each column), u = offset + Φ d (what the parts are predicted to do)
//!   subject to  low_j <= d_j <= high_j,  every half space over u
//! ```
//!
//! `u` is a variable of its own: limits then touch two or four numbers each instead of every column, and the
//! Hessian is diagonal, so that the solver's factorisation costs about `M (2N)²`. A variable that may have both signs
//! carries `|d|` as an epigraph `t >= ±d`. Everything is in millimetres, which puts all numbers near 1.

use super::field::Columns;
use super::limits::HalfSpace;
use upm_core::units::{m_from_mm, mm_from_m};
use upm_qp::{ColumnWriter, Matrix, Program};

/// What one d_j may be and what it costs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Variable {
    /// Price of a metre, in metres of error times metres.
    pub cost_m: f64,
    /// Smallest, m.
    pub low_m: f64,
    /// Largest, m.
    pub high_m: f64,
}

impl Variable {
    fn has_both_signs(&self) -> bool {
        self.low_m < 0.0 && self.high_m > 0.0
    }
}

/// The minimiser.
#[derive(Clone, Debug)]
pub(super) struct Solution {
    /// d_j for each column, m.
    pub distance_m: Vec<f64>,
    /// Predicted steps x, y of each part, m.
    pub moved_m: Vec<f64>,
    /// Multipliers of `u = Φ d`, m: another column is worth having when its product with them exceeds its cost.
    pub prices_m: Vec<f64>,
}

/// Solves the program (an empty `offset_m` is none). `Err` holds the solver's status; `PrimalInfeasible` means that the bounds
/// exclude every solution.
pub(super) fn solve(
    columns: &Columns,
    variables: &[Variable],
    offset_m: &[f64],
    wanted_m: &[f64],
    half_spaces: &[HalfSpace],
) -> Result<Solution, String> {
    let layout = Layout::of(variables, wanted_m.len());
    let (constraints, bounds) = layout.constraints(columns, variables, offset_m, half_spaces);
    let (hessian, gradient) = layout.objective(variables, wanted_m);
    let program = Program { hessian, gradient, constraints, bounds, equalities: layout.steps };
    let minimiser = program.solve()?;
    Ok(layout.solution(&minimiser.x, &minimiser.multipliers))
}

/// Where things are in the solver's vector: all d, then the t of those with both signs, then u.
struct Layout {
    distances: usize,
    epigraphs: usize,
    steps: usize,
}

impl Layout {
    fn of(variables: &[Variable], steps: usize) -> Self {
        let epigraphs = variables.iter().filter(|variable| variable.has_both_signs()).count();
        Self { distances: variables.len(), epigraphs, steps }
    }

    fn len(&self) -> usize {
        self.distances + self.epigraphs + self.steps
    }

    /// Diagonal Hessian over u and the linear part.
    fn objective(&self, variables: &[Variable], wanted_m: &[f64]) -> (Matrix, Vec<f64>) {
        let n = self.len();
        let mut hessian = ColumnWriter::default();
        for column in 0..n {
            if column >= n - self.steps {
                hessian.put(column, 1.0);
            }
            hessian.end_column();
        }
        let signed = |v: &Variable| if v.has_both_signs() { 0.0 } else { mm_from_m(v.cost_m) * sign(v) };
        let epigraphs = variables.iter().filter(|v| v.has_both_signs()).map(|v| mm_from_m(v.cost_m));
        let wanted = wanted_m.iter().map(|&w| -mm_from_m(w));
        (hessian.finish(n), variables.iter().map(signed).chain(epigraphs).chain(wanted).collect())
    }

    /// `A x + s = b`: first `Φ d - u = -offset`, then three rows a two-signed variable or two a one-signed one, then limits.
    fn constraints(
        &self,
        columns: &Columns,
        variables: &[Variable],
        offset_m: &[f64],
        half_spaces: &[HalfSpace],
    ) -> (Matrix, Vec<f64>) {
        let mut matrix = ColumnWriter::default();
        let mut bounds: Vec<f64> = offset_m.iter().map(|&m| -mm_from_m(m)).collect();
        bounds.resize(self.steps, 0.0);
        let mut epigraph_rows = Vec::with_capacity(self.epigraphs);
        for (j, variable) in variables.iter().enumerate() {
            let row = bounds.len();
            columns.column(j).iter().enumerate().for_each(|(k, &flow)| matrix.put(k, flow));
            matrix.put(row, 1.0);
            matrix.put(row + 1, -1.0);
            matrix.end_column();
            if variable.has_both_signs() {
                epigraph_rows.push(row);
                bounds.extend([0.0, 0.0, mm_from_m(variable.high_m.min(-variable.low_m))]);
            } else {
                bounds.extend([mm_from_m(variable.high_m), -mm_from_m(variable.low_m)]);
            }
        }
        for row in epigraph_rows {
            [(row, -1.0), (row + 1, -1.0), (row + 2, 1.0)].into_iter().for_each(|(row, value)| matrix.put(row, value));
            matrix.end_column();
        }
        let first_limit = bounds.len();
        bounds.extend(half_spaces.iter().map(|half_space| mm_from_m(half_space.room_m)));
        for step in 0..self.steps {
            matrix.put(step, -1.0);
            for (row, half_space) in half_spaces.iter().enumerate() {
                let coefficient = half_space.coefficient(step);
                if coefficient != 0.0 {
                    matrix.put(first_limit + row, coefficient);
                }
            }
            matrix.end_column();
        }
        (matrix.finish(bounds.len()), bounds)
    }

    fn solution(&self, x_mm: &[f64], z_mm: &[f64]) -> Solution {
        let metres = |range: &[f64]| range.iter().map(|&mm| m_from_mm(mm)).collect();
        Solution {
            distance_m: metres(&x_mm[..self.distances]),
            moved_m: metres(&x_mm[self.distances + self.epigraphs..]),
            prices_m: metres(&z_mm[..self.steps]),
        }
    }
}

fn sign(variable: &Variable) -> f64 {
    if variable.high_m > 0.0 { 1.0 } else { -1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::{params, penny};
    use crate::limits::half_spaces;
    use proptest::prelude::*;
    use upm_core::geometry::Vec2;

    fn columns(rows: usize, values: &[f64]) -> Columns {
        let mut columns = Columns::default();
        columns.clear(rows);
        columns.push(values.iter().copied());
        columns
    }

    /// Proximal gradient on the same program without half spaces: the price and the bounds part by coordinates.
    fn ista(columns: &Columns, variables: &[Variable], wanted: &[f64]) -> Vec<f64> {
        let mut d: Vec<f64> = variables.iter().map(|v| 0.0f64.clamp(v.low_m, v.high_m)).collect();
        let rate = 1.0 / (0..columns.len()).map(|j| columns.dot(j, columns.column(j))).sum::<f64>();
        for _ in 0..60_000 {
            let mut error = wanted.iter().map(|w| -w).collect::<Vec<f64>>();
            for (j, d) in d.iter().enumerate() {
                error.iter_mut().zip(columns.column(j)).for_each(|(e, flow)| *e += d * flow);
            }
            for (j, (d, v)) in d.iter_mut().zip(variables).enumerate() {
                let moved = *d - rate * columns.dot(j, &error);
                *d = (moved.signum() * (moved.abs() - rate * v.cost_m).max(0.0)).clamp(v.low_m, v.high_m);
            }
        }
        d
    }

    fn value(columns: &Columns, variables: &[Variable], wanted: &[f64], d: &[f64]) -> f64 {
        let mut error = wanted.to_vec();
        for (j, d) in d.iter().enumerate() {
            error.iter_mut().zip(columns.column(j)).for_each(|(e, flow)| *e -= d * flow);
        }
        let price: f64 = d.iter().zip(variables).map(|(d, v)| v.cost_m * d.abs()).sum();
        0.5 * error.iter().map(|e| e * e).sum::<f64>() + price
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        #[test]
        fn agrees_with_a_plain_proximal_gradient(
            flows in proptest::collection::vec(-1.0..1.0f64, 4 * 7),
            wanted in proptest::collection::vec(-6e-3..6e-3f64, 4),
            one_signed in proptest::collection::vec(any::<bool>(), 7),
        ) {
            let columns = columns(4, &flows);
            let variable = |&one: &bool| Variable { cost_m: 2e-4, low_m: if one { 3e-4 } else { -4e-3 }, high_m: 4e-3 };
            let variables: Vec<Variable> = one_signed.iter().map(variable).collect();
            let fast = solve(&columns, &variables, &[], &wanted, &[]).unwrap();
            let slow = ista(&columns, &variables, &wanted);
            let (fast_value, slow_value) =
                (value(&columns, &variables, &wanted, &fast.distance_m), value(&columns, &variables, &wanted, &slow));
            prop_assert!((fast_value - slow_value).abs() < 1e-4 * (slow_value + 1e-6), "{fast_value} {slow_value}");
            for (d, v) in fast.distance_m.iter().zip(&variables) {
                prop_assert!((v.low_m - 1e-7..=v.high_m + 1e-7).contains(d));
            }
            for j in (0..7).filter(|&j| fast.distance_m[j].abs() < 1e-7 && !one_signed[j]) {
                prop_assert!(columns.dot(j, &fast.prices_m).abs() < 2e-4 * 1.01, "unused columns are too dear");
            }
        }
    }

    #[test]
    fn half_spaces_hold_and_offsets_count() {
        // a part 4 mm from its limit at the edge that wants 10 mm towards it and 5 mm along it
        let bound = params().half_side_m - params().edge_margin_m - 0.009525;
        let parts = [penny(Vec2::new(bound - 0.004, 0.0), Vec2::new(0.01, 0.005))];
        let limits = half_spaces(&parts, &params(), 0.02, 0.0);
        let axes = columns(2, &[1.0, 0.0, 0.0, 1.0]);
        let free = [Variable { cost_m: 0.0, low_m: -0.02, high_m: 0.02 }; 2];
        let blocked = solve(&axes, &free, &[], &[0.01, 0.005], &limits).unwrap();
        assert!((blocked.moved_m[0] - 0.004).abs() < 1e-6 && (blocked.moved_m[1] - 0.005).abs() < 1e-6);
        let begun = solve(&axes, &free, &[0.001, 0.002], &[0.01, 0.005], &limits).unwrap();
        assert!((begun.distance_m[0] - 0.003).abs() < 1e-6 && (begun.distance_m[1] - 0.003).abs() < 1e-6);
    }

    #[test]
    fn what_cannot_be_is_said() {
        let limits = half_spaces(&[penny(Vec2::new(0.1, 0.0), Vec2::zeros())], &params(), 0.02, 0.0);
        let must = [Variable { cost_m: 0.0, low_m: 0.001, high_m: 0.002 }];
        assert!(solve(&columns(2, &[1.0, 0.0]), &must, &[], &[0.0, 0.0], &limits).unwrap_err().contains("Infeasible"));
    }
}
