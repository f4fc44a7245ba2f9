/// Gives each of `rows` its own of `columns` at the least total cost (Kuhn, 1955; shortest augmenting paths with
/// potentials, Jonker and Volgenant, 1987). A row stays alone for `alone`; costs above it are no choice.
/// The total comes second.
pub(super) fn assign(
    rows: usize,
    columns: usize,
    alone: f64,
    cost: impl Fn(usize, usize) -> f64,
) -> (Vec<Option<usize>>, f64) {
    // One column more for each row to stay alone. Row and column 0 are the path's root.
    let width = columns + rows;
    let price = |row: usize, column: usize| if column < columns { cost(row, column).min(2.0 * alone) } else { alone };
    let (mut row_potential, mut column_potential) = (vec![0.0; rows + 1], vec![0.0; width + 1]);
    let mut owner = vec![0usize; width + 1];
    for row in 1..=rows {
        owner[0] = row;
        let (mut least, mut before, mut reached) =
            (vec![f64::INFINITY; width + 1], vec![0; width + 1], vec![false; width + 1]);
        let mut at = 0;
        while owner[at] != 0 {
            reached[at] = true;
            let (mut step, mut next) = (f64::INFINITY, 0);
            for column in (1..=width).filter(|&column| !reached[column]) {
                let reduced = price(owner[at] - 1, column - 1) - row_potential[owner[at]] - column_potential[column];
                if reduced < least[column] {
                    (least[column], before[column]) = (reduced, at);
                }
                if least[column] < step {
                    (step, next) = (least[column], column);
                }
            }
            for column in 0..=width {
                if reached[column] {
                    row_potential[owner[column]] += step;
                    column_potential[column] -= step;
                } else {
                    least[column] -= step;
                }
            }
            at = next;
        }
        while at != 0 {
            owner[at] = owner[before[at]];
            at = before[at];
        }
    }
    let mut choice = vec![None; rows];
    let mut total = 0.0;
    for (column, &row) in owner.iter().enumerate().skip(1).filter(|(_, row)| **row > 0) {
        let own = price(row - 1, column - 1);
        let taken = column <= columns && own <= alone;
        total += if taken { own } else { alone };
        choice[row - 1] = taken.then_some(column - 1);
    }
    (choice, total)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const ALONE: f64 = 100.0;

    /// The least total over all ways, one by one.
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
