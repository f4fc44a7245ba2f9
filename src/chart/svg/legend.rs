use super::marks;
use super::text::{LABEL_PX, text, text_lines, text_width_px};
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
pub(super) struct Legend {
    items: Vec<Item>,
    rows: usize,
}

struct Item {
    /// The label; more than one line where it is longer than the picture is wide.
    lines: Vec<String>,
    layer: Layer,
    row: usize,
    left_px: f64,
}

impl Legend {
    /// Labels of `layers` that have one, in rows of `width_px`.
    pub fn of(layers: &[Layer], width_px: f64) -> Self {
        let (mut row, mut rows, mut left_px) = (0, 0, 0.0);
        let mut items: Vec<Item> = Vec::new();
        for layer in layers {
            let lines = text_lines(&layer.label, LABEL_PX, width_px - SAMPLE_PX - GAP_PX);
            if lines.is_empty() {
                continue;
            }
            let longest_px = lines.iter().map(|line| text_width_px(line, LABEL_PX)).fold(0.0, f64::max);
            let wide_px = SAMPLE_PX + GAP_PX + longest_px;
            if left_px > 0.0 && left_px + wide_px > width_px {
                (row, left_px) = (rows, 0.0);
            }
            rows = rows.max(row + lines.len());
            items.push(Item { lines, layer: Layer { points: Vec::new(), ..layer.clone() }, row, left_px });
            left_px += wide_px + APART_PX;
        }
        Self { items, rows }
    }

    /// Height of all its rows, px.
    pub fn height_px(&self) -> f64 {
        ROW_PX * self.rows as f64
    }

    /// The legend with its upper left corner at `left_px`, `top_px`.
    pub fn draw(&self, [left_px, top_px]: [f64; 2]) -> String {
        let middle = |row: usize| top_px + ROW_PX * (row as f64 + 0.5);
        let item = |item: &Item| {
            let left_px = left_px + item.left_px;
            let label = |(i, line): (usize, &String)| {
                text([left_px + SAMPLE_PX + GAP_PX, middle(item.row + i)], LABEL_PX, "start", "", line)
            };
            let labels: String = item.lines.iter().enumerate().map(label).collect();
            sample(&item.layer, [left_px, left_px + SAMPLE_PX], middle(item.row)) + &labels
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
