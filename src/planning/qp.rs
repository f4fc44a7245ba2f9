//! Convex quadratic programs, and the only module that uses clarabel.
//!
//! ```text
//!   minimise    ½ xᵀ P x + qᵀ x
//!   over        x, n numbers
//!   subject to  A x + s = b,   s in a product of cones: s_i = 0, s_i >= 0, or s_1 >= |(s_2, …)|
//! ```
//!
//! Equal programs give bit-identical answers: one thread, the built-in LDL factorisation, no time limit, no presolve.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverError, SolverStatus, SupportedConeT};

/// Sparse matrix, compressed by columns.
pub type Matrix = CscMatrix<f64>;

/// Cone of the given number of rows: `ZeroConeT` for equalities, every s is 0; `NonnegativeConeT` for inequalities, no
/// s is negative; `SecondOrderConeT`, the first s is at least as large as the norm of the others.
pub type Cone = SupportedConeT<f64>;

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

    /// Returns the matrix with `rows` rows and the columns ended so far.
    pub fn finish(self, rows: usize) -> Matrix {
        let columns = self.ends.len();
        let starts = std::iter::once(0).chain(self.ends).collect();
        Matrix::new(rows, columns, starts, self.rows, self.values)
    }
}

/// Data of one program; see the module for the symbols.
pub struct Program {
    /// P, n × n, upper triangle.
    pub hessian: Matrix,
    /// q, n numbers.
    pub gradient: Vec<f64>,
    /// A, m × n.
    pub constraints: Matrix,
    /// b, m numbers.
    pub bounds: Vec<f64>,
    /// The cones of s, in the order of the rows.
    pub cones: Vec<Cone>,
}

/// A minimiser and its multipliers.
pub struct Minimiser {
    /// x, n numbers.
    pub x: Vec<f64>,
    /// Multipliers z of the m rows of constraints, in the dual cones: `P x + q + Aᵀ z = 0`.
    pub multipliers: Vec<f64>,
}

impl Program {
    /// Solves the program. A minimiser of reduced accuracy, clarabel's `AlmostSolved`, counts as solved.
    ///
    /// # Errors
    /// The status of clarabel where it finds no minimiser: `PrimalInfeasible` where the constraints exclude every x,
    /// `DualInfeasible` where the objective has no lower bound, others where it does not converge. The set-up error of
    /// clarabel where the program's dimensions do not agree.
    pub fn solve(&self) -> Result<Minimiser, String> {
        let Self { hessian, gradient, constraints, bounds, cones } = self;
        let mut solver = DefaultSolver::new(hessian, gradient, constraints, bounds, cones, settings())
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

    /// A matrix of so many rows with these values in the rows of each column.
    fn matrix(rows: usize, columns: &[&[(usize, f64)]]) -> Matrix {
        let mut writer = ColumnWriter::default();
        for column in columns {
            column.iter().for_each(|&(row, value)| writer.put(row, value));
            writer.end_column();
        }
        writer.finish(rows)
    }

    /// The nearest point of the line x + y = 1 with x <= 0.2 to the origin, by hand: (0.2, 0.8), multipliers -0.8 and
    /// 0.6.
    #[test]
    fn a_small_program_has_the_minimiser_found_by_hand() {
        let program = Program {
            hessian: matrix(2, &[&[(0, 1.0)], &[(1, 1.0)]]),
            gradient: vec![0.0, 0.0],
            constraints: matrix(2, &[&[(0, 1.0), (1, 1.0)], &[(0, 1.0)]]),
            bounds: vec![1.0, 0.2],
            cones: vec![Cone::ZeroConeT(1), Cone::NonnegativeConeT(1)],
        };
        let Minimiser { x, multipliers } = program.solve().unwrap();
        let close = |found: &[f64], expected: [f64; 2]| found.iter().zip(expected).all(|(f, e)| (f - e).abs() < 1e-5);
        assert!(close(&x, [0.2, 0.8]) && close(&multipliers, [-0.8, 0.6]), "{x:?} {multipliers:?}");
    }

    #[test]
    fn constraints_that_exclude_every_point_are_infeasible() {
        let program = Program {
            hessian: matrix(1, &[&[(0, 1.0)]]),
            gradient: vec![0.0],
            constraints: matrix(2, &[&[(0, 1.0), (1, -1.0)]]),
            bounds: vec![-1.0, -1.0],
            cones: vec![Cone::NonnegativeConeT(2)],
        };
        assert_eq!(program.solve().err().as_deref(), Some("PrimalInfeasible"));
    }

    /// The least x + y with (x, y) within 0.1 of (1, 0): at (1, 0) - 0.1 (1, 1)/sqrt 2.
    #[test]
    fn a_second_order_cone_is_a_ball() {
        let program = Program {
            hessian: matrix(2, &[&[(0, 0.0)], &[(1, 0.0)]]),
            gradient: vec![1.0, 1.0],
            constraints: matrix(3, &[&[(1, 1.0)], &[(2, 1.0)]]),
            bounds: vec![0.1, 1.0, 0.0],
            cones: vec![Cone::SecondOrderConeT(3)],
        };
        let Minimiser { x, .. } = program.solve().unwrap();
        let off = 0.1 * std::f64::consts::FRAC_1_SQRT_2;
        assert!((x[0] - (1.0 - off)).abs() < 1e-5 && (x[1] + off).abs() < 1e-5, "{x:?}");
    }
}
