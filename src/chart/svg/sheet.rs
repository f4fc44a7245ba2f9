//! The drawing surface: its pixels, colours and fonts.

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::Color;

/// Factor by which the drawing is enlarged: the backend knows whole pixels only, and the document is shown smaller.
pub(super) const FINE: f64 = 10.0;
/// Size of the title, of labels and of the numbers on the axes, px.
pub(super) const TITLE_PX: f64 = 18.0;
pub(super) const LABEL_PX: f64 = 14.0;
pub(super) const TICK_PX: f64 = 12.5;
/// Mean width of a letter, in letter sizes; a generous estimate for common fonts.
const LETTER: f64 = 0.58;

/// The drawing surface.
pub(super) type Sheet<'a> = DrawingArea<SVGBackend<'a>, Shift>;
/// Result of drawing, with the backend's error.
pub(super) type DrawResult = Result<(), DrawingAreaErrorKind<std::io::Error>>;

/// The backend's pixels for `px` of the picture.
pub(super) fn fine(px: f64) -> i32 {
    (FINE * px).round() as i32
}

pub(super) fn paint(color: Color) -> RGBColor {
    let [r, g, b] = color.rgb();
    RGBColor(r, g, b)
}

/// Text style with letters of size `px`, placed to the right of a point or centred on it.
pub(super) fn font(px: f64, pos: HPos) -> TextStyle<'static> {
    // the backend writes letter sizes smaller by a factor of 1.24
    TextStyle::from(("sans-serif", 1.24 * FINE * px)).color(&BLACK).pos(Pos::new(pos, VPos::Center))
}

/// Estimated width of `text` in letters of size `size_px`, px.
pub(super) fn text_width_px(text: &str, size_px: f64) -> f64 {
    LETTER * size_px * text.chars().count() as f64
}

/// The text on one line, without characters that are illegal in a document.
pub(super) fn plain_text(text: &str) -> String {
    let allowed = |c: char| !c.is_control() && !('\u{fffe}'..='\u{ffff}').contains(&c);
    text.chars().map(|c| if c.is_whitespace() { ' ' } else { c }).filter(|&c| allowed(c)).collect()
}

/// The text broken between words into lines of at most `width` px; longer words get a line to themselves.
pub(super) fn text_lines(text: &str, size_px: f64, width: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in plain_text(text).split(' ').filter(|word| !word.is_empty()) {
        match lines.last_mut() {
            Some(line) if text_width_px(line, size_px) + text_width_px(word, size_px) + LETTER * size_px <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}
