use nalgebra::{DMatrix, SymmetricEigen};

use crate::geometry::Vec2;
use crate::library::Library;

/// Entries that move none of the parts as far as this part of the longest measured step are left out: they leave parts
/// where they are, whatever their direction.
const GENTLE: f64 = 0.05;

/// How far parts can be moved independently of each other where they are: the singular values of their flows together.
///
/// A column of the `2N × M` matrix is one entry's flow at all parts, as measured for its longest pulse, for one metre of
/// the part on the fastest belt: the matrix of the planner's program.
#[derive(Clone, Debug, PartialEq)]
pub struct Independence {
    /// All `2N` of them, largest first. Zero: some joint motion of the parts cannot be made at all.
    pub singular_values: Vec<f64>,
    /// Of the joint motion that is hardest to make, the part that goes farthest in it and which way, a unit vector.
    /// `None` without parts.
    pub weakest: Option<(usize, Vec2)>,
}

impl Independence {
    /// Of parts at `positions_m` with `library`.
    pub fn of(library: &Library, positions_m: &[Vec2]) -> Self {
        let rows = 2 * positions_m.len();
        let mut product = DMatrix::<f64>::zeros(rows, rows);
        for column in columns(library, positions_m) {
            for (i, a) in column.iter().enumerate() {
                for (k, b) in column.iter().enumerate() {
                    product[(i, k)] += a * b;
                }
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
        let farthest =
            (0..positions_m.len()).max_by(|&a, &b| step(a).norm_squared().total_cmp(&step(b).norm_squared()));
        let weakest = farthest.and_then(|part| Some((part, step(part).try_normalize(0.0)?)));
        Self { singular_values, weakest }
    }

    /// The smallest singular value as a part of the largest, 0 to 1; 0 when there is none.
    pub fn share(&self) -> f64 {
        match (self.singular_values.first(), self.singular_values.last()) {
            (Some(&largest), Some(&smallest)) if largest > 0.0 => smallest / largest,
            _ => 0.0,
        }
    }
}

/// For each entry that moves any part: x and y of each part's step for one metre of the part that goes farthest.
fn columns(library: &Library, positions_m: &[Vec2]) -> impl Iterator<Item = Vec<f64>> {
    let model = &library.displacement;
    let longest_s = model.sustain_s.last().copied().unwrap_or(0.0);
    let best_m = model.speed_mps.last().map_or(0.0, |&fastest| model.max_distance(fastest));
    (0..library.entries.len()).filter_map(move |entry| {
        let steps_m: Vec<Vec2> = positions_m.iter().map(|&p| library.displacement_at(entry, p, longest_s)).collect();
        let farthest_m = steps_m.iter().map(Vec2::norm).fold(0.0, f64::max);
        let moves = farthest_m > 0.0 && farthest_m >= GENTLE * best_m;
        moves.then(|| steps_m.iter().flat_map(|step| [step.x / farthest_m, step.y / farthest_m]).collect())
    })
}
