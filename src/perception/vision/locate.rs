use nalgebra::Matrix2;

use super::Table;
use super::binned::BinnedImage;
use super::edges::{EdgePoint, edges};
use super::hough::{HoughAccumulator, HoughLine, IdealEdge};
use super::lines::{SideMeasurement, through_edges};
use super::quad::{DetectedLine, Quad, QuadShape, name_of, quads};
use super::sampling::Sampler;
use upm_core::geometry::{Lens, Vec2};
use upm_core::signal::Frame;

/// Most pixels a picture may have.
const MOST_PIXELS: usize = 64_000_000;
/// Shortest side of a picture, px.
const LEAST_SIZE: usize = 32;
/// Most lines considered: a table's four, a second table's, and clutter.
const MOST_LINES: usize = 16;
/// Votes of the weakest line considered, as a fraction of the strongest one's.
const LEAST_LINE: f32 = 0.12;
/// The picture is averaged over squares as long as its short side keeps this many cells.
const COARSE_CELLS: usize = 200;

/// Reasons why no table is located.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TableError {
    /// Width and height do not agree with the number of pixels.
    #[error("picture of {width} x {height} px holds {pixels} pixels")]
    Malformed {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Number of gray levels.
        pixels: usize,
    },
    /// The picture is too small for a table to be recognised.
    #[error("picture of {width} x {height} px is too small, {LEAST_SIZE} x {LEAST_SIZE} px are needed")]
    TooSmall {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// The picture has more pixels than the memory limit allows.
    #[error("picture of {width} x {height} px is too large, {MOST_PIXELS} pixels are the most")]
    TooLarge {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// The plate's side is not a positive, finite length.
    #[error("plate of side {0} m: a positive length is needed")]
    BadSide(f64),
    /// Invalid lens: a number that is not finite, a focal length that is not positive.
    #[error("invalid lens parameters")]
    BadLens,
    /// An even picture, or nothing above the noise.
    #[error("no edges stand out in the picture")]
    NoEdges,
    /// There are edges, but too few straight lines.
    #[error("only {0} straight lines found, a table has 4")]
    TooFewLines(usize),
    /// There are lines, but no four that make a square lighter or darker than the ground.
    #[error("no four lines make a square that is lighter or darker than the ground")]
    NotASquare,
    /// Four lines almost make a square; what they fail, with the sides.
    #[error("no four lines make the plate: of the best four {0}")]
    AlmostASquare(String),
    /// The four sides are no picture of the plate for any lens.
    #[error(
        "the four sides do not make the plate for any lens: its width is {ratio:.3} of what its height allows, its \
         corners have {angle_deg:.1} degrees"
    )]
    Skewed {
        /// Width over height, as a multiple of the plate's.
        ratio: f64,
        /// Angle between its sides, degrees.
        angle_deg: f64,
    },
    /// Part of the table is outside the picture.
    #[error("the table is cut by the picture's border")]
    CutByFrame,
    /// Too little of a side is visible: `top`, `right`, `bottom` or `left`.
    #[error("the {0} side of the table is hidden")]
    SideHidden(&'static str),
    /// The frame has positions in place of pixels, and a corner is hidden.
    #[error("a corner of the table is hidden")]
    CornerHidden,
    /// There are two squares side by side.
    #[error("more than one table in the picture")]
    MoreThanOne,
}

/// Locates the table without prior knowledge: edges, Hough, four peaks, four sides, corners, table frame. `side_m` is
/// the plate's side, `lens` the camera's calibration.
///
/// # Errors
/// [`TableError`] unless exactly one whole table is visible, and for an invalid picture, lens or side.
pub fn locate_table(frame: &Frame, lens: &Lens, side_m: f64) -> Result<Table, TableError> {
    if let Some(positions) = &frame.positions {
        let corners = positions.corners_px.ok_or(TableError::CornerHidden)?.map(|corner| lens.ideal_from_image(corner));
        return Table::from_ideal_corners(corners, side_m, lens);
    }
    check(frame, lens, side_m)?;
    Table::from_ideal_corners(corners(frame, lens, QuadShape::SQUARE, COARSE_CELLS)?, side_m, lens)
}

