use upm_lab::{COLUMNS, DataSheet, ExperimentResult, Figure, HEADS, NUMBERS, number};

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
    let rows: Vec<Vec<String>> = std::iter::once(sheet.columns.clone()).chain(cells(sheet)).collect();
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..sheet.columns.len()).map(width).collect();
    let line = |row: &Vec<String>| {
        let cells = row.iter().zip(&widths).map(|(cell, &width)| format!("{cell:>width$}"));
        cells.collect::<Vec<_>>().join("  ")
    };
    rows.iter().map(line).collect()
}

fn cells(sheet: &DataSheet) -> impl Iterator<Item = Vec<String>> + '_ {
    sheet.rows.iter().map(|row| row.iter().map(|&value| number(value)).collect())
}

/// Figures and table of numbers in Markdown under a title.
pub(super) fn markdown(title: &str, outcome: &ExperimentResult) -> String {
    let figures = (!outcome.figures.is_empty()).then(|| of_figures(&outcome.figures));
    let sheet = outcome.sheet.as_ref().map(of_sheet);
    let tables = figures.into_iter().chain(sheet).collect::<Vec<_>>().join("\n\n");
    format!("**{title}**\n\n{tables}")
}

fn of_sheet(sheet: &DataSheet) -> String {
    let line = |cells: Vec<String>| format!("| {} |", cells.join(" | "));
    let head = [line(sheet.columns.clone()), line(vec!["---:".to_owned(); sheet.columns.len()])];
    head.into_iter().chain(cells(sheet).map(line)).collect::<Vec<_>>().join("\n")
}

fn of_figures(figures: &[Figure]) -> String {
    let line = |cells: [String; COLUMNS]| format!("| {} |", cells.map(|cell| cell.replace('|', "\\|")).join(" | "));
    let rule = NUMBERS.map(|number| if number { "---:" } else { "---" }.to_owned());
    let head = [line(HEADS.map(str::to_owned)), line(rule)];
    let rows = figures.iter().map(|figure| line(figure.cells()));
    head.into_iter().chain(rows).collect::<Vec<_>>().join("\n")
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
    fn bars_in_cells_do_not_end_them() {
        let figures = vec![Figure::alone("pulses | steps", "1", 12.0, "counted")];
        let text = markdown("a title", &ExperimentResult { figures, ..ExperimentResult::default() });
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "**a title**");
        assert_eq!(lines[3], "| --- | ---: | ---: | --- | ---: | --- |");
        assert_eq!(lines[4], "| pulses \\| steps | 12 | - | 1 | - | counted |");
    }

    #[test]
    fn sheets_are_aligned_and_nan_is_shown_as_a_dash() {
        let columns = ["duty", "rate (mm/s)"].map(str::to_owned).to_vec();
        let sheet = DataSheet { columns, rows: vec![vec![0.5, 12.0], vec![0.75, f64::NAN]] };
        assert_eq!(super::columns(&sheet), ["  duty  rate (mm/s)", "0.5000        12.00", "0.7500            -"]);
        let text = markdown("t", &ExperimentResult { sheet: Some(sheet), ..ExperimentResult::default() });
        assert_eq!(text.lines().last(), Some("| 0.7500 | - |"));
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
