//! Logarithmic axes: values in decades. Numbers at the ticks of axes.

use std::borrow::Cow;
use std::ops::{Range, RangeInclusive};

use crate::Chart;

/// Magnitudes of numbers that are written without a power of ten.
const PLAIN: Range<f64> = 1e-4..1e6;

/// Values that a logarithmic axis shows: ratios of any two of them are numbers.
const SHOWN: RangeInclusive<f64> = 1e-99..=1e99;

impl Chart {
    /// The chart with base-10 logarithms in place of the values of its logarithmic axes. Values that are not positive,
    /// or outside 1e-99 to 1e99, become NaN, a gap. Radii, sides and arrows are lengths in decades there.
    pub(crate) fn in_decades(&self) -> Cow<'_, Self> {
        let is_log = [self.x.is_log, self.y.is_log];
        if is_log == [false; 2] {
            return Cow::Borrowed(self);
        }
        let mut chart = self.clone();
        for axis in [&mut chart.x, &mut chart.y].into_iter().filter(|axis| axis.is_log) {
            let ends = axis.range.map(|ends| ends.map(decades));
            axis.range = ends.filter(|ends| ends.iter().all(|end| end.is_finite()));
        }
        let mapped = |point: [f64; 2]| [0, 1].map(|i| if is_log[i] { decades(point[i]) } else { point[i] });
        chart.layers.iter_mut().flat_map(|layer| &mut layer.points).for_each(|point| *point = mapped(*point));
        Cow::Owned(chart)
    }
}

/// Base-10 logarithm of `value`; NaN for values that are not positive, or outside [`SHOWN`].
fn decades(value: f64) -> f64 {
    if SHOWN.contains(&value) { value.log10() } else { f64::NAN }
}

/// The number at a tick, without rounding errors; `value` is in decades on a logarithmic axis, where two digits are
/// enough.
pub(crate) fn tick_text(is_log: bool, value: f64) -> String {
    let text = if is_log { format!("{:.1e}", 10f64.powf(value)) } else { format!("{value:.11e}") };
    let value: f64 = text.parse().unwrap_or(value);
    let is_plain = value == 0.0 || PLAIN.contains(&value.abs());
    if is_plain { format!("{}", value + 0.0) } else { format!("{value:e}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Axis, Color};

    #[test]
    fn ticks_have_short_numbers() {
        let linear = [-0.0, 0.1 + 0.2, -47.0, 0.002_5, 2.5e6, -1e-6].map(|value| tick_text(false, value));
        assert_eq!(linear, ["0", "0.3", "-47", "0.0025", "2.5e6", "-1e-6"]);
        let log = [-2.0, -0.5, 0.0, 0.3, 5.0, 6.0].map(|value| tick_text(true, value));
        assert_eq!(log, ["0.01", "0.32", "1", "2", "100000", "1e6"]);
    }

    #[test]
    fn nonpositive_values_are_gaps() {
        let points = [[1.0, 10.0], [10.0, 0.0], [100.0, -3.0], [-1.0, 100.0]];
        let mut chart = Chart::plot("a", "A", ["x", "y"]).line("", Color::Blue, points);
        assert!(matches!(chart.in_decades(), Cow::Borrowed(_)));
        chart.y = Axis { range: Some([0.0, 5.0]), ..Axis::log("y") };
        let shown = chart.in_decades();
        assert_eq!(shown.y.range, None, "zero is on no logarithmic axis");
        let y: Vec<f64> = shown.layers[0].points.iter().map(|point| point[1]).collect();
        assert!(y[0] == 1.0 && y[1].is_nan() && y[2].is_nan() && y[3] == 2.0, "{y:?}");
        assert_eq!(shown.layers[0].points[3][0], -1.0, "the other axis is linear");
        chart.layers[0].points = [1e-100, 1e-99, 1e99, 1e100, f64::INFINITY].map(|value| [1.0, value]).to_vec();
        let y: Vec<f64> = chart.in_decades().layers[0].points.iter().map(|point| point[1]).collect();
        assert!(y[0].is_nan() && y[1] == -99.0 && y[2] == 99.0 && y[3].is_nan() && y[4].is_nan(), "{y:?}");
    }
}
