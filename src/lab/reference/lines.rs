//! Straight lines: Canny, Hough, and a least-squares line through the edges near each.

use image::GrayImage;
use imageproc::contrast::otsu_level;
use imageproc::edges::canny;
use imageproc::hough::{LineDetectionOptions, detect_lines};
use nalgebra::{Matrix2, SymmetricEigen};

use crate::numerics::suppress_neighbours;
use upm_core::geometry::Vec2;

/// Canny's thresholds as fractions of the step from ground to plate. Its Sobel filter responds with twice the height of
/// a step that its own blur and a lens's have made 1.6 px wide.
const CANNY: [f32; 2] = [0.3, 0.6];
/// Votes of the weakest line kept, as a fraction of the picture's shorter side: the values are tried in turn until a
/// table is found. A line half a degree off the nearest direction spreads its votes: one of 850 px leaves 115 in its
/// best bin.
pub(super) const VOTES: [f64; 5] = [0.5, 0.25, 0.12, 0.08, 0.05];
/// Distances within which edges belong to a line, px, for each fit in turn. The first covers a bin of the transform,
/// half a degree over 450 px.
const NEAR_PX: [f64; 4] = [5.0, 3.0, 2.0, 1.5];
/// Lines closer than this at the picture's middle, px, and in direction (cosine) are one.
const SAME_PX: f64 = 4.0;
const SAME_COSINE: f64 = 0.999;
/// Most lines considered.
const MOST_LINES: usize = 14;

/// The line `normal · p = offset_px`, with the edges on it.
#[derive(Clone, Debug)]
pub(super) struct FittedLine {
    /// Unit normal.
    pub normal: Vec2,
    /// Distance from the origin along the normal, px.
    pub offset_px: f64,
    /// Edge pixels within the last distance of `NEAR_PX`.
    pub edges: Vec<Vec2>,
}

impl FittedLine {
    /// Signed distance of `p`, px.
    pub fn distance_px(&self, p: Vec2) -> f64 {
        self.normal.dot(&p) - self.offset_px
    }

    /// Intersection of two lines; `None` for parallel ones.
    pub fn crossing(&self, other: &Self) -> Option<Vec2> {
        let normals = Matrix2::new(self.normal.x, self.normal.y, other.normal.x, other.normal.y);
        Some(normals.try_inverse()? * Vec2::new(self.offset_px, other.offset_px))
    }
}

/// Edge pixels of the picture by Canny, its thresholds from Otsu's two classes.
pub(super) fn edge_pixels(picture: &GrayImage) -> GrayImage {
    let level = otsu_level(picture);
    let mean = |above: bool| {
        let class = picture.iter().filter(|&&value| (value > level) == above);
        let (sum, count) = class.fold((0.0, 0u32), |(sum, count), &value| (sum + f32::from(value), count + 1));
        sum / count.max(1) as f32
    };
    let step = (mean(true) - mean(false)).max(1.0);
    canny(picture, CANNY[0] * step, CANNY[1] * step)
}

/// Lines of at least `votes` votes, fitted to the edges, longest first.
pub(super) fn fitted_lines(edges: &GrayImage, votes: u32) -> Vec<FittedLine> {
    let points: Vec<Vec2> = edges
        .enumerate_pixels()
        .filter(|(_, _, pixel)| pixel.0[0] > 0)
        .map(|(x, y, _)| Vec2::new(f64::from(x), f64::from(y)))
        .collect();
    let options = LineDetectionOptions { vote_threshold: votes.max(2), suppression_radius: 8 };
    let found = detect_lines(edges, options);
    let mut fitted: Vec<FittedLine> = found
        .iter()
        .filter_map(|line| {
            let (sin, cos) = f64::from(line.angle_in_degrees).to_radians().sin_cos();
            fit(Vec2::new(cos, sin), f64::from(line.r), &points)
        })
        .collect();
    fitted.sort_by(|a, b| b.edges.len().cmp(&a.edges.len()).then(a.offset_px.total_cmp(&b.offset_px)));
    let middle = Vec2::new(f64::from(edges.width()), f64::from(edges.height())) * 0.5;
    let mut kept = suppress_neighbours(fitted, |other: &FittedLine, line| {
        let [a_px, b_px] = [other, line].map(|line| line.distance_px(middle));
        other.normal.dot(&line.normal).abs() <= SAME_COSINE
            || (a_px.abs() - b_px.abs()).abs() >= SAME_PX
            || (a_px * other.normal - b_px * line.normal).norm() >= SAME_PX
    });
    kept.truncate(MOST_LINES);
    kept
}

/// Total least squares through the edges near the line, within a smaller distance each time.
fn fit(mut normal: Vec2, mut offset_px: f64, points: &[Vec2]) -> Option<FittedLine> {
    let mut edges = Vec::new();
    for near_px in NEAR_PX {
        edges = points.iter().copied().filter(|p| (normal.dot(p) - offset_px).abs() < near_px).collect::<Vec<_>>();
        if edges.len() < 2 {
            return None;
        }
        let mean = edges.iter().sum::<Vec2>() / edges.len() as f64;
        let scatter: Matrix2<f64> = edges.iter().map(|p| (p - mean) * (p - mean).transpose()).sum();
        let eigen = SymmetricEigen::new(scatter);
        normal = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
        offset_px = normal.dot(&mean);
    }
    Some(FittedLine { normal, offset_px, edges })
}
