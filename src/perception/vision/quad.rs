//! Selection of the four lines that are the table's sides.

use super::hough::{HoughLine, IdealEdge};
use upm_core::geometry::Vec2;

/// Shape of the four lines searched for.
#[derive(Clone, Copy)]
pub(super) struct QuadShape {
    /// Its longer over its shorter sides, seen from above.
    aspect: f64,
    /// Largest ratio of two sides beyond that: a square seen obliquely.
    side_ratio: f64,
    /// Largest deviation from parallel, and from square, rad.
    parallel_rad: f64,
    square_rad: f64,
}

impl QuadShape {
    /// A square below a camera that looks straight down, or nearly so.
    pub(super) const SQUARE: Self = Self { aspect: 1.0, side_ratio: 1.4, parallel_rad: 0.35, square_rad: 0.4 };

    /// A rectangle seen by any camera at up to 25°.
    pub(super) fn in_perspective(aspect: f64) -> Self {
        Self { aspect: aspect.max(1.0 / aspect), side_ratio: 1.7, parallel_rad: 0.5, square_rad: 0.5 }
    }
}

/// Share of a side that must show an edge, and of all four together.
const SIDE_SEEN: f64 = 0.3;
const ALL_SEEN: f64 = 0.55;
/// Weights: unseen length counts double; a side that stops short of a corner costs as much as this share of it unseen.
/// This rejects the larger square formed with a strip beside the table, which has few gaps, but two of them at corners.
const UNSEEN: f64 = 2.0;
const SHORT_END_PENALTY: f64 = 0.3;
/// Length of a side's end: this share of it, and at least this many cells.
const END: f64 = 0.05;
const END_CELLS: f64 = 3.0;

/// A line, and the positions along it of edges of its direction.
pub(super) struct DetectedLine {
    pub(super) line: HoughLine,
    /// Cells along the line that hold an edge, ascending: first those with the dark side along the normal.
    cells: [Vec<i64>; 2],
    cell_px: f64,
}

/// Four lines taken as a table.
#[derive(Clone, Debug)]
pub(super) struct Quad {
    /// Indices of the lines, each the side that leaves the corner of its index.
    pub(super) lines: [usize; 4],
    /// Corners in ideal coordinates, clockwise as the picture is seen.
    pub(super) corners: [Vec2; 4],
    /// True when it is lighter than its surroundings.
    pub(super) bright: bool,
    /// Score, px: higher is better seen.
    score_px: f64,
}

impl DetectedLine {
    /// Collects the edges within `reach_px` of `line` whose direction agrees with it to 15°; also returns their
    /// indices.
    pub(super) fn new(line: HoughLine, edges: &[IdealEdge], reach_px: f64, cell_px: f64) -> (Self, Vec<usize>) {
        let mut cells = [Vec::new(), Vec::new()];
        let mut own = Vec::new();
        for (i, edge) in edges.iter().enumerate() {
            if line.distance(edge.at).abs() < reach_px {
                let cosine = edge.outward.dot(&line.normal);
                if cosine.abs() > 0.966 {
                    cells[usize::from(cosine < 0.0)].push((line.along(edge.at) / cell_px).floor() as i64);
                    own.push(i);
                }
            }
        }
        for side in &mut cells {
            side.sort_unstable();
            side.dedup();
        }
        (Self { line, cells, cell_px }, own)
    }

    /// Length between `from` and `to` with an edge whose dark side is along `outward`, px.
    fn seen_px(&self, from: Vec2, to: Vec2, outward: Vec2) -> f64 {
        let cells = &self.cells[usize::from(outward.dot(&self.line.normal) < 0.0)];
        let cell = |p| (self.line.along(p) / self.cell_px).floor() as i64;
        let (a, b) = (cell(from).min(cell(to)), cell(from).max(cell(to)));
        (cells.partition_point(|&c| c <= b) - cells.partition_point(|&c| c < a)) as f64 * self.cell_px
    }
}

