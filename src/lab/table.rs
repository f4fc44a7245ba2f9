//! Tables of figures and of numbers as lines of aligned columns.

use super::{DataSheet, Figure};
use upm_chart::text_table;

/// Headings of the table of figures.
const HEADS: [&str; 6] = ["figure", "measured", "reference", "unit", "error %", "source"];
/// True for columns of numbers, which are right-aligned.
const NUMBERS: [bool; 6] = [false, true, true, false, true, false];

/// Significant digits shown.
const DIGITS: i32 = 4;

/// Most decimal places; numbers that need more are written with a power of ten.
const PLACES: i32 = 6;

/// Integers below this are shown in full.
const COUNTED: f64 = 1e6;

/// The figures as lines under a header.
pub(super) fn table(figures: &[Figure]) -> Vec<String> {
    let head = HEADS.map(str::to_owned).to_vec();
    let rows: Vec<Vec<String>> = std::iter::once(head).chain(figures.iter().map(cells)).collect();
    text_table(&rows, |column| NUMBERS[column])
}

/// The numbers of a sheet as lines under a header.
pub(super) fn columns(sheet: &DataSheet) -> Vec<String> {
    let rows = sheet.rows.iter().map(|row| row.iter().map(|&value| number(value)).collect());
    text_table(&std::iter::once(sheet.columns.clone()).chain(rows).collect::<Vec<_>>(), |_| true)
}

/// The figure's row in a table.
fn cells(figure: &Figure) -> Vec<String> {
    let dash = || "-".to_owned();
    let places = places([Some(figure.measured), figure.reference].into_iter().flatten());
    let reference = figure.reference.map_or_else(dash, |reference| shown(reference, places));
    let error = figure.relative_error().map_or_else(dash, |error| unsigned_zero(format!("{:+.2}", 100.0 * error)));
    let measured = if figure.measured.is_nan() { dash() } else { shown(figure.measured, places) };
    vec![figure.name.clone(), measured, reference, figure.unit.clone(), error, figure.source.clone()]
}

/// `value` with four significant digits; a dash for NaN.
fn number(value: f64) -> String {
    if value.is_nan() { "-".to_owned() } else { shown(value, places_of(value)) }
}

/// Decimal places that give `value` four significant digits.
fn places_of(value: f64) -> i32 {
    if value != 0.0 && value.is_finite() { DIGITS - 1 - value.abs().log10().floor() as i32 } else { 0 }
}

/// Decimal places for numbers that are compared: none where all are counts, else as many as give the largest four
/// digits.
fn places(numbers: impl Iterator<Item = f64> + Clone) -> i32 {
    if numbers.clone().all(|number| number.fract() == 0.0 && number.abs() < COUNTED) {
        return 0;
    }
    places_of(numbers.map(f64::abs).fold(0.0, f64::max))
}

/// `value` with `places` decimal places; with a power of ten where they are too many or too few.
fn shown(value: f64, places: i32) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    if !(-PLACES..=PLACES).contains(&places) {
        return format!("{value:.3e}");
    }
    unsigned_zero(format!("{value:.*}", places.max(0) as usize))
}

/// Removes the sign of zero: `-0.00` and `+0.00` become 0.00.
fn unsigned_zero(text: String) -> String {
    match text.strip_prefix(['-', '+']) {
        Some(digits) if digits.chars().all(|c| "0.".contains(c)) => digits.to_owned(),
        _ => text,
    }
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
