use upm_lab::{COLUMNS, DataSheet, Figure, HEADS, NUMBERS, number};

/// The figures as lines of aligned columns under a header; numbers are right-aligned.
pub(super) fn table(figures: &[Figure]) -> Vec<String> {
    let head = std::iter::once(HEADS.map(str::to_owned));
    let rows: Vec<[String; COLUMNS]> = head.chain(figures.iter().map(Figure::cells)).collect();
    let widths: [usize; COLUMNS] =
        std::array::from_fn(|column| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0));
    rows.iter().map(|row| line(row, &widths)).collect()
}

/// A table of numbers as lines of aligned columns under a header.
pub(super) fn columns(sheet: &DataSheet) -> Vec<String> {
    let cells = sheet.rows.iter().map(|row| row.iter().map(|&value| number(value)).collect());
    let rows: Vec<Vec<String>> = std::iter::once(sheet.columns.clone()).chain(cells).collect();
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..sheet.columns.len()).map(width).collect();
    let line = |row: &Vec<String>| {
        let cells = row.iter().zip(&widths).map(|(cell, &width)| format!("{cell:>width$}"));
        cells.collect::<Vec<_>>().join("  ")
    };
    rows.iter().map(line).collect()
}

fn line(row: &[String; COLUMNS], widths: &[usize; COLUMNS]) -> String {
    let cells = row
        .iter()
        .zip(widths)
        .zip(NUMBERS)
        .map(|((cell, &width), number)| if number { format!("{cell:>width$}") } else { format!("{cell:width$}") });
    cells.collect::<Vec<_>>().join("  ").trim_end().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sheets_are_aligned_and_nan_is_shown_as_a_dash() {
        let columns = ["duty", "rate (mm/s)"].map(str::to_owned).to_vec();
        let sheet = DataSheet { columns, rows: vec![vec![0.5, 12.0], vec![0.75, f64::NAN]] };
        assert_eq!(super::columns(&sheet), ["  duty  rate (mm/s)", "0.5000        12.00", "0.7500            -"]);
    }

    #[test]
    fn columns_are_aligned_by_characters() {
        let figures =
            [Figure::against("a", "m/s²", 2.0, 2.1, "Eq. 1"), Figure::alone("longer name", "mm", -123.456, "counted")];
        assert_eq!(
            table(&figures),
            [
                "figure       measured  reference  unit  error %  source",
                "a               2.000      2.100  m/s²    -4.76  Eq. 1",
                "longer name    -123.5          -  mm          -  counted",
            ]
        );
    }
}
