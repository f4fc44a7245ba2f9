use std::f64::consts::TAU;

use plotters::element::DashedPathElement;
use plotters::prelude::*;
use plotters::style::Color as _;
use plotters::style::text_anchor::HPos;

use super::clip;
use super::range::drawable;
use super::sheet::{DrawResult, FINE, Sheet, fine, font, paint, plain_text, text_width_px};
use crate::{Color, LabelledDisc, Layer, Mark, place_labels};

/// Width of lines, px.
const LINE_PX: f64 = 1.8;
/// Width of outlines, crosses and arrows, px.
const THIN_PX: f64 = 1.3;
const DOT_PX: f64 = 2.6;
/// Half the size of a cross, px.
const CROSS_PX: f64 = 4.0;
/// Dash and the gap after it, px.
const DASH_PX: [f64; 2] = [8.0, 5.0];
/// Largest head of an arrow: px, and as a share of the arrow.
const HEAD_PX: f64 = 9.0;
const HEAD: f64 = 0.45;
/// Half the width of a head over its length.
const HEAD_WIDTH: f64 = 0.42;
/// Number of corners of the polygon that draws a circle.
const CORNERS: u32 = 72;
/// Overlap of a cell with its neighbours to the right and below, px, so that no seam shows between them.
const UNDERLAP_PX: f64 = 0.5;
/// Size of text beside points, px.
const WORD_PX: f64 = 13.0;
/// Distance of the text from its point: across to its end, and up or down to its middle, px.
const BESIDE_PX: [f64; 2] = [9.0, 10.0];
/// Factor by which text is darker than marks, so that it is legible over lines.
const DARKER: f64 = 0.7;
/// Share of the full colour at value 0.
const LIGHTEST: f64 = 0.06;

/// Place on the sheet, in the backend's pixels.
pub(super) type Px = (i32, i32);

/// Place of a plot on the sheet, and its ranges.
#[derive(Clone, Copy, Debug)]
pub(super) struct PlotFrame {
    /// Ranges of x and y.
    pub x: [f64; 2],
    pub y: [f64; 2],
    /// Pixels of the left and right, and of the upper and lower rim.
    pub across: [i32; 2],
    pub down: [i32; 2],
}

impl PlotFrame {
    fn px(&self, [x, y]: [f64; 2]) -> Px {
        let part = |value: f64, [low, high]: [f64; 2]| (value - low) / (high - low);
        let along = |part: f64, [from, to]: [i32; 2]| from + (part * f64::from(to - from)).round() as i32;
        (along(part(x, self.x), self.across), along(1.0 - part(y, self.y), self.down))
    }

    fn holds(&self, [x, y]: [f64; 2]) -> bool {
        (self.x[0]..=self.x[1]).contains(&x) && (self.y[0]..=self.y[1]).contains(&y)
    }

    fn runs(&self, points: impl IntoIterator<Item = [f64; 2]>) -> Vec<Vec<Px>> {
        let px = |run: Vec<[f64; 2]>| run.into_iter().map(|point| self.px(point)).collect();
        clip::runs(points, self.x, self.y, drawable).into_iter().map(px).collect()
    }

    /// Upper left and lower right corner of the part of a square that is within the frame.
    fn square(&self, center: [f64; 2], half: f64) -> Option<[Px; 2]> {
        if !center.iter().chain([&half]).all(|&value| drawable(value)) {
            return None;
        }
        let within = |axis: usize, [low, high]: [f64; 2]| {
            let (from, to) = ((center[axis] - half).max(low), (center[axis] + half).min(high));
            (from < to).then_some([from, to])
        };
        let ([left, right], [bottom, top]) = (within(0, self.x)?, within(1, self.y)?);
        Some([self.px([left, top]), self.px([right, bottom])])
    }

    /// Whether the sides right of point `i` and above it are free of the lines to its neighbours.
    fn free_side(&self, points: &[[f64; 2]], i: usize) -> [bool; 2] {
        const EVEN: f64 = 1e-6;
        let length = |[from, to]: [i32; 2], [low, high]: [f64; 2]| f64::from((to - from).abs()) / (high - low);
        let scale = [length(self.across, self.x), length(self.down, self.y)];
        let neighbours = [i.checked_sub(1), Some(i + 1)].into_iter().flatten().filter_map(|k| points.get(k));
        let away = neighbours
            .map(|other| [0, 1].map(|axis| scale[axis] * (points[i][axis] - other[axis])))
            .map(|[x, y]| [x / x.hypot(y), y / x.hypot(y)])
            .filter(|[x, y]| x.is_finite() && y.is_finite())
            .fold([0.0; 2], |[x, y], [along_x, along_y]| [x + along_x, y + along_y]);
        away.map(|along| along > -EVEN)
    }
}

