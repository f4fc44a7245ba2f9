//! Logarithmic axes: values in decades. Numbers at the ticks of axes.

use std::borrow::Cow;
use std::ops::{Range, RangeInclusive};

use crate::{AxisScale, Chart, Layer, Mark};

/// Magnitudes of numbers that are written without a power of ten.
const PLAIN: Range<f64> = 1e-4..1e6;

/// Values that a logarithmic axis shows: ratios of any two of them are numbers.
const SHOWN: RangeInclusive<f64> = 1e-99..=1e99;

impl Chart {
    /// The chart with base-10 logarithms in place of the values of its logarithmic axes. Values that are not positive,
    /// or outside 1e-99 to 1e99, become NaN, a gap. Radii and sides are lengths in decades there.
    pub(crate) fn in_decades(&self) -> Cow<'_, Self> {
        let is_log = [&self.x, &self.y].map(|axis| axis.scale == AxisScale::Log);
        if is_log == [false; 2] {
            return Cow::Borrowed(self);
        }
        let mut chart = self.clone();
        for axis in [&mut chart.x, &mut chart.y].into_iter().filter(|axis| axis.scale == AxisScale::Log) {
            let ends = axis.range.map(|ends| ends.map(decades));
            axis.range = ends.filter(|ends| ends.iter().all(|end| end.is_finite()));
        }
        chart.layers.iter_mut().for_each(|layer| layer_in_decades(layer, is_log));
        Cow::Owned(chart)
    }
}

fn layer_in_decades(layer: &mut Layer, is_log: [bool; 2]) {
    let mapped = |point: [f64; 2]| [0, 1].map(|axis| if is_log[axis] { decades(point[axis]) } else { point[axis] });
    if let Mark::Arrows { vectors } = &mut layer.mark {
        for (vector, from) in vectors.iter_mut().zip(&layer.points) {
            let (to, from) = (mapped([from[0] + vector[0], from[1] + vector[1]]), mapped(*from));
            *vector = [to[0] - from[0], to[1] - from[1]];
        }
    }
    layer.points.iter_mut().for_each(|point| *point = mapped(*point));
}

/// Base-10 logarithm of `value`; NaN for values that are not positive, or outside [`SHOWN`].
fn decades(value: f64) -> f64 {
    if SHOWN.contains(&value) { value.log10() } else { f64::NAN }
}

/// The number at a tick, without rounding errors; `value` is in decades on a logarithmic axis, where two digits are
/// enough.
pub(crate) fn tick_text(scale: AxisScale, value: f64) -> String {
    let text = match scale {
        AxisScale::Linear => format!("{value:.11e}"),
        AxisScale::Log => format!("{:.1e}", 10f64.powf(value)),
    };
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
        let linear = [-0.0, 0.1 + 0.2, -47.0, 0.002_5, 2.5e6, -1e-6].map(|value| tick_text(AxisScale::Linear, value));
        assert_eq!(linear, ["0", "0.3", "-47", "0.0025", "2.5e6", "-1e-6"]);
        let log = [-2.0, -0.5, 0.0, 0.3, 5.0, 6.0].map(|value| tick_text(AxisScale::Log, value));
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