/// All quadrangles of that shape whose sides show enough edge, all dark outside or all dark inside, the best seen
/// first; and what is wrong with the best seen of the others. `shown(a, b)` is the share of the stretch from `a` to `b`
/// within the frame.
pub(super) fn quads(
    lines: &[DetectedLine],
    shape: QuadShape,
    least_side_px: f64,
    shown: impl Fn(Vec2, Vec2) -> f64,
) -> (Vec<Quad>, Option<String>) {
    let pairs = parallel_pairs(lines, shape, least_side_px);
    let (mut found, mut nearest): (Vec<Quad>, Option<Rejected>) = (Vec::new(), None);
    for (i, &first) in pairs.iter().enumerate() {
        for &second in &pairs[i + 1..] {
            match quad(lines, shape, [first, second], least_side_px, &shown) {
                Some(Ok(quad)) => found.push(quad),
                Some(Err(other)) if nearest.as_ref().is_none_or(|best| other.0 > best.0) => nearest = Some(other),
                _ => {}
            }
        }
    }
    found.sort_by(|a, b| b.score_px.total_cmp(&a.score_px).then(a.lines.cmp(&b.lines)));
    (found, nearest.map(|(_, fault)| fault))
}

/// Length seen of a quadrangle that is no table, px, and the reason.
type Rejected = (f64, String);

impl Quad {
    /// Middle of the four corners.
    pub(super) fn middle(&self) -> Vec2 {
        self.corners.iter().sum::<Vec2>() / 4.0
    }

    /// True when `p` is inside.
    pub(super) fn contains(&self, p: Vec2) -> bool {
        (0..4).all(|i| HoughLine::through(self.corners[i], self.corners[(i + 1) % 4]).distance(p) < 0.0)
    }

    /// True when `self` is the dark mat under the bright plate `other`.
    pub(super) fn supports(&self, other: &Self) -> bool {
        !self.bright && other.bright && self.contains(other.middle()) && other.score_px > 0.3 * self.score_px
    }

    /// True for a second table: beside this one, and with a score not much lower.
    pub(super) fn competes_with(&self, other: &Self) -> bool {
        !self.contains(other.middle()) && !other.contains(self.middle()) && other.score_px > 0.5 * self.score_px
    }
}

fn parallel_pairs(lines: &[DetectedLine], shape: QuadShape, least_side_px: f64) -> Vec<[usize; 2]> {
    let mut pairs = Vec::new();
    for (i, DetectedLine { line: a, .. }) in lines.iter().enumerate() {
        for (j, DetectedLine { line: b, .. }) in lines.iter().enumerate().skip(i + 1) {
            let cosine = a.normal.dot(&b.normal);
            let apart = (a.offset - cosine.signum() * b.offset).abs();
            if cosine.abs() > libm::cos(shape.parallel_rad) && (cosine.abs() < 0.99 || apart > least_side_px / 2.0) {
                pairs.push([i, j]);
            }
        }
    }
    pairs
}

