use std::ops::Range;

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};

use super::sheet::text_width_px;
use crate::AxisScale;
use crate::ticks::{AxisTicks, axis_ticks};

/// The scale of an axis: its range and ticks, in decades on a logarithmic axis.
#[derive(Clone, Debug)]
pub(super) struct Scale {
    /// Range of the axis, from and to.
    pub range: [f64; 2],
    ticks: AxisTicks,
}

impl Scale {
    /// The scale of an axis over `range`, which is not empty, with at most `most` ticks.
    pub fn of(axis: AxisScale, range: [f64; 2], most: usize) -> Self {
        Self { range, ticks: axis_ticks(axis, range, most) }
    }

    /// Width of the longest tick label, px, in letters of size `size_px`.
    pub fn width_px(&self, size_px: f64) -> f64 {
        self.ticks.major.iter().map(|(_, text)| text_width_px(text, size_px)).fold(0.0, f64::max)
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
        let AxisTicks { major, minor } = &self.ticks;
        if hint.weight().allow_light_points() { minor.clone() } else { major.iter().map(|(value, _)| *value).collect() }
    }

    fn range(&self) -> Range<f64> {
        self.range[0]..self.range[1]
    }
}

impl ValueFormatter<f64> for Scale {
    /// The text of the tick at `value`; empty between ticks.
    fn format_ext(&self, value: &f64) -> String {
        let tick = self.ticks.major.iter().find(|(at, _)| at == value);
        tick.map(|(_, text)| text.clone()).unwrap_or_default()
    }
}
