//! Fewer pulses: drops the ones whose work the others can take over.

use nalgebra::{DMatrix, DVector};

use super::field::{Columns, dot};

/// Keeps the inverse of nearly dependent columns finite.
const RIDGE: f64 = 1e-6;

/// Indices of the columns to keep so that `target_m` is still met to `tolerance_m` (norm of all steps), at most `most`.
///
/// Backward elimination in least squares: with `G = Φᵀ Φ`, leaving out column j raises the squared
/// error by `d_j² / (G⁻¹)_jj`; the cheapest goes first and the rest is updated in closed form.
pub(super) fn keep(columns: &Columns, target_m: &[f64], tolerance_m: f64, most: usize) -> Vec<usize> {
    let count = columns.len();
    let gram =
        DMatrix::from_fn(count, count, |i, j| columns.dot(i, columns.column(j)) + if i == j { RIDGE } else { 0.0 });
    let Some(mut inverse) = gram.cholesky().map(|factor| factor.inverse()) else {
        return (0..count.min(most)).collect();
    };
    let mut distances = &inverse * DVector::from_fn(count, |j, _| columns.dot(j, target_m));
    let mut kept: Vec<usize> = (0..count).collect();
    let mut error_sq = residual_sq(columns, distances.as_slice(), target_m);
    while kept.len() > 1 {
        let loss = |&j: &usize| distances[j] * distances[j] / inverse[(j, j)].max(f64::MIN_POSITIVE);
        let Some(place) = (0..kept.len()).min_by(|&a, &b| loss(&kept[a]).total_cmp(&loss(&kept[b]))) else { break };
        let j = kept[place];
        error_sq += loss(&j);
        if error_sq > tolerance_m * tolerance_m && kept.len() <= most {
            break;
        }
        kept.remove(place);
        let column = inverse.column(j).clone_owned();
        distances -= &column * (distances[j] / column[j]);
        inverse.ger(-1.0 / column[j], &column, &column, 1.0);
    }
    kept
}

fn residual_sq(columns: &Columns, distances: &[f64], target_m: &[f64]) -> f64 {
    let mut error = target_m.to_vec();
    for (j, &d) in distances.iter().enumerate() {
        error.iter_mut().zip(columns.column(j)).for_each(|(e, flow)| *e -= d * flow);
    }
    dot(&error, &error)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns(values: &[f64]) -> Columns {
        let mut columns = Columns::default();
        columns.clear(2);
        columns.push(values.iter().copied());
        columns
    }

    #[test]
    fn one_column_is_enough_when_it_points_there() {
        let three = columns(&[1.0, 0.0, 0.8, 0.6, 0.0, 1.0]);
        assert_eq!(keep(&three, &[0.004, 0.003], 1e-4, 9), [1]);
        assert_eq!(keep(&three, &[0.004, -0.003], 1e-4, 9).len(), 2);
        assert_eq!(keep(&three, &[0.004, -0.003], 1e-4, 1), [0], "at most one: the better one");
        assert_eq!(keep(&three, &[0.004, -0.0002], 5e-4, 9), [0], "within tolerance");
    }

    #[test]
    fn what_is_left_is_least_squares() {
        // dropping by the closed form leaves the same error as solving anew
        let five = columns(&[1.0, 0.1, 0.7, 0.6, 0.2, 1.0, -0.5, 0.9, 0.9, -0.4]);
        let target = [0.003, 0.005];
        for most in 1..=2 {
            let kept = keep(&five, &target, 0.0, most);
            assert_eq!(kept.len(), most);
            let chosen = five.select(&kept);
            let matrix = nalgebra::DMatrix::from_fn(2, most, |row, j| chosen.column(j)[row]);
            let d = matrix.pseudo_inverse(1e-12).unwrap() * nalgebra::DVector::from_row_slice(&target);
            let error = residual_sq(&chosen, d.as_slice(), &target).sqrt();
            assert!(error < if most == 1 { 2e-3 } else { 1e-6 }, "{error}");
        }
    }

    #[test]
    fn twins_and_nothing_do_no_harm() {
        let twins = columns(&[1.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
        assert_eq!(keep(&twins, &[0.01, 0.0], 1e-5, 9).len(), 1);
        assert!(keep(&columns(&[]), &[0.01, 0.0], 1e-5, 9).is_empty());
    }
}
