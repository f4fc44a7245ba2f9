use crate::lab::{COLUMNS, Figure, HEADS, NUMBERS};

/// The figures as lines of aligned columns under a head; numbers are flush right.
pub(super) fn table(figures: &[Figure]) -> Vec<String> {
    let head = std::iter::once(HEADS.map(str::to_owned));
    let rows: Vec<[String; COLUMNS]> = head.chain(figures.iter().map(Figure::cells)).collect();
    let widths: [usize; COLUMNS] =
        std::array::from_fn(|column| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0));
    rows.iter().map(|row| line(row, &widths)).collect()
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
