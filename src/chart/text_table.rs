/// Lines of cells in columns, two spaces apart; `is_number` is true of the columns that are aligned to the right.
pub fn text_table(rows: &[Vec<String>], is_number: impl Fn(usize) -> bool) -> Vec<String> {
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..rows.first().map_or(0, Vec::len)).map(width).collect();
    let cell = |(column, cell): (usize, &String)| {
        let width = widths[column];
        if is_number(column) { format!("{cell:>width$}") } else { format!("{cell:width$}") }
    };
    let line =
        |row: &Vec<String>| row.iter().enumerate().map(cell).collect::<Vec<_>>().join("  ").trim_end().to_owned();
    rows.iter().map(line).collect()
}
