use std::ops::Range;

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};

use super::sheet::text_width_px;
use crate::{AxisScale, LogTicks, log_tick_text, log_ticks};

/// The scale of an axis: its range, ticks and number format.
#[derive(Clone, Debug)]
pub(super) struct Scale {
    /// Range of the axis, from and to.
    pub range: [f64; 2],
    /// Values of the ticks, ascending.
    ticks: Vec<f64>,
    /// Digits after the decimal point.
    digits: usize,
    /// True where numbers have a power of ten.
    power: bool,
    /// True where range and ticks are powers of ten.
    decades: bool,
    /// Values of the lines between ticks.
    minor: Vec<f64>,
}

/// Magnitudes of numbers that are written without a power of ten.
const PLAIN: Range<f64> = 1e-4..1e6;

impl Scale {
    /// The scale of an axis over `range`, which is in decades on a logarithmic axis, with at most `most` ticks.
    pub fn of(axis: AxisScale, range: [f64; 2], most: usize) -> Self {
        match axis {
            AxisScale::Linear => Self::over(range, most),
            AxisScale::Log => Self::over_decades(range, most),
        }
    }

    fn over_decades(range: [f64; 2], most: usize) -> Self {
        let LogTicks { major, minor } = log_ticks(range, most);
        let plain = Self::over(range.map(|end| 10f64.powf(end.clamp(-99.0, 99.0))), most);
        if major.is_empty() {
            // so short an axis has the ticks of a linear one in their places
            let ticks = plain.ticks.iter().map(|tick| tick.log10()).collect();
            return Self { range, ticks, minor: Vec::new(), decades: true, ..plain };
        }
        Self { range, ticks: major, digits: usize::MAX, power: false, decades: true, minor }
    }

    /// A scale over `range`, which is not empty, with at most `most` ticks at multiples of 1, 2 or 5 times a power of
    /// ten.
    pub fn over([low, high]: [f64; 2], most: usize) -> Self {
        let roughly = (high - low) / most.max(2) as f64;
        let decade = 10f64.powi(roughly.log10().floor() as i32);
        let fits = |&step: &f64| (high / step).floor() - (low / step).ceil() < most.max(2) as f64;
        let step = [1.0, 2.0, 5.0, 10.0].map(|k| k * decade).into_iter().find(fits).unwrap_or(20.0 * decade);
        let (first, last) = ((low / step).ceil(), (high / step).floor());
        let multiples = (0..most.max(2)).map(|k| first + k as f64).filter(|&k| k <= last);
        let ticks = multiples.map(|k| k * step).collect();
        let largest = low.abs().max(high.abs());
        let (largest_power, step_power) = (largest.log10().floor(), (1.000_001 * step).log10().floor());
        let power = !PLAIN.contains(&largest);
        let digits = if power { largest_power - step_power } else { -step_power };
        let digits = digits.max(0.0) as usize;
        Self { range: [low, high], ticks, digits, power, decades: false, minor: Vec::new() }
    }

    /// A number as it is written on the axis.
    pub fn text(&self, value: f64) -> String {
        let digits = self.digits;
        if self.decades && digits == usize::MAX {
            return log_tick_text(value);
        }
        let value = if self.decades { 10f64.powf(value) } else { value };
        let written = match self.power {
            true if value != 0.0 => format!("{value:.digits$e}"),
            true => "0".to_owned(),
            false => format!("{value:.digits$}"),
        };
        let is_zero = written.starts_with('-') && !written.contains(|c: char| ('1'..='9').contains(&c));
        if is_zero { written.replacen('-', "", 1) } else { written }
    }

    /// Width of the longest tick label, px, in letters of size `size_px`.
    pub fn width_px(&self, size_px: f64) -> f64 {
        self.ticks.iter().map(|&value| text_width_px(&self.text(value), size_px)).fold(0.0, f64::max)
    }
}

impl Ranged for Scale {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, (from, to): (i32, i32)) -> i32 {
        let [low, high] = self.range;
        from + ((value - low) / (high - low) * f64::from(to - from)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if hint.weight().allow_light_points() { self.minor.clone() } else { self.ticks.clone() }
    }

    fn range(&self) -> Range<f64> {
        self.range[0]..self.range[1]
    }
}

impl ValueFormatter<f64> for Scale {
    fn format_ext(&self, value: &f64) -> String {
        self.text(*value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn written(range: [f64; 2]) -> Vec<String> {
        let scale = Scale::over(range, 6);
        scale.ticks.iter().map(|&value| scale.text(value)).collect()
    }

    #[test]
    fn numbers_are_round_and_short() {
        assert_eq!(written([-1.04, 1.04]), ["-1.0", "-0.5", "0.0", "0.5", "1.0"]);
        assert_eq!(written([0.0, 103.0]), ["0", "20", "40", "60", "80", "100"]);
        assert_eq!(written([0.0071, 0.0089]), ["0.0075", "0.0080", "0.0085"]);
        assert_eq!(written([-3e7, 3e7]), ["-2e7", "0", "2e7"]);
        assert_eq!(written([1e-6, 3.1e-6]), ["1.0e-6", "1.5e-6", "2.0e-6", "2.5e-6", "3.0e-6"]);
    }

    proptest! {
        #[test]
        fn there_are_some_but_not_too_many(low in -1e9..1e9f64, decades in -8..9i32, most in 4..12usize) {
            let range = [low, low + 10f64.powi(decades).max(1e-7 * low.abs())];
            let scale = Scale::over(range, most);
            let ticks = &scale.ticks;
            prop_assert!((1..=most).contains(&ticks.len()), "{:?}", scale);
            prop_assert!(ticks.windows(2).all(|pair| pair[0] < pair[1]));
            prop_assert!(ticks.windows(2).all(|pair| scale.text(pair[0]) != scale.text(pair[1])), "{:?}", scale);
        }
    }
}
