use upm_lab::{COLUMNS, Figure, HEADS, NUMBERS};

/// The figures as lines of aligned columns under a head; numbers are flush right.
pub(super) fn table(figures: &[Figure]) -> Vec<String> {
    let head = std::iter::once(HEADS.map(str::to_owned));
    let rows: Vec<[String; COLUMNS]> = head.chain(figures.iter().map(Figure::cells)).collect();
    let widths: [usize; COLUMNS] =
        std::array::from_fn(|column| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0));
    rows.iter().map(|row| line(row, &widths)).collect()
}

/// The figures as a Markdown table under a title.
pub(super) fn markdown(title: &str, figures: &[Figure]) -> String {
    let line = |cells: [String; COLUMNS]| format!("| {} |", cells.map(|cell| cell.replace('|', "\\|")).join(" | "));
    let rule = NUMBERS.map(|number| if number { "---:" } else { "---" }.to_owned());
    let head = [format!("**{title}**"), String::new(), line(HEADS.map(str::to_owned)), line(rule)];
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
        let text = markdown("a title", &[Figure::alone("pulses | steps", "1", 12.0, "counted")]);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "**a title**");
        assert_eq!(lines[3], "| --- | ---: | ---: | --- | ---: | --- |");
        assert_eq!(lines[4], "| pulses \\| steps | 12 | - | 1 | - | counted |");
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
