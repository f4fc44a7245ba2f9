//! Ticks of axes: round values with their texts.

use std::ops::Range;

use crate::AxisScale;
use crate::decades::{LogTicks, log_tick_text, log_ticks};

/// Magnitudes of numbers that are written without a power of ten.
const PLAIN: Range<f64> = 1e-4..1e6;

/// Labelled ticks of an axis and the lines between them.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct AxisTicks {
    /// Value and text of each tick, ascending; the values are in decades on a logarithmic axis.
    pub major: Vec<(f64, String)>,
    /// Values of the lines between the ticks, in decades; empty for a linear axis.
    pub minor: Vec<f64>,
}

/// At most `most` ticks of an axis over `range`, which is in decades on a logarithmic axis. A logarithmic axis too
/// short for two decade ticks gets linear ticks at their logarithmic positions. An empty range has no ticks.
pub(crate) fn axis_ticks(scale: AxisScale, range: [f64; 2], most: usize) -> AxisTicks {
    if scale == AxisScale::Linear {
        return AxisTicks { major: linear_ticks(range, most), minor: Vec::new() };
    }
    let LogTicks { major, minor } = log_ticks(range, most);
    if major.is_empty() {
        let plain = linear_ticks(range.map(|end| 10f64.powf(end)), most);
        return AxisTicks { major: plain.into_iter().map(|(value, text)| (value.log10(), text)).collect(), minor };
    }
    AxisTicks { major: major.into_iter().map(|place| (place, log_tick_text(place))).collect(), minor }
}

/// At most `most` multiples of 1, 2 or 5 times a power of ten within the range, with their texts.
fn linear_ticks([low, high]: [f64; 2], most: usize) -> Vec<(f64, String)> {
    let most = most.max(2);
    let roughly = (high - low) / most as f64;
    if !roughly.is_normal() || roughly < 0.0 {
        return Vec::new();
    }
    let decade = 10f64.powi(roughly.log10().floor() as i32);
    let fits = |&step: &f64| (high / step).floor() - (low / step).ceil() < most as f64;
    let step = [1.0, 2.0, 5.0, 10.0].map(|k| k * decade).into_iter().find(fits).unwrap_or(20.0 * decade);
    let (first, last) = ((low / step).ceil(), (high / step).floor());
    let values = (0..most).map(|k| first + k as f64).filter(|&k| k <= last).map(|k| k * step);
    let largest = low.abs().max(high.abs());
    let (largest_power, step_power) = (largest.log10().floor(), (1.000_001 * step).log10().floor());
    let power = !PLAIN.contains(&largest);
    let digits = if power { largest_power - step_power } else { -step_power }.max(0.0) as usize;
    values.map(|value| (value, text(value, digits, power))).collect()
}

/// The number with so many digits after the decimal point, and with a power of ten if `power`.
fn text(value: f64, digits: usize, power: bool) -> String {
    let written = match power {
        true if value != 0.0 => format!("{value:.digits$e}"),
        true => "0".to_owned(),
        false => format!("{value:.digits$}"),
    };
    let is_zero = written.starts_with('-') && !written.contains(|c: char| ('1'..='9').contains(&c));
    if is_zero { written.replacen('-', "", 1) } else { written }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn written(scale: AxisScale, range: [f64; 2]) -> Vec<String> {
        axis_ticks(scale, range, 6).major.into_iter().map(|(_, text)| text).collect()
    }

    #[test]
    fn numbers_are_round_and_short() {
        let written = |range| written(AxisScale::Linear, range);
        assert_eq!(written([-1.04, 1.04]), ["-1.0", "-0.5", "0.0", "0.5", "1.0"]);
        assert_eq!(written([0.0, 103.0]), ["0", "20", "40", "60", "80", "100"]);
        assert_eq!(written([0.0071, 0.0089]), ["0.0075", "0.0080", "0.0085"]);
        assert_eq!(written([3.0, 3.004]), ["3.000", "3.001", "3.002", "3.003", "3.004"]);
        assert_eq!(written([-4.7e4, 4.8e4]), ["-40000", "-20000", "0", "20000", "40000"]);
        assert_eq!(written([-3e7, 3e7]), ["-2e7", "0", "2e7"]);
        assert_eq!(written([1e-6, 3.1e-6]), ["1.0e-6", "1.5e-6", "2.0e-6", "2.5e-6", "3.0e-6"]);
    }

    #[test]
    fn logarithmic_axis_has_decades_and_a_short_one_round_values() {
        assert_eq!(written(AxisScale::Log, [-2.1, 2.1]), ["0.01", "0.1", "1", "10", "100"]);
        assert_eq!(written(AxisScale::Log, [0.04, 0.12]), ["1.10", "1.15", "1.20", "1.25", "1.30"]);
        let short = axis_ticks(AxisScale::Log, [0.04, 0.12], 6).major;
        assert!((short[2].0 - 1.2f64.log10()).abs() < 1e-12, "{short:?}");
    }

    #[test]
    fn empty_range_has_no_ticks() {
        for range in [[1.0, 1.0], [2.0, 1.0], [f64::NAN, 1.0], [0.0, f64::INFINITY]] {
            for scale in [AxisScale::Linear, AxisScale::Log] {
                assert_eq!(axis_ticks(scale, range, 6).major, [], "{range:?}");
            }
        }
    }

    proptest! {
        #[test]
        fn there_are_some_but_not_too_many(low in -1e9..1e9f64, decades in -8..9i32, most in 4..12usize) {
            let range = [low, low + 10f64.powi(decades).max(1e-7 * low.abs())];
            let ticks = axis_ticks(AxisScale::Linear, range, most).major;
            prop_assert!((1..=most).contains(&ticks.len()), "{:?}", ticks);
            prop_assert!(ticks.windows(2).all(|pair| pair[0].0 < pair[1].0 && pair[0].1 != pair[1].1), "{:?}", ticks);
        }

        #[test]
        fn logarithmic_ticks_are_numbers_within_the_range(low in -99.0..99.0f64, span in 1e-3..200.0f64, most in 2..12usize) {
            let range = [low, low + span];
            for (value, text) in axis_ticks(AxisScale::Log, range, most).major {
                prop_assert!(range[0] - 1e-6 < value && value < range[1] + 1e-6, "{value} {text}");
            }
        }
    }
}
