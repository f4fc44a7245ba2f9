use super::Figure;

/// Columns of the table of figures.
pub const COLUMNS: usize = 6;

/// Headings of the columns.
pub const HEADS: [&str; COLUMNS] = ["figure", "measured", "reference", "unit", "error %", "source"];

/// True for columns of numbers.
pub const NUMBERS: [bool; COLUMNS] = [false, true, true, false, true, false];

/// Significant digits shown.
const DIGITS: i32 = 4;

/// Most decimal places; numbers that need more are written with a power of ten.
const PLACES: i32 = 6;

/// Integers below this are shown in full.
const COUNTED: f64 = 1e6;

impl Figure {
    /// The figure's row in a table under [`HEADS`].
    pub fn cells(&self) -> [String; COLUMNS] {
        let numbers = [Some(self.measured), self.reference];
        let places = places(numbers.into_iter().flatten());
        let reference = self.reference.map_or("-".to_owned(), |reference| shown(reference, places));
        let error = self.relative_error().map(|error| unsigned_zero(format!("{:+.2}", 100.0 * error)));
        let measured = if self.measured.is_nan() { "-".to_owned() } else { shown(self.measured, places) };
        let error = error.unwrap_or("-".to_owned());
        [self.name.clone(), measured, reference, self.unit.clone(), error, self.source.clone()]
    }
}

/// `value` with four significant digits; a dash for NaN.
pub fn number(value: f64) -> String {
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

    fn cells(measured: f64, reference: Option<f64>) -> [String; 3] {
        let figure = Figure { reference, ..Figure::alone("COR", "mm", measured, "Eq. 6") };
        let [name, measured, reference, unit, error, source] = figure.cells();
        assert_eq!([name, unit, source], ["COR", "mm", "Eq. 6"]);
        [measured, reference, error]
    }

    #[test]
    fn numbers_have_four_digits() {
        for (value, text) in [
            (1.0004, "1.000"),
            (-2.515, "-2.515"),
            (12345.6, "12346"),
            (0.000_123_4, "1.234e-4"),
            (0.012_344, "0.01234"),
            (3.2e12, "3.200e12"),
            (f64::NAN, "-"),
            (f64::INFINITY, "inf"),
        ] {
            assert_eq!(cells(value, None)[0], text);
        }
    }

    #[test]
    fn compared_values_share_the_decimal_places_of_the_larger() {
        assert_eq!(cells(1.999_99, Some(2.0)), ["2.000", "2.000", "0.00"]);
        assert_eq!(cells(-0.000_2, Some(40.5)), ["0.00", "40.50", "-100.00"]);
        assert_eq!(cells(1e-3, Some(0.0)), ["0.001000", "0", "-"]);
        assert_eq!(cells(1e-9, Some(0.0)), ["1.000e-9", "0", "-"]);
    }

    #[test]
    fn counts_are_whole_numbers() {
        for (count, text) in [(62.0, "62"), (-2.0, "-2"), (0.0, "0"), (-0.0, "0"), (999_999.0, "999999")] {
            assert_eq!(cells(count, None)[0], text);
        }
        assert_eq!(cells(64.0, Some(128.0)), ["64", "128", "-50.00"]);
        assert_eq!(cells(2.0, Some(2.5)), ["2.000", "2.500", "-20.00"]);
    }
}
