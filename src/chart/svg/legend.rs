use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::marks::{self, Px};
use super::sheet::{DrawResult, LABEL_PX, Sheet, fine, font, text_lines, text_width_px};
use crate::{Color, Layer, Mark};

const ROW_PX: f64 = 22.0;
/// Width of a sample of a mark, px.
const SAMPLE_PX: f64 = 30.0;
/// Gap from a sample to its label, px.
const GAP_PX: f64 = 7.0;
/// Gap from one label to the next sample, px.
const APART_PX: f64 = 20.0;

/// Legend: samples and labels of the marks in rows below the plot.
#[derive(Clone, Debug)]
pub(super) struct Legend {
    items: Vec<Item>,
    rows: usize,
}

#[derive(Clone, Debug)]
struct Item {
    /// The label; more than one line where it is longer than the picture is wide.
    lines: Vec<String>,
    mark: Mark,
    color: Color,
    row: usize,
    left_px: f64,
}

impl Legend {
    /// Labels of `layers` that have one, in rows of `width_px`.
    pub fn of(layers: &[Layer], width_px: f64) -> Self {
        let (mut row, mut left_px) = (0, 0.0);
        let mut items: Vec<Item> = Vec::new();
        for Layer { label, mark, color, .. } in layers {
            let lines = text_lines(label, LABEL_PX, width_px - SAMPLE_PX - GAP_PX);
            if lines.is_empty() {
                continue;
            }
            let longest_px = lines.iter().map(|line| text_width_px(line, LABEL_PX)).fold(0.0, f64::max);
            let wide_px = SAMPLE_PX + GAP_PX + longest_px;
            if left_px > 0.0 && left_px + wide_px > width_px {
                (row, left_px) = (next_row(&items), 0.0);
            }
            items.push(Item { lines, mark: mark.clone(), color: *color, row, left_px });
            left_px += wide_px + APART_PX;
        }
        let rows = next_row(&items);
        Self { items, rows }
    }

    /// Height of all its rows, px.
    pub fn height_px(&self) -> f64 {
        ROW_PX * self.rows as f64
    }

    /// Draws it with its upper left corner at `left_px`, `top_px`.
    pub fn draw(&self, sheet: &Sheet<'_>, left_px: f64, top_px: f64) -> DrawResult {
        for item in &self.items {
            let left_px = left_px + item.left_px;
            let middle = |row: usize| fine(top_px + ROW_PX * (row as f64 + 0.5));
            sample(sheet, &item.mark, item.color, [fine(left_px), fine(left_px + SAMPLE_PX)], middle(item.row))?;
            for (i, line) in item.lines.iter().enumerate() {
                let at = (fine(left_px + SAMPLE_PX + GAP_PX), middle(item.row + i));
                sheet.draw(&Text::new(line.clone(), at, font(LABEL_PX, HPos::Left)))?;
            }
        }
        Ok(())
    }
}

/// Number of the first row without an item.
fn next_row(items: &[Item]) -> usize {
    items.iter().map(|item| item.row + item.lines.len()).max().unwrap_or(0)
}

/// Draws a sample of a layer's marks between `left` and `right`.
fn sample(sheet: &Sheet<'_>, mark: &Mark, color: Color, [left, right]: [i32; 2], y: i32) -> DrawResult {
    let center: Px = ((left + right) / 2, y);
    match mark {
        Mark::Line => marks::line(sheet, vec![(left, y), (right, y)], color),
        Mark::Dashes => marks::dashes(sheet, &[(left, y), (right, y)], color),
        Mark::Dots => marks::dot(sheet, center, color),
        Mark::Crosses => marks::cross(sheet, center, color),
        Mark::Circles { .. } => marks::circle(sheet, center, fine(6.0), color),
        Mark::Arrows { .. } => marks::arrow(sheet, (left, y), (right, y), true, color),
        Mark::Cells { .. } => [0.0, 0.5, 1.0].iter().enumerate().try_for_each(|(i, &value)| {
            let (side, from) = ((right - left) / 3, left + (right - left) / 3 * i as i32);
            marks::cell(sheet, [(from, y - side / 2), (from + side, y + side / 2)], value, color)
        }),
        Mark::Labels { texts } | Mark::Names { texts, .. } => {
            texts.first().map_or(Ok(()), |text| marks::word(sheet, center, HPos::Center, text, color))
        }
    }
}
