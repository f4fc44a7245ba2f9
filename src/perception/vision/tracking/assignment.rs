use pathfinding::prelude::{Matrix, kuhn_munkres_min};

/// Weight of an unassigned row: up to 64 rows can be summed with costs resolved to 1e-15 of it.
const ALONE: f64 = (1_i64 << 52) as f64;

/// Assigns to each of `rows` a different one of `columns` at the least total cost. An unassigned row costs `alone`;
/// higher costs are never chosen. The total is the second value.
pub(super) fn assign(
    rows: usize,
    columns: usize,
    alone: f64,
    cost: impl Fn(usize, usize) -> f64,
) -> (Vec<Option<usize>>, f64) {
    if rows == 0 {
        return (Vec::new(), 0.0);
    }
    // one extra column for each row to remain unassigned
    let price = |row, column| if column < columns { cost(row, column).min(2.0 * alone) } else { alone };
    let weight = |(row, column)| (price(row, column) / alone * ALONE).round() as i64;
    let (_, chosen) = kuhn_munkres_min(&Matrix::from_fn(rows, columns + rows, weight));
    let mut total = 0.0;
    let taken = chosen.into_iter().enumerate().map(|(row, column)| {
        let own = price(row, column);
        total += own.min(alone);
        (column < columns && own <= alone).then_some(column)
    });
    (taken.collect(), total)
}
