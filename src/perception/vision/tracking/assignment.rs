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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const ALONE: f64 = 100.0;

    /// The least total by enumeration of all assignments.
    fn least_total(costs: &[Vec<f64>], row: usize, taken: &mut Vec<bool>) -> f64 {
        if row == costs.len() {
            return 0.0;
        }
        let mut best = ALONE + least_total(costs, row + 1, taken);
        for column in 0..taken.len() {
            if !taken[column] && costs[row][column] <= ALONE {
                taken[column] = true;
                best = best.min(costs[row][column] + least_total(costs, row + 1, taken));
                taken[column] = false;
            }
        }
        best
    }

    proptest! {
        #[test]
        fn no_other_way_costs_less(
            costs in (0usize..6, 0usize..6).prop_flat_map(|(rows, columns)| {
                proptest::collection::vec(proptest::collection::vec(-20.0..150.0f64, columns), rows)
            })
        ) {
            let columns = costs.first().map_or(0, Vec::len);
            let (choice, total) = assign(costs.len(), columns, ALONE, |row, column| costs[row][column]);
            let mut taken = vec![false; columns];
            prop_assert!((total - least_total(&costs, 0, &mut taken)).abs() < 1e-9);
            let mut own = 0.0;
            for (row, column) in choice.iter().enumerate() {
                own += column.map_or(ALONE, |column| costs[row][column]);
                if let Some(column) = *column {
                    prop_assert!(!std::mem::replace(&mut taken[column], true));
                }
            }
            prop_assert!((own - total).abs() < 1e-9);
        }
    }
}