/// Finds the four corners of a rectangle, `aspect` times as long as high or as high as long, in a picture of a camera
/// about which nothing is known; clockwise, px. Lines are searched in an average of `cells` along the short side.
///
/// # Errors
/// As [`locate_table`].
pub fn locate_corners(frame: &Frame, aspect: f64, cells: usize) -> Result<[Vec2; 4], TableError> {
    let lens = Lens::centered([frame.width, frame.height], 1.0);
    check(frame, &lens, 1.0)?;
    corners(frame, &lens, QuadShape::in_perspective(aspect), cells)
}

/// Corners of the one table in ideal coordinates.
fn corners(frame: &Frame, lens: &Lens, shape: QuadShape, cells: usize) -> Result<[Vec2; 4], TableError> {
    let too_small = TableError::TooSmall { width: frame.width, height: frame.height };
    let sampler = Sampler::new(frame).ok_or(too_small)?;
    let bin = (frame.width.min(frame.height) / cells).max(1);
    let points = edges(&BinnedImage::of(frame, bin));
    if points.is_empty() {
        return Err(TableError::NoEdges);
    }
    let edges = ideal_edges(&points, lens);
    let size = Vec2::new(frame.width as f64, frame.height as f64);
    let cell_px = bin as f64;
    let mut ballot = HoughAccumulator::new(&edges, (size - Vec2::repeat(1.0)) / 2.0, size.norm() * 0.6, cell_px);
    let lines = strongest_lines(&mut ballot, &edges, cell_px);
    let seen = LineEvidence { lens, sampler: &sampler, frame, edges: &edges, cell_px };
    let corners = refined_corners(&choose(&lines, shape, &seen)?, &seen)?;
    if corners.iter().all(|&corner| sampler.contains(lens.image_from_ideal(corner), 0.0)) {
        Ok(corners)
    } else {
        Err(TableError::CutByFrame)
    }
}

/// The strongest lines, strongest first; the edges of each line are withdrawn from the ballot.
fn strongest_lines(ballot: &mut HoughAccumulator, edges: &[IdealEdge], cell_px: f64) -> Vec<DetectedLine> {
    let mut lines = Vec::new();
    let mut floor = 0.0;
    while let Some((peak, votes)) = ballot.highest().filter(|(_, votes)| lines.len() < MOST_LINES && *votes >= floor) {
        floor = LEAST_LINE * votes.max(floor / LEAST_LINE);
        let line = ballot.line_at(peak);
        let (seen, own) = DetectedLine::new(line, edges, near_px(cell_px), 2.0 * cell_px);
        ballot.remove_votes(peak, own.iter().filter_map(|&i| edges.get(i)));
        lines.push(seen);
    }
    lines
}

/// Largest distance of an edge from its line of the Hough array, px.
fn near_px(cell_px: f64) -> f64 {
    (1.5 * cell_px).max(3.0)
}

fn check(frame: &Frame, lens: &Lens, side_m: f64) -> Result<(), TableError> {
    let &Frame { width, height, .. } = frame;
    if width.checked_mul(height) != Some(frame.pixels.len()) {
        return Err(TableError::Malformed { width, height, pixels: frame.pixels.len() });
    }
    if frame.pixels.len() > MOST_PIXELS {
        return Err(TableError::TooLarge { width, height });
    }
    if width < LEAST_SIZE || height < LEAST_SIZE {
        return Err(TableError::TooSmall { width, height });
    }
    if !(side_m > 0.0 && side_m.is_finite()) {
        return Err(TableError::BadSide(side_m));
    }
    let numbers = lens.radial.iter().chain(&lens.tangential).chain(lens.principal_px.iter());
    if !(lens.focal_px > 0.0 && lens.focal_px.is_finite() && numbers.clone().all(|x| x.is_finite())) {
        return Err(TableError::BadLens);
    }
    Ok(())
}

/// Edges in ideal coordinates. A gradient is a covector: it transforms by the transposed Jacobian.
fn ideal_edges(points: &[EdgePoint], lens: &Lens) -> Vec<IdealEdge> {
    let edges = points.iter().map(|&EdgePoint { at_px, outward }| {
        if lens.is_ideal() {
            return IdealEdge { at: at_px, outward };
        }
        let at = lens.ideal_from_image(at_px);
        let outward: Vec2 = Matrix2::transpose(&lens.jacobian_at_ideal(at)) * outward;
        IdealEdge { at, outward: outward.normalize() }
    });
    edges.filter(|edge| edge.at.iter().chain(edge.outward.iter()).all(|x| x.is_finite())).collect()
}

