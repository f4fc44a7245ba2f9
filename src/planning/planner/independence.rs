use nalgebra::{DMatrix, DVector, SymmetricEigen};

use super::FieldPlanner;
use crate::cor_library::Library;
use upm_core::geometry::Vec2;

/// Flows that move no part by at least this fraction of the largest step there is are left out: they leave parts at
/// rest, in whatever direction they point.
const GENTLE: f64 = 0.05;

/// Independence of the parts' motions at given positions: the singular values of their flows together.
///
/// A column of the `2N × M` matrix is one flow at all parts, for one metre of the part that moves farthest: the
/// flow of an entry's longest pulse by the displacement table, or that of a synthesised field.
#[derive(Clone, Debug, PartialEq)]
pub struct Independence {
    /// All `2N` singular values, largest first. Zero: some joint motion of the parts is impossible.
    pub singular_values: Vec<f64>,
    /// In the joint motion that is hardest to make, the part that moves farthest and its direction, a unit vector.
    /// `None` without parts.
    pub weakest: Option<(usize, Vec2)>,
}

impl Independence {
    /// Independence of parts at `positions_m` under the rotations of `library`.
    pub fn of_rotations(library: &Library, positions_m: &[Vec2]) -> Self {
        let model = &library.displacement;
        let longest_s = model.sustain_s.last().copied().unwrap_or(0.0);
        let flow = |entry: usize| positions_m.iter().map(|&p| library.displacement_at(entry, p, longest_s)).collect();
        Self::of(positions_m.len(), (0..library.entries.len()).map(flow), GENTLE * model.farthest())
    }

    /// Independence of parts at `positions_m` under synthesised fields.
    pub fn of_fields(planner: &FieldPlanner, positions_m: &[Vec2]) -> Self {
        Self::of(positions_m.len(), planner.mean_forces(positions_m), GENTLE)
    }

    /// Independence of `parts` parts under `flows`, without the flows that move no part by `gentle` or more.
    fn of(parts: usize, flows: impl Iterator<Item = Vec<Vec2>>, gentle: f64) -> Self {
        let rows = 2 * parts;
        let mut product = DMatrix::<f64>::zeros(rows, rows);
        for flow in flows {
            let farthest = flow.iter().map(Vec2::norm).fold(0.0, f64::max);
            if farthest > 0.0 && farthest >= gentle {
                let column = DVector::from_iterator(rows, flow.iter().flat_map(|step| [step.x, step.y])) / farthest;
                product.ger(1.0, &column, &column, 1.0);
            }
        }
        if rows == 0 || product.iter().any(|x| !x.is_finite()) {
            return Self { singular_values: Vec::new(), weakest: None };
        }
        let SymmetricEigen { eigenvectors, eigenvalues } = SymmetricEigen::new(product);
        let mut order: Vec<usize> = (0..rows).collect();
        order.sort_by(|&a, &b| eigenvalues[b].total_cmp(&eigenvalues[a]));
        let singular_values = order.iter().map(|&k| eigenvalues[k].max(0.0).sqrt()).collect();
        let hardest = order.last().map(|&k| eigenvectors.column(k));
        let step = |part: usize| hardest.as_ref().map_or_else(Vec2::zeros, |u| Vec2::new(u[2 * part], u[2 * part + 1]));
        let farthest = (0..parts).max_by(|&a, &b| step(a).norm_squared().total_cmp(&step(b).norm_squared()));
        let weakest = farthest.and_then(|part| Some((part, step(part).try_normalize(0.0)?)));
        Self { singular_values, weakest }
    }

    /// The smallest singular value relative to the largest, 0 to 1; 0 when there are no singular values.
    pub fn share(&self) -> f64 {
        match (self.singular_values.first(), self.singular_values.last()) {
            (Some(&largest), Some(&smallest)) if largest > 0.0 => smallest / largest,
            _ => 0.0,
        }
    }
}