/// Draws the part of `layer` that is within the frame.
pub(super) fn draw(layer: &Layer, frame: &PlotFrame, sheet: &Sheet<'_>) -> DrawResult {
    let Layer { points, mark, color, .. } = layer;
    let seen = || points.iter().copied().filter(|&point| frame.holds(point)).map(|point| frame.px(point));
    match mark {
        Mark::Line => frame.runs(points.iter().copied()).into_iter().try_for_each(|run| line(sheet, run, *color)),
        Mark::Dashes => frame.runs(points.iter().copied()).iter().try_for_each(|run| dashes(sheet, run, *color)),
        Mark::Dots => seen().try_for_each(|at| dot(sheet, at, *color)),
        Mark::Crosses => seen().try_for_each(|at| cross(sheet, at, *color)),
        Mark::Circles { radius } => {
            let outlines = points.iter().flat_map(|&center| frame.runs(outline(center, radius.abs())));
            outlines.into_iter().try_for_each(|run| thin_line(sheet, run, *color))
        }
        Mark::Arrows { vectors } => points.iter().zip(vectors).try_for_each(|(&from, &vector)| {
            let to = [from[0] + vector[0], from[1] + vector[1]];
            match frame.runs([from, to]).first().map(Vec::as_slice) {
                Some(&[from_px, to_px]) => arrow(sheet, from_px, to_px, frame.holds(to), *color),
                _ => Ok(()),
            }
        }),
        Mark::Cells { side, values } => {
            points.iter().zip(values).try_for_each(|(&center, &value)| match frame.square(center, 0.5 * side.abs()) {
                Some(corners) if !value.is_nan() => cell(sheet, corners, value, *color),
                _ => Ok(()),
            })
        }
        Mark::Names { texts, radii, colors } => names(sheet, frame, points, (texts, radii, colors)),
        Mark::Labels { texts } => points.iter().zip(texts).enumerate().try_for_each(|(i, (&point, text))| {
            if !frame.holds(point) {
                return Ok(());
            }
            beside(sheet, frame, (frame.px(point), frame.free_side(points, i)), text, *color)
        }),
    }
}

fn outline(center: [f64; 2], radius: f64) -> impl Iterator<Item = [f64; 2]> {
    (0..=CORNERS).map(move |k| {
        let (sin, cos) = (TAU * f64::from(k % CORNERS) / f64::from(CORNERS)).sin_cos();
        [center[0] + radius * cos, center[1] + radius * sin]
    })
}

pub(super) fn line(sheet: &Sheet<'_>, run: Vec<Px>, color: Color) -> DrawResult {
    sheet.draw(&PathElement::new(run, paint(color).stroke_width(fine(LINE_PX) as u32)))
}

fn thin_line(sheet: &Sheet<'_>, run: Vec<Px>, color: Color) -> DrawResult {
    sheet.draw(&PathElement::new(run, paint(color).stroke_width(fine(THIN_PX) as u32)))
}

pub(super) fn dashes(sheet: &Sheet<'_>, run: &[Px], color: Color) -> DrawResult {
    let (run, [on, off]) = (run.to_vec(), DASH_PX.map(fine));
    sheet.draw(&DashedPathElement::new(run, on, off, paint(color).stroke_width(fine(LINE_PX) as u32)))
}

pub(super) fn dot(sheet: &Sheet<'_>, at: Px, color: Color) -> DrawResult {
    sheet.draw(&Circle::new(at, fine(DOT_PX), paint(color).filled()))
}

pub(super) fn cross(sheet: &Sheet<'_>, at: Px, color: Color) -> DrawResult {
    sheet.draw(&Cross::new(at, fine(CROSS_PX), paint(color).stroke_width(fine(THIN_PX) as u32)))
}