fn quad(
    lines: &[DetectedLine],
    shape: QuadShape,
    [first, second]: [[usize; 2]; 2],
    least_side_px: f64,
    shown: &impl Fn(Vec2, Vec2) -> f64,
) -> Option<Result<Quad, Rejected>> {
    let mut around = [first[0], second[0], first[1], second[1]];
    let [a, b, c, d] = around.map(|i| &lines[i].line);
    if a.normal.dot(&b.normal).abs() > libm::sin(shape.square_rad) {
        return None;
    }
    let mut corners = [d.meets(a)?, a.meets(b)?, b.meets(c)?, c.meets(d)?];
    let diagonals = (corners[2] - corners[0], corners[3] - corners[1]);
    if diagonals.0.x * diagonals.1.y - diagonals.0.y * diagonals.1.x < 0.0 {
        corners.reverse();
        around = [around[2], around[1], around[0], around[3]];
    }
    let sides = [0, 1, 2, 3].map(|i| (corners[(i + 1) % 4] - corners[i]).norm());
    let even = if sides[0] + sides[2] > sides[1] + sides[3] { 0 } else { 1 };
    let lengths = [0, 1, 2, 3].map(|i| if i % 2 == even { sides[i] / shape.aspect } else { sides[i] });
    let shortest = (0..4).fold(0, |least, i| if lengths[i] < lengths[least] { i } else { least });
    let longest = (0..4).fold(0, |most, i| if lengths[i] > lengths[most] { i } else { most });
    if sides.iter().any(|side| *side < least_side_px) || !is_convex(&corners) {
        return None;
    }
    let visible = [0, 1, 2, 3].map(|i| sides[i] * shown(corners[i], corners[(i + 1) % 4]));
    if (0..4).any(|i| visible[i] < 0.2 * sides[i]) {
        return None;
    }
    let name = |i: usize| name_of(corners[i], corners[(i + 1) % 4]);
    let seen_as = |bright: bool| {
        let (mut seen_px, mut loose_px, mut hidden) = (0.0, 0.0, None);
        for i in 0..4 {
            let (from, to) = (corners[i], corners[(i + 1) % 4]);
            let outward = HoughLine::through(from, to).normal * if bright { 1.0 } else { -1.0 };
            let side = &lines[around[i]];
            let seen = side.seen_px(from, to, outward);
            if seen < SIDE_SEEN * visible[i] {
                let [percent, least] = [seen / visible[i], SIDE_SEEN].map(|share| 100.0 * share);
                let fault = || format!("{} shows over {percent:.0} % of its length (least {least:.0} %)", name(i));
                hidden = hidden.or_else(|| Some(fault()));
            }
            seen_px += seen;
            let end = END.max(END_CELLS * side.cell_px / sides[i]).min(0.5);
            let near = |a: Vec2, b: Vec2| side.seen_px(a, a + (b - a) * end, outward) < 0.5 * end * sides[i];
            let loose = [near(from, to), near(to, from)].into_iter().filter(|&loose| loose).count();
            loose_px += loose as f64 * SHORT_END_PENALTY * visible[i];
        }
        let ratio = lengths[longest] / lengths[shortest];
        let unequal = (ratio > shape.side_ratio).then(|| {
            let ([longer, shorter], most) = ([longest, shortest].map(name), shape.side_ratio);
            format!("{longer} and {shorter} are {ratio:.2} to 1 (most {most})")
        });
        let visible_px = visible.iter().sum::<f64>();
        let few = || (seen_px <= ALL_SEEN * visible_px).then(|| "too little shows".to_owned());
        match hidden.or(unequal).or_else(few) {
            Some(fault) => Err((seen_px, fault)),
            None => {
                let score_px = seen_px - UNSEEN * (visible_px - seen_px) - loose_px;
                Ok(Quad { lines: around, corners, bright, score_px })
            }
        }
    };
    let of_both = |bright: Rejected| seen_as(false).map_err(|dark| if dark.0 > bright.0 { dark } else { bright });
    Some(seen_as(true).or_else(of_both))
}

/// Name of the side from one corner to the next, clockwise.
pub(super) fn name_of(from: Vec2, to: Vec2) -> &'static str {
    let facing = HoughLine::through(from, to).normal;
    match (facing.y.abs() >= facing.x.abs(), facing.x < 0.0, facing.y > 0.0) {
        (true, _, false) => "top",
        (true, _, true) => "bottom",
        (false, false, _) => "right",
        (false, true, _) => "left",
    }
}

fn is_convex(corners: &[Vec2; 4]) -> bool {
    (0..4).all(|i| {
        let (a, b) = (corners[(i + 1) % 4] - corners[i], corners[(i + 2) % 4] - corners[(i + 1) % 4]);
        a.x * b.y - a.y * b.x > 0.0
    })
}