/// Data in which the lines were found.
struct LineEvidence<'a> {
    lens: &'a Lens,
    sampler: &'a Sampler<'a>,
    frame: &'a Frame,
    edges: &'a [IdealEdge],
    /// Side of a cell of the averaged picture, px.
    cell_px: f64,
}

/// The one table among the lines, or the reason why there is none.
fn choose(lines: &[DetectedLine], shape: QuadShape, seen: &LineEvidence) -> Result<Quad, TableError> {
    let inside = |p: Vec2| seen.sampler.contains(seen.lens.image_from_ideal(p), 0.0);
    let shown = |a: Vec2, b: Vec2| {
        if inside(a) && inside(b) {
            return 1.0;
        }
        let steps = 32;
        (0..steps).filter(|&i| inside(a + (b - a) * ((f64::from(i) + 0.5) / f64::from(steps)))).count() as f64
            / f64::from(steps)
    };
    let least_side_px = (0.08 * seen.frame.width.min(seen.frame.height) as f64).max(16.0);
    let (found, nearest) = quads(lines, shape, least_side_px, shown);
    let Some(best) = found.first() else {
        return Err(no_quad(lines, seen, nearest));
    };
    let best = found.iter().find(|other| best.supports(other)).unwrap_or(best);
    if !best.corners.iter().all(|&corner| inside(corner)) {
        return Err(TableError::CutByFrame);
    }
    if found.iter().any(|other| best.competes_with(other)) {
        return Err(TableError::MoreThanOne);
    }
    Ok(best.clone())
}

/// Distinguishes a table that leaves the picture from other pictures without a table: two or more of the strongest
/// lines then run into the picture's border.
fn no_quad(lines: &[DetectedLine], seen: &LineEvidence, nearest: Option<String>) -> TableError {
    // No edges are found in the two outermost cells.
    let margin = 0.012 * seen.frame.width.max(seen.frame.height) as f64 + 2.5 * seen.cell_px;
    let leaves = |line: &HoughLine| {
        let near = seen.edges.iter().filter(|edge| {
            line.distance(edge.at).abs() < near_px(seen.cell_px) && edge.outward.dot(&line.normal).abs() > 0.966
        });
        let mut at_border = near.filter(|edge| !seen.sampler.contains(seen.lens.image_from_ideal(edge.at), margin));
        at_border.nth(1).is_some()
    };
    if lines.iter().take(4).filter(|strong| leaves(&strong.line)).count() >= 2 {
        TableError::CutByFrame
    } else if lines.len() < 4 {
        TableError::TooFewLines(lines.len())
    } else {
        nearest.map_or(TableError::NotASquare, TableError::AlmostASquare)
    }
}

/// Corners from the sides: first through the edges found, then from coarse profiles, then from all profiles.
fn refined_corners(quad: &Quad, seen: &LineEvidence) -> Result<[Vec2; 4], TableError> {
    let &LineEvidence { lens, sampler, edges, cell_px, .. } = seen;
    let look = SideMeasurement { sampler, lens, bright: quad.bright, stations: 96, known: false };
    let along_edges = |from: Vec2, to: Vec2| {
        let outward = HoughLine::through(from, to).normal * if quad.bright { 1.0 } else { -1.0 };
        through_edges(edges, from, to, outward, near_px(cell_px))
    };
    let corners = from_sides(quad.corners, along_edges)?;
    let coarse = |from: Vec2, to: Vec2| {
        if cell_px > 6.0 { look.refine::<25>(from, to) } else { look.refine::<11>(from, to) }
    };
    let corners = from_sides(corners, coarse)?;
    let careful = SideMeasurement { stations: 256, known: true, ..look };
    from_sides(corners, |from, to| careful.refine::<9>(from, to))
}

/// Intersections of the sides that `side` makes of each pair of corners.
fn from_sides(
    corners: [Vec2; 4],
    mut side: impl FnMut(Vec2, Vec2) -> Option<HoughLine>,
) -> Result<[Vec2; 4], TableError> {
    let mut sides = [HoughLine { normal: Vec2::x(), offset: 0.0 }; 4];
    for (i, line) in sides.iter_mut().enumerate() {
        let (from, to) = (corners[i], corners[(i + 1) % 4]);
        *line = side(from, to).ok_or_else(|| TableError::SideHidden(name_of(from, to)))?;
    }
    let mut met = corners;
    for (i, corner) in met.iter_mut().enumerate() {
        *corner = sides[(i + 3) % 4].meets(&sides[i]).ok_or(TableError::NotASquare)?;
    }
    Ok(met)
}
