//! Colours and coordinates shared by all views.

use re_sdk_types::archetypes::{Arrows2D, LineStrips2D, Points2D};
use re_sdk_types::components::{Color, LineStrip2D, Radius};

use upm_chart::{Ground, Palette};
use upm_core::geometry::Vec2;
use upm_core::job::LayoutPart;
use upm_core::units::mm_from_m;

/// Red, green and blue.
pub(super) type Rgb = [u8; 3];

/// Colour of measurements.
pub(super) const MEASURED: Rgb = [80, 165, 255];
/// Colour of the ground truth.
pub(super) const TRUE: Rgb = [90, 225, 120];
/// Colour of the true outlines and trails of parts, which lie on the measured ones in the colour of their part.
pub(super) const TRUE_PART: Rgb = [250, 250, 250];
/// Colour of targets.
pub(super) const TARGET: Rgb = [255, 165, 40];
/// Colour of subgoals.
pub(super) const SUBGOAL: Rgb = [255, 225, 120];
/// Colour of predictions.
pub(super) const PREDICTED: Rgb = [200, 130, 255];
/// Colour of chosen centres of rotation.
pub(super) const CENTER: Rgb = [255, 80, 110];
/// Colour of the background.
pub(super) const FAINT: Rgb = [135, 140, 155];

/// Colours of numbered items.
const SERIES: [Rgb; 8] = [MEASURED, TARGET, TRUE, CENTER, PREDICTED, SUBGOAL, [90, 220, 220], [200, 200, 200]];

pub(super) fn color([r, g, b]: Rgb) -> Color {
    Color::from_rgb(r, g, b)
}

/// Colours of the parts of a job and of their kinds.
pub(super) fn palette(parts: &[LayoutPart]) -> Palette {
    Palette::of(&parts.iter().map(|part| part.kind.as_str()).collect::<Vec<_>>(), Ground::Dark)
}

pub(super) fn colors(rgb: &[Rgb]) -> Vec<Color> {
    rgb.iter().copied().map(color).collect()
}

/// Colours of `count` series, repeated as needed.
pub(super) fn series(count: usize) -> Vec<Color> {
    SERIES.into_iter().cycle().take(count).map(color).collect()
}

/// Radius (half the width) of a line whose width is constant at any zoom, in points of the screen.
pub(super) fn thin(points: f32) -> Radius {
    Radius::new_ui_points(points)
}

/// A point of the table in the view from above, mm.
pub(super) fn above(p_m: Vec2) -> [f32; 2] {
    [mm_from_m(p_m.x) as f32, mm_from_m(p_m.y) as f32]
}

/// A point of a frame (px) in a 2D view of that frame at half its size, where pixel (0, 0) covers the square from 0 to
/// 1.
pub(super) fn in_half_frame(p_px: Vec2) -> [f32; 2] {
    [p_px.x, p_px.y].map(|px| (px as f32 + 0.5) / 2.0)
}

/// The names of `parts` in these colours, without their places.
pub(super) fn names(parts: &[LayoutPart], colors: Vec<Color>) -> Points2D {
    Points2D::update_fields()
        .with_labels(parts.iter().map(|part| part.id.as_str()))
        .with_show_labels(true)
        .with_colors(colors)
        .with_radii([thin(0.1)])
}

/// The lowest point of a disc, from which the viewer hangs its name. Where y is up, the radius is negative.
pub(super) fn below(([x, y], radius): ([f32; 2], f32)) -> [f32; 2] {
    [x, y + radius]
}

/// Dots of one colour; like all widths here the radius is in points of the screen.
pub(super) fn dots(places: impl IntoIterator<Item = [f32; 2]>, paint: Rgb, points: f32) -> Points2D {
    Points2D::new(places).with_colors([color(paint)]).with_radii([thin(points)])
}

/// Lines of one colour.
pub(super) fn lines(strips: impl IntoIterator<Item = impl Into<LineStrip2D>>, paint: Rgb, points: f32) -> LineStrips2D {
    LineStrips2D::new(strips).with_colors([color(paint)]).with_radii([thin(points)])
}

/// Arrows of one colour, each from its first point to its second.
pub(super) fn arrows(ends: impl IntoIterator<Item = [[f32; 2]; 2]>, paint: Rgb, points: f32) -> Arrows2D {
    let (origins, vectors): (Vec<_>, Vec<_>) =
        ends.into_iter().map(|[[x0, y0], [x1, y1]]| ([x0, y0], [x1 - x0, y1 - y0])).unzip();
    Arrows2D::from_vectors(vectors).with_origins(origins).with_colors([color(paint)]).with_radii([thin(points)])
}
