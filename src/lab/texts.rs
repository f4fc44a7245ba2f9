//! Texts of figures, charts and sheets, from the tables below `assets/lab`: units, the papers' values, sources, titles.

use super::{DataSheet, Figure};
use upm_chart::{Axis, Chart};

/// Figures: name, unit, reference, least and largest value that counts as reproduced, source.
const FIGURES: &str = include_str!("../../assets/lab/figures.tsv");
/// Charts: name, title, labels of the axes, and which of these are logarithmic.
const CHARTS: &str = include_str!("../../assets/lab/charts.tsv");
/// Sheets: name and headings of the columns, with units.
const SHEETS: &str = include_str!("../../assets/lab/sheets.tsv");

/// Cells of the row of `table` that begins with `name`.
fn cells(table: &'static str, name: &str) -> impl Iterator<Item = &'static str> {
    let mut rows = table.lines().map(|line| line.split('\t'));
    rows.find(|cells| cells.clone().next() == Some(name)).into_iter().flatten()
}

/// The same, `N` of them.
fn row<const N: usize>(table: &'static str, name: &str) -> [&'static str; N] {
    let mut cells = cells(table, name);
    std::array::from_fn(|_| cells.next().unwrap_or_default())
}

/// The figure called `name` in the table.
pub(super) fn figure(name: &str, measured: f64) -> Figure {
    let [_, unit, reference, least, most, source] = row(FIGURES, name);
    let [reference, least, most] = [reference, least, most].map(|cell| cell.parse().ok());
    let figure = Figure::alone(name, unit, measured, source).with(reference);
    least.zip(most).map_or(figure.clone(), |(least, most)| figure.judged([least, most]))
}

/// Several figures of the table.
pub(super) fn figures<const N: usize>(measured: [(&str, f64); N]) -> [Figure; N] {
    measured.map(|(name, measured)| figure(name, measured))
}

/// The empty chart called `name` in the table.
pub(super) fn chart(name: &str) -> Chart {
    let [_, title, x, y, logarithmic] = row(CHARTS, name);
    let axis = |which: char, label| if logarithmic.contains(which) { Axis::log(label) } else { Axis::new(label) };
    Chart::over(name, title, [axis('x', x), axis('y', y)])
}

/// The sheet called `name` in the table, with these rows.
pub(super) fn sheet(name: &str, rows: Vec<Vec<f64>>) -> DataSheet {
    DataSheet { columns: cells(SHEETS, name).skip(1).map(str::to_owned).collect(), rows }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All sources of the lab.
    fn sources(folder: &std::path::Path) -> String {
        let paths = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
        paths.map(|path| if path.is_dir() { sources(&path) } else { std::fs::read_to_string(path).unwrap() }).collect()
    }

    #[test]
    fn rows_have_all_cells_names_of_their_own_and_uses() {
        let sources = sources(std::path::Path::new(env!("CARGO_MANIFEST_DIR")));
        for (table, cells) in [(FIGURES, 6), (CHARTS, 5)] {
            let mut names = std::collections::BTreeSet::new();
            for line in table.lines().skip(1) {
                let name = line.split('\t').next().unwrap();
                let row: Vec<&str> = line.split('\t').collect();
                assert_eq!(row.len(), cells, "{line}");
                if table == FIGURES {
                    let numbers: Vec<f64> = [3, 4, 2].iter().filter_map(|&i| row[i].parse().ok()).collect();
                    let filled = [2, 3, 4].iter().filter(|&&i| !row[i].is_empty()).count();
                    assert!(numbers.len() == filled && row[3].is_empty() == row[4].is_empty(), "{line}");
                    assert!(numbers.len() < 2 || numbers[0] <= numbers[1], "{line}");
                    assert!(!row[1].is_empty() && !row[5].is_empty(), "{line}");
                }
                assert!(names.insert(name), "twice: {name}");
                let is_used = |name: &str| sources.contains(&format!("\"{name}\""));
                assert!(
                    is_used(name) || name.split(": ").any(is_used) || name.contains(" dyn, 207 µg"),
                    "unused: {name}"
                );
            }
        }
    }
}
