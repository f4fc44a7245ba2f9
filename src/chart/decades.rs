//! Logarithmic axes: values in decades, and the ticks at them.

use std::borrow::Cow;
use std::ops::RangeInclusive;

use crate::{AxisScale, Chart, Layer, Mark};

/// Leading digits of ticks, the densest choice first.
const LEADS: [&[u32]; 4] = [&[1, 2, 3, 4, 5, 6, 7, 8, 9], &[1, 2, 5], &[1, 3], &[1]];

/// Widest axis whose ticks between decades are drawn, decades.
const WIDEST_WITH_MINOR: f64 = 8.0;

/// Values that a logarithmic axis shows: ratios of any two of them are numbers.
const SHOWN: RangeInclusive<f64> = 1e-99..=1e99;

/// Rounding of a place, decades.
const ROUNDING: f64 = 1e-9;

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

/// Ticks of a logarithmic axis.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct LogTicks {
    /// Places of the ticks with a number, in decades, ascending.
    pub major: Vec<f64>,
    /// Places of the lines between them, in decades.
    pub minor: Vec<f64>,
}

/// At most `most` ticks for an axis over `range`, in decades: at 1 to 9, 1-2-5 or 1-3 times a power of ten, at powers
/// of ten, or at every few of them. An axis too short for two of these has none; a linear scale suits it.
pub(crate) fn log_ticks(range: [f64; 2], most: usize) -> LogTicks {
    let [low, high] = range;
    let span = high - low;
    if !span.is_finite() || span <= 0.0 {
        return LogTicks::default();
    }
    let most = most.max(2);
    let within_decades = LEADS.into_iter().map(|leads| (leads, 1));
    let over_decades = (1..10).map(|k| (LEADS[3], 1 << k));
    let mut choices = within_decades.chain(over_decades).map(|(leads, every)| ticks_at(range, leads, every));
    let major = choices.find(|ticks| ticks.len() <= most).unwrap_or_default();
    if major.len() < 2 {
        return LogTicks::default();
    }
    let minor = if span <= WIDEST_WITH_MINOR { ticks_at(range, LEADS[0], 1) } else { Vec::new() };
    LogTicks { minor: minor.into_iter().filter(|place| !major.contains(place)).collect(), major }
}

/// Places of `leads` times powers of ten, of every so many of them, within `range`, in decades.
fn ticks_at([low, high]: [f64; 2], leads: &[u32], every: i32) -> Vec<f64> {
    // far more than can be drawn, and no cast overflows
    let powers = (low.max(-400.0).floor() as i32)..=((high.min(400.0) + ROUNDING).floor() as i32);
    let powers = powers.filter(|power| power.rem_euclid(every) == 0);
    let places = powers.flat_map(|power| leads.iter().map(move |&lead| f64::from(power) + f64::from(lead).log10()));
    places.filter(|&place| low - ROUNDING <= place && place <= high + ROUNDING).collect()
}

/// The number of a tick at `place`, in decades: `0.02`, `500`, `2e-7`.
pub(crate) fn log_tick_text(place: f64) -> String {
    let power = (place + ROUNDING).floor();
    let lead = 10f64.powf(place - power).round();
    if (-4.0..6.0).contains(&power) {
        let places = (-power).max(0.0) as usize;
        return format!("{:.places$}", lead * 10f64.powf(power));
    }
    format!("{lead:.0}e{power:.0}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Axis, Color};
    use proptest::prelude::*;

    fn numbers(range: [f64; 2], most: usize) -> Vec<String> {
        log_ticks(range.map(f64::log10), most).major.into_iter().map(log_tick_text).collect()
    }

    #[test]
    fn ticks_are_round_numbers_and_get_sparser_with_the_range() {
        assert_eq!(numbers([0.95, 9.5], 9), ["1", "2", "3", "4", "5", "6", "7", "8", "9"]);
        assert_eq!(numbers([0.02, 3.0], 9), ["0.02", "0.05", "0.1", "0.2", "0.5", "1", "2"]);
        assert_eq!(numbers([0.01, 100.0], 9), ["0.01", "0.03", "0.1", "0.3", "1", "3", "10", "30", "100"]);
        assert_eq!(numbers([1e-4, 1e4], 9).first().map(String::as_str), Some("0.0001"));
        assert_eq!(numbers([1e-9, 1e7], 5), ["1e-8", "0.0001", "1", "10000"]);
        assert!(numbers([1.1, 1.3], 9).is_empty(), "a linear scale suits it");
        let ticks = log_ticks([0.0, 3.0], 5);
        assert_eq!((ticks.major.len(), ticks.minor.len()), (4, 24));
        assert_eq!(log_ticks([0.0, 3.0 - 1e-12], 5), ticks, "a range that ends at a decade but for rounding");
    }

    #[test]
    fn nonpositive_values_are_gaps() {
        let line = Layer::new("", Mark::Line, Color::Blue, [[1.0, 10.0], [10.0, 0.0], [100.0, -3.0], [-1.0, 100.0]]);
        let mut chart = Chart::plot("a", "A", ["x", "y"], vec![line]);
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

    #[test]
    fn arrows_end_where_they_ended() {
        let arrow = Layer::new("", Mark::Arrows { vectors: vec![[90.0, 5.0]] }, Color::Blue, [[10.0, 1.0]]);
        let mut chart = Chart::plot("a", "A", ["x", "y"], vec![arrow]);
        chart.x = Axis::log("x");
        let Mark::Arrows { vectors } = &chart.in_decades().layers[0].mark else { panic!("an arrow") };
        assert_eq!(vectors, &[[1.0, 5.0]]);
    }

    proptest! {
        #[test]
        fn there_are_two_ticks_or_none_and_never_too_many(low in -40.0..40.0f64, span in 1e-3..60.0f64, most in 3..12usize) {
            let range = [low, low + span];
            let LogTicks { major, minor } = log_ticks(range, most);
            prop_assert!(major.len() != 1 && major.len() <= most, "{major:?}");
            prop_assert!(span < 1.0 || major.len() >= 2, "{major:?}");
            prop_assert!(major.windows(2).all(|pair| pair[0] < pair[1]));
            prop_assert!(major.iter().chain(&minor).all(|at| range[0] - 1e-6 < *at && *at < range[1] + 1e-6));
            let texts: std::collections::BTreeSet<String> = major.iter().map(|&at| log_tick_text(at)).collect();
            prop_assert_eq!(texts.len(), major.len());
        }
    }
}
