//! Convex quadratic programs, and the only place that names clarabel.
//!
//! ```text
//!   minimise    ½ xᵀ P x + qᵀ x
//!   over        x, n numbers
//!   subject to  A x + s = b,   s_i = 0 for the first `equalities` rows,  s_i >= 0 for the others
//! ```
//!
//! The solver is compiled here once, not in the crates that state programs. Equal programs give equal answers to the last
//! bit: one thread, the built-in LDL factorisation, no time limit, no presolve.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverError, SolverStatus, ZeroConeT,
};

/// A sparse matrix, compressed by columns.
pub struct Matrix(CscMatrix<f64>);

/// Writes a sparse matrix column by column, the rows of each in rising order.
#[derive(Default)]
pub struct ColumnWriter {
    ends: Vec<usize>,
    rows: Vec<usize>,
    values: Vec<f64>,
}

impl ColumnWriter {
    /// Appends a value to the present column.
    pub fn put(&mut self, row: usize, value: f64) {
        self.rows.push(row);
        self.values.push(value);
    }

    /// Ends the present column, which may be empty.
    pub fn end_column(&mut self) {
        self.ends.push(self.rows.len());
    }

    /// The matrix with this number of rows and as many columns as were ended.
    pub fn finish(self, rows: usize) -> Matrix {
        let columns = self.ends.len();
        let starts = std::iter::once(0).chain(self.ends).collect();
        Matrix(CscMatrix::new(rows, columns, starts, self.rows, self.values))
    }
}

/// The numbers of one program.
pub struct Program {
    /// P, n × n, upper triangle.
    pub hessian: Matrix,
    /// q, n numbers.
    pub gradient: Vec<f64>,
    /// A, m × n.
    pub constraints: Matrix,
    /// b, m numbers.
    pub bounds: Vec<f64>,
    /// How many of the m rows are equalities; they come first.
    pub equalities: usize,
}

/// A minimiser and its multipliers.
pub struct Minimiser {
    /// x, n numbers.
    pub x: Vec<f64>,
    /// Multipliers of the m rows.
    pub multipliers: Vec<f64>,
}

impl Program {
    /// Solves the program. `Err` holds clarabel's status; `PrimalInfeasible` means that the constraints exclude every x.
    pub fn solve(&self) -> Result<Minimiser, String> {
        let Self { hessian, gradient, constraints, bounds, equalities } = self;
        let cones = [ZeroConeT(*equalities), NonnegativeConeT(bounds.len().saturating_sub(*equalities))];
        let mut solver = DefaultSolver::new(&hessian.0, gradient, &constraints.0, bounds, &cones, settings())
            .map_err(|error: SolverError| error.to_string())?;
        solver.solve();
        match solver.solution.status {
            SolverStatus::Solved | SolverStatus::AlmostSolved => {
                Ok(Minimiser { x: solver.solution.x, multipliers: solver.solution.z })
            }
            status => Err(format!("{status:?}")),
        }
    }
}

fn settings() -> DefaultSettings<f64> {
    DefaultSettings {
        verbose: false,
        max_iter: 60,
        max_threads: 1,
        direct_solve_method: "qdldl".into(),
        presolve_enable: false,
        equilibrate_enable: false,
        tol_feas: 1e-6,
        tol_gap_abs: 1e-6,
        tol_gap_rel: 1e-6,
        iterative_refinement_max_iter: 1,
        ..DefaultSettings::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn diagonal(values: &[f64]) -> Matrix {
        let mut writer = ColumnWriter::default();
        for (row, &value) in values.iter().enumerate() {
            writer.put(row, value);
            writer.end_column();
        }
        writer.finish(values.len())
    }

    /// The nearest point of the line x + y = 1 with x <= 0.2 to the origin, by hand: (0.2, 0.8), multipliers -0.8 and 0.6.
    #[test]
    fn a_small_program_has_the_minimiser_found_by_hand() {
        let mut constraints = ColumnWriter::default();
        constraints.put(0, 1.0);
        constraints.put(1, 1.0);
        constraints.end_column();
        constraints.put(0, 1.0);
        constraints.end_column();
        let program = Program {
            hessian: diagonal(&[1.0, 1.0]),
            gradient: vec![0.0, 0.0],
            constraints: constraints.finish(2),
            bounds: vec![1.0, 0.2],
            equalities: 1,
        };
        let Minimiser { x, multipliers } = program.solve().unwrap();
        let close = |found: &[f64], expected: [f64; 2]| found.iter().zip(expected).all(|(f, e)| (f - e).abs() < 1e-5);
        assert!(close(&x, [0.2, 0.8]) && close(&multipliers, [-0.8, 0.6]), "{x:?} {multipliers:?}");
    }

    #[test]
    fn constraints_that_exclude_every_point_are_infeasible() {
        let program = Program {
            hessian: diagonal(&[1.0]),
            gradient: vec![0.0],
            constraints: {
                let mut writer = ColumnWriter::default();
                writer.put(0, 1.0);
                writer.put(1, -1.0);
                writer.end_column();
                writer.finish(2)
            },
            bounds: vec![-1.0, -1.0],
            equalities: 0,
        };
        assert_eq!(program.solve().err().as_deref(), Some("PrimalInfeasible"));
    }
}
