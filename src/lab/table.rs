use super::Figure;

/// Columns of the table of figures.
pub const COLUMNS: usize = 6;

/// What stands above them.
pub const HEADS: [&str; COLUMNS] = ["figure", "measured", "reference", "unit", "error %", "source"];

/// Which of them are numbers.
pub const NUMBERS: [bool; COLUMNS] = [false, true, true, false, true, false];

/// Digits of a number that are shown.
const DIGITS: i32 = 4;

/// Most places after the point; what needs more is written with a power of ten.
const PLACES: i32 = 6;

impl Figure {
    /// Its row in a table under [`HEADS`], for people.
    pub fn cells(&self) -> [String; COLUMNS] {
        let largest = self.reference.unwrap_or_default().abs().max(self.measured.abs());
        let reference = self.reference.map_or("-".to_owned(), |reference| shown(reference, largest));
        let error = self.relative_error().map(|error| unsigned_zero(format!("{:+.2}", 100.0 * error)));
        let measured = shown(self.measured, largest);
        let error = error.unwrap_or("-".to_owned());
        [self.name.clone(), measured, reference, self.unit.clone(), error, self.source.clone()]
    }
}

/// `value` with as many places as give a number of the size of `largest` four digits, so that the two compare.
fn shown(value: f64, largest: f64) -> String {
    let places = if largest > 0.0 { DIGITS - 1 - largest.log10().floor() as i32 } else { 0 };
    if !(-PLACES..=PLACES).contains(&places) {
        return format!("{value:.3e}");
    }
    unsigned_zero(format!("{value:.*}", places.max(0) as usize))
}

/// `-0.00` and `+0.00` are 0.00.
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
    fn numbers_have_four_digits_or_as_many_as_what_they_are_compared_with() {
        for (value, largest, text) in [
            (1.0, 1.0, "1.000"),
            (-2.515, 2.75, "-2.515"),
            (12345.6, 12345.6, "12346"),
            (0.000_123_4, 0.000_123_4, "1.234e-4"),
            (0.012_344, 0.012_344, "0.01234"),
            (-0.000_2, 40.0, "0.00"),
            (0.0, 0.0, "0"),
            (3.2e12, 3.2e12, "3.200e12"),
            (f64::NAN, 0.0, "NaN"),
            (f64::INFINITY, f64::INFINITY, "inf"),
        ] {
            assert_eq!(shown(value, largest), text);
        }
        let cells = Figure::against("COR", "mm", 1.999_99, 2.0, "Eq. 6").cells();
        assert_eq!(cells, ["COR", "2.000", "2.000", "mm", "0.00", "Eq. 6"]);
        let cells = Figure::against("COR", "mm", 1e-3, 0.0, "Eq. 6").cells();
        assert_eq!(cells, ["COR", "0.001000", "0.000000", "mm", "-", "Eq. 6"]);
    }
}
