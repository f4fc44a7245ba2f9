use super::marks;
use super::text::{LABEL_PX, text, text_width_px};
use crate::{Layer, Mark};

const ROW_PX: f64 = 22.0;
/// Width of a sample of a mark, px.
const SAMPLE_PX: f64 = 30.0;
/// Gap from a sample to its label, px.
const GAP_PX: f64 = 7.0;
/// Gap from one label to the next sample, px.
const APART_PX: f64 = 20.0;
/// Radius of a sample of circles, px.
const CIRCLE_PX: f64 = 6.0;

/// Legend: samples and labels of the marks in rows below the plot.
pub(super) struct Legend<'a> {
    /// Layers with a label, each with the upper left corner of its item, px.
    items: Vec<(&'a Layer, [f64; 2])>,
}

impl<'a> Legend<'a> {
    /// Labels of `layers` that have one, in rows of `width_px`.
    pub fn of(layers: &'a [Layer], width_px: f64) -> Self {
        let (mut items, mut left_px, mut top_px) = (Vec::new(), 0.0, 0.0);
        for layer in layers.iter().filter(|layer| !layer.label.is_empty()) {
            let wide_px = SAMPLE_PX + GAP_PX + text_width_px(&layer.label, LABEL_PX);
            if left_px > 0.0 && left_px + wide_px > width_px {
                (left_px, top_px) = (0.0, top_px + ROW_PX);
            }
            items.push((layer, [left_px, top_px]));
            left_px += wide_px + APART_PX;
        }
        Self { items }
    }

    /// Height of all its rows, px.
    pub fn height_px(&self) -> f64 {
        self.items.last().map_or(0.0, |(_, [_, top_px])| top_px + ROW_PX)
    }

    /// The legend with its upper left corner at `left_px`, `top_px`.
    pub fn draw(&self, [left_px, top_px]: [f64; 2]) -> String {
        let item = |(layer, [x, y]): &(&Layer, [f64; 2])| {
            let (left_px, middle_px) = (left_px + x, top_px + y + 0.5 * ROW_PX);
            let label = text([left_px + SAMPLE_PX + GAP_PX, middle_px], LABEL_PX, "start", "", &layer.label);
            sample(layer, [left_px, left_px + SAMPLE_PX], middle_px) + &label
        };
        self.items.iter().map(item).collect()
    }
}

/// A sample of a layer's marks between `left` and `right`.
fn sample(&Layer { ref mark, color, .. }: &Layer, [left, right]: [f64; 2], y: f64) -> String {
    let (ends, center) = ([[left, y], [right, y]], [0.5 * (left + right), y]);
    match mark {
        Mark::Line | Mark::Dashes => marks::line(ends, *mark == Mark::Dashes, color),
        Mark::Dots => marks::dot(center, color),
        Mark::Crosses => marks::cross(center, color),
        Mark::Circles { .. } => marks::ellipse(center, [CIRCLE_PX; 2], color),
        Mark::Arrows { .. } => marks::arrow(ends, color),
        Mark::Cells { .. } => {
            let half = (right - left) / 6.0;
            let cell = |i: u8| {
                let middle = left + half * f64::from(2 * i + 1);
                marks::cell([middle - half, y - half], [2.0 * half; 2], 0.5 * f64::from(i), color)
            };
            (0..3).map(cell).collect()
        }
        Mark::Labels { texts } | Mark::Names { texts, .. } => {
            texts.first().map_or_else(String::new, |text| marks::word(center, "middle", text, color))
        }
    }
}
