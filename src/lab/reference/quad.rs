//! Selection of the four lines that are the table's sides.

use image::GrayImage;

use super::lines::{FittedLine, VOTES, edge_pixels, fitted_lines};
use upm_core::geometry::Vec2;

/// Shortest side, as a fraction of the picture's shorter one.
const LEAST_SIDE: f64 = 0.15;
/// Longest side over shortest one: perspective of a camera tilted by 10°.
const MOST_RATIO: f64 = 1.35;
/// Limits of the cosine between lines: opposite sides are more nearly parallel, neighbours more nearly perpendicular.
const PARALLEL: f64 = 0.97;
const SQUARE: f64 = 0.35;
/// Least share of every side covered by edges.
const LEAST_SUPPORT: f64 = 0.5;

/// Corners of the table in `picture`, px, clockwise; `None` when no four lines form one.
pub(super) fn corners(picture: &GrayImage) -> Option<[Vec2; 4]> {
    let edges = edge_pixels(picture);
    let short_px = f64::from(picture.width().min(picture.height()));
    VOTES.iter().find_map(|share| best_quad(&fitted_lines(&edges, (share * short_px) as u32), picture))
}

/// The four lines with the longest supported sides.
fn best_quad(lines: &[FittedLine], picture: &GrayImage) -> Option<[Vec2; 4]> {
    let pairs = |of: &dyn Fn(&FittedLine, &FittedLine) -> bool| -> Vec<[usize; 2]> {
        let all = (0..lines.len()).flat_map(|i| (i + 1..lines.len()).map(move |j| [i, j]));
        all.filter(|&[i, j]| of(&lines[i], &lines[j])).collect()
    };
    let opposite = pairs(&|a, b| a.normal.dot(&b.normal).abs() > PARALLEL);
    let mut best: Option<(f64, [Vec2; 4])> = None;
    for (k, &[a, b]) in opposite.iter().enumerate() {
        for &[c, d] in &opposite[k + 1..] {
            if lines[a].normal.dot(&lines[c].normal).abs() > SQUARE {
                continue;
            }
            let sides = [&lines[a], &lines[c], &lines[b], &lines[d]];
            let Some((score_px, corners)) = scored(sides, picture) else { continue };
            if best.as_ref().is_none_or(|(best_px, _)| score_px > *best_px) {
                best = Some((score_px, corners));
            }
        }
    }
    best.map(|(_, corners)| corners)
}

/// Supported less bare length of the sides, px, and the corners, clockwise; `None` when the sides do not form a table.
fn scored(sides: [&FittedLine; 4], picture: &GrayImage) -> Option<(f64, [Vec2; 4])> {
    let mut corners = [Vec2::zeros(); 4];
    for (i, corner) in corners.iter_mut().enumerate() {
        *corner = sides[i].crossing(sides[(i + 1) % 4])?;
    }
    let (width, height) = (f64::from(picture.width()), f64::from(picture.height()));
    let inside = |p: &Vec2| p.x >= 0.0 && p.y >= 0.0 && p.x <= width - 1.0 && p.y <= height - 1.0;
    let lengths: [f64; 4] = std::array::from_fn(|i| (corners[(i + 1) % 4] - corners[i]).norm());
    let (least, most) = lengths.iter().fold((f64::MAX, 0.0), |(least, most), &l| (l.min(least), l.max(most)));
    if !corners.iter().all(inside) || least < LEAST_SIDE * width.min(height) || most > MOST_RATIO * least {
        return None;
    }
    let mut score_px = 0.0;
    for i in 0..4 {
        // corner i is on sides i and i + 1, so side i + 1 runs from corner i to corner i + 1
        let share = support(sides[(i + 1) % 4], corners[i], corners[(i + 1) % 4]);
        if share < LEAST_SUPPORT {
            return None;
        }
        score_px += lengths[i] * (2.0 * share - 1.0);
    }
    Some((score_px, clockwise(corners)))
}

/// Share of the pixels from `from` to `to` that have an edge of `line`.
fn support(line: &FittedLine, from: Vec2, to: Vec2) -> f64 {
    let along = to - from;
    let cells = along.norm().ceil().max(1.0) as usize;
    let mut hit = vec![false; cells];
    for edge in &line.edges {
        let at = (edge - from).dot(&along) / along.norm_squared();
        if (0.0..1.0).contains(&at) {
            hit[(at * cells as f64) as usize] = true;
        }
    }
    hit.iter().filter(|&&hit| hit).count() as f64 / cells as f64
}

/// Sorted by their angle about the middle: clockwise, since y points down.
fn clockwise(mut corners: [Vec2; 4]) -> [Vec2; 4] {
    let middle = corners.iter().sum::<Vec2>() / 4.0;
    let angle = |p: &Vec2| (p.y - middle.y).atan2(p.x - middle.x);
    corners.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
    corners
}