/// A shaft, with a head where the arrow ends within the plot.
pub(super) fn arrow(sheet: &Sheet<'_>, from: Px, to: Px, ends_here: bool, color: Color) -> DrawResult {
    let (x, y) = (f64::from(to.0 - from.0), f64::from(to.1 - from.1));
    let length = x.hypot(y);
    if length < 1.0 {
        return Ok(());
    }
    if !ends_here {
        return thin_line(sheet, vec![from, to], color);
    }
    let (along_x, along_y) = (x / length, y / length);
    let head = (FINE * HEAD_PX).min(HEAD * length);
    let corner = |side: f64| {
        let across = side * HEAD_WIDTH * head;
        let place = (-along_x * head - along_y * across, -along_y * head + along_x * across);
        (to.0 + place.0.round() as i32, to.1 + place.1.round() as i32)
    };
    thin_line(sheet, vec![from, corner(0.0)], color)?;
    sheet.draw(&Polygon::new(vec![to, corner(1.0), corner(-1.0)], paint(color)))
}

/// Draws names beside their discs. A name of a point outside the plot is left out.
fn names(
    sheet: &Sheet<'_>,
    frame: &PlotFrame,
    points: &[[f64; 2]],
    (texts, radii, colors): (&[String], &[f64], &[Color]),
) -> DrawResult {
    let px_per_unit = f64::from((frame.across[1] - frame.across[0]).abs()) / (frame.x[1] - frame.x[0]);
    let given = points.iter().zip(texts).zip(radii).zip(colors).filter(|(((point, _), _), _)| frame.holds(**point));
    let (discs, words): (Vec<LabelledDisc>, Vec<(&String, Color)>) = given
        .map(|(((&point, text), radius), &color)| {
            let (x, y) = frame.px(point);
            let half = [0.5 * text_width_px(text, WORD_PX), 0.65 * WORD_PX].map(|px| FINE * px);
            let radius = if drawable(*radius) { radius.abs() * px_per_unit } else { 0.0 };
            (LabelledDisc { center: [f64::from(x), f64::from(y)], radius, half }, (text, color))
        })
        .unzip();
    let bounds = [frame.across, frame.down].map(|[from, to]| [f64::from(from.min(to)), f64::from(from.max(to))]);
    place_labels(&discs, bounds, &[]).iter().zip(words).try_for_each(|(place, (text, color))| {
        let [x, y] = place.center.map(|along| along.round() as i32);
        word(sheet, (x, y), HPos::Center, text, color)
    })
}

/// Draws text beside a point, on its right and above where `free` says so; omitted where it would leave the plot.
fn beside(
    sheet: &Sheet<'_>,
    frame: &PlotFrame,
    ((x, y), free): (Px, [bool; 2]),
    words: &str,
    color: Color,
) -> DrawResult {
    let [across, up] = BESIDE_PX.map(fine);
    let wide = across + fine(text_width_px(words, WORD_PX));
    let [left, right] = frame.across;
    let at_right = if free[0] { x + wide <= right } else { x - wide < left };
    let (x, pos) = if at_right { (x + across, HPos::Left) } else { (x - across, HPos::Right) };
    word(sheet, (x, if free[1] { y - up } else { y + up }), pos, words, color)
}

pub(super) fn word(sheet: &Sheet<'_>, at: Px, pos: HPos, words: &str, color: Color) -> DrawResult {
    let [r, g, b] = color.rgb().map(|part| (DARKER * f64::from(part)) as u8);
    sheet.draw(&Text::new(plain_text(words), at, font(WORD_PX, pos).color(&RGBColor(r, g, b))))
}

pub(super) fn circle(sheet: &Sheet<'_>, at: Px, radius: i32, color: Color) -> DrawResult {
    sheet.draw(&Circle::new(at, radius, paint(color).stroke_width(fine(THIN_PX) as u32)))
}

pub(super) fn cell(sheet: &Sheet<'_>, [upper_left, (right, bottom)]: [Px; 2], value: f64, color: Color) -> DrawResult {
    let share = LIGHTEST + (1.0 - LIGHTEST) * value.clamp(0.0, 1.0);
    let [r, g, b] = color.rgb().map(|full| (255.0 + share * (f64::from(full) - 255.0)).round() as u8);
    let lower_right = (right + fine(UNDERLAP_PX), bottom + fine(UNDERLAP_PX));
    sheet.draw(&Rectangle::new([upper_left, lower_right], RGBColor(r, g, b).filled()))
}
