//! Colours and coordinates that every view shares.

use rerun::{Color, Points2D, Radius};

use upm_core::geometry::Vec2;
use upm_core::units::mm_from_m;

/// What was measured.
pub(super) const MEASURED: (u8, u8, u8) = (80, 165, 255);
/// What is true.
pub(super) const TRUE: (u8, u8, u8) = (90, 225, 120);
/// Where parts shall end.
pub(super) const TARGET: (u8, u8, u8) = (255, 165, 40);
/// Where parts should go next.
pub(super) const SUBGOAL: (u8, u8, u8) = (255, 225, 120);
/// What was predicted.
pub(super) const PREDICTED: (u8, u8, u8) = (200, 130, 255);
/// Chosen centres of rotation.
pub(super) const CENTER: (u8, u8, u8) = (255, 80, 110);
/// Things in the background.
pub(super) const FAINT: (u8, u8, u8) = (135, 140, 155);

/// Colours of things that come in numbers.
const SERIES: [(u8, u8, u8); 8] = [
    (80, 165, 255),
    (255, 165, 40),
    (90, 225, 120),
    (255, 80, 110),
    (200, 130, 255),
    (255, 225, 120),
    (90, 220, 220),
    (200, 200, 200),
];

pub(super) fn color((r, g, b): (u8, u8, u8)) -> Color {
    Color::from_rgb(r, g, b)
}

/// Colours of `count` series.
pub(super) fn series(count: usize) -> Vec<Color> {
    SERIES.into_iter().cycle().take(count).map(color).collect()
}

/// A line's width that stays the same at any zoom, half of it, in points of the screen.
pub(super) fn thin(points: f32) -> Radius {
    Radius::new_ui_points(points)
}

/// A point of the table in the view from above: mm, y down.
pub(super) fn above(p_m: Vec2) -> [f32; 2] {
    [mm_from_m(p_m.x) as f32, -mm_from_m(p_m.y) as f32]
}

/// A point of a frame (px) in a 2D view of that frame, where pixel (0, 0) covers the square from 0 to 1.
pub(super) fn in_frame(p_px: Vec2) -> [f32; 2] {
    [p_px.x as f32 + 0.5, p_px.y as f32 + 0.5]
}

/// A point of a frame (px) in a 2D view of that frame at half its size.
pub(super) fn in_half_frame(p_px: Vec2) -> [f32; 2] {
    in_frame(p_px).map(|x| x / 2.0)
}

/// Names of parts, each just below a point.
pub(super) fn names(points: impl IntoIterator<Item = [f32; 2]>, names: &[String]) -> Points2D {
    Points2D::new(points)
        .with_labels(names.iter().map(String::as_str))
        .with_show_labels(true)
        .with_colors([color(MEASURED)])
        .with_radii([thin(0.1)])
}
