//! The polyline of one path of a job file.

use super::fit::Growth;
use super::job_file::PathEntry;
use super::read::exactly_one;
use super::shape_file::{CircleShape, LissajousShape, SvgShape};
use super::targets::drawing_of;
use upm_core::document::{Diagnostics, Path};
use upm_core::geometry::Vec2;
use upm_planning::shapes::{circle_path, closed_from, lissajous_path};
use upm_planning::task::PathParams;

/// Most corners of a path made from a drawing.
const MOST_CORNERS: usize = 2000;

/// Path of one part, and its place in the file.
pub(super) struct PartPath {
    /// Path of the entry in the file: `task.paths[1]`.
    pub at: Path,
    /// Path of its corners or its shape in the file: `task.paths[1].circle`.
    pub shape_at: Path,
    /// Lengths with which a generated path scales; `None` if its corners were typed.
    pub growth: Option<Growth>,
    /// True if its corners are those in the file, in their order.
    pub has_file_corners: bool,
    /// The path in SI.
    pub params: PathParams,
}

/// A path before it is assigned to parts.
struct PathLine {
    key: &'static str,
    points_m: Vec<Vec2>,
    growth: Option<Growth>,
}

impl PartPath {
    /// Path in the file of corner `k`, or of the whole shape where its corners are not those of the file.
    pub fn corner_at(&self, k: usize) -> Path {
        if self.has_file_corners { self.shape_at.index(k) } else { self.shape_at.clone() }
    }

    /// The path at `at`, once for each part that follows it. Several parts begin evenly spaced on it and follow the
    /// whole lap. Empty if the file is at fault.
    pub fn each(entry: &PathEntry, at: &Path, faults: &mut Diagnostics) -> Vec<Self> {
        let Some(line) = line_of(entry, at, faults) else { return Vec::new() };
        let count = entry.parts_on_it();
        let waypoints_m = |k: usize| match count {
            1 => line.points_m.clone(),
            count => closed_from(&line.points_m, k as f64 / count as f64),
        };
        let part_path = |k: usize| Self {
            at: at.clone(),
            shape_at: at.key(line.key),
            growth: line.growth.clone(),
            has_file_corners: line.growth.is_none() && count == 1,
            params: PathParams {
                waypoints_m: waypoints_m(k),
                speed_mps: entry.speed_mps,
                repeat: entry.repeat,
                exchange: count > 1 && entry.parts.is_none(),
            },
        };
        (0..count).map(part_path).collect()
    }
}

fn line_of(entry: &PathEntry, at: &Path, faults: &mut Diagnostics) -> Option<PathLine> {
    let PathEntry { waypoints_m, circle, lissajous, svg, .. } = entry;
    if !exactly_one(entry, &["waypoints_mm", "circle", "lissajous", "svg"], at, faults) {
        return None;
    }
    if let Some(entry) = circle {
        return Some(circle_of(entry));
    }
    if let Some(entry) = lissajous {
        return lissajous_of(entry, &at.key("lissajous"), faults);
    }
    if let Some(entry) = svg {
        return drawn_line(entry, &at.key("svg"), faults);
    }
    let points_m = waypoints_m.clone().unwrap_or_default();
    Some(PathLine { key: "waypoints_mm", points_m, growth: None })
}

fn circle_of(entry: &CircleShape) -> PathLine {
    let &CircleShape { center_m, radius_m, start_rad, clockwise } = entry;
    let points_m = circle_path(center_m, radius_m, start_rad, clockwise);
    PathLine { key: "circle", points_m, growth: Some(Growth { name: "radius_mm", size_m: vec![radius_m], center_m }) }
}

fn lissajous_of(entry: &LissajousShape, at: &Path, faults: &mut Diagnostics) -> Option<PathLine> {
    let &LissajousShape { center_m, size_m, frequencies: [a, b], phase_rad } = entry;
    let common = common_factor(a, b);
    if common > 1 {
        let allowed = format!("[{}, {}], the same figure without a common factor", a / common, b / common);
        faults.push(at.key("frequencies"), format!("[{a}, {b}]"), allowed);
        return None;
    }
    let points_m = lissajous_path(center_m, size_m, [a, b], phase_rad);
    let growth = Growth { name: "size_mm", size_m: vec![size_m.x, size_m.y], center_m };
    Some(PathLine { key: "lissajous", points_m, growth: Some(growth) })
}

fn common_factor(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { common_factor(b, a % b) }
}

fn drawn_line(entry: &SvgShape, at: &Path, faults: &mut Diagnostics) -> Option<PathLine> {
    let (drawing, growth) = drawing_of(entry, at, faults)?;
    let Some(points_m) = drawing.single_line() else {
        faults.push(at, "a drawing of several lines", "one unbroken line");
        return None;
    };
    let corners = points_m.len();
    faults.require(
        corners <= MOST_CORNERS,
        at,
        format!("{corners} corners"),
        format!("up to {MOST_CORNERS} once its curves are straight pieces"),
    );
    Some(PathLine { key: "svg", points_m, growth: Some(growth) })
}
