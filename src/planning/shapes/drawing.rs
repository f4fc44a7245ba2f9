use kurbo::{BezPath, ParamCurve, PathEl, PathSeg};

use upm_core::geometry::{Polyline, Vec2};

/// Greatest distance between a curve and its polyline, in sizes of the drawing. A drawing of 1 m fits on no plate, so
/// the distance stays below [`super::TOLERANCE_M`].
const TOLERANCE: f64 = 5e-5;

/// Distance within which points count as equal, in sizes of the drawing.
const SAME: f64 = 1e-6;

/// Relative difference within which gaps count as equal.
const SAME_GAP: f64 = 1e-6;

/// Cosine of the smallest turn that counts as a corner, 30 degrees.
const COS_CORNER: f64 = 0.866;

/// A drawing of lines with knots, which always get a place. Between knots, places are spread evenly by arc length.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawing {
    stretches: Vec<LineSegment>,
    /// Number of knots.
    knots: usize,
    size_m: f64,
    /// Middle of the drawing, m.
    pub(super) center_m: Vec2,
}

/// A line between two knots, in sizes of the drawing from its middle.
#[derive(Clone, Debug, PartialEq)]
struct LineSegment {
    line: Polyline,
    /// Indices of the knots at its ends; equal on a closed line.
    ends: [usize; 2],
}

/// Choice of the points of a path that become knots.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Knots {
    /// Ends of lines; on a closed line its first point.
    Ends,
    /// Ends, corners, and points shared by lines.
    EndsCornersJunctions,
}

impl Drawing {
    /// Drawing of `path`, which has size 1 about the origin, scaled to `size_m` about `center_m`.
    pub(super) fn of_path(path: &BezPath, knots: Knots, size_m: f64, center_m: Vec2) -> Self {
        let lines = lines_of(path);
        let shared = if knots == Knots::Ends { Vec::new() } else { junctions(&lines) };
        let goes_on = |a: &Vec<Vec2>, b: &Vec<Vec2>| {
            knots == Knots::Ends || !(turns(a, b) || b.first().is_some_and(|point| contains(&shared, point)))
        };
        let mut knot_points: Vec<Vec2> = Vec::new();
        let mut stretches = Vec::new();
        for piece in lines.iter().flat_map(|line| line.chunk_by(goes_on)) {
            let points = joined(piece);
            let (Some(first), Some(last)) = (points.first().copied(), points.last().copied()) else { continue };
            let ends = [first, last].map(|end| knot(&mut knot_points, end));
            stretches.push(LineSegment { line: Polyline::new(points), ends });
        }
        Self { stretches, knots: knot_points.len(), size_m, center_m }
    }

    fn in_table(&self, point: Vec2) -> Vec2 {
        self.center_m + self.size_m * point
    }

    /// Number of knots, which is the least number of places.
    pub fn fewest(&self) -> usize {
        self.knots
    }

    /// The only line of the drawing, m; `None` if it has several.
    pub fn single_line(&self) -> Option<Vec<Vec2>> {
        match self.stretches.as_slice() {
            [only] => Some(only.line.points_m().iter().map(|point| self.in_table(*point)).collect()),
            _ => None,
        }
    }

    /// `count` places, m: one at every knot, and the others such that the widest gap along the lines is as narrow as
    /// possible. `None` for fewer than [`Drawing::fewest`].
    pub fn places(&self, count: usize) -> Option<Vec<Vec2>> {
        let more = count.checked_sub(self.knots)?;
        let gaps = self.gaps(more).filter(|gaps| !gaps.is_empty())?;
        let mut taken = vec![false; self.knots];
        let mut places_m = Vec::with_capacity(count);
        for (LineSegment { line, ends: [first, last] }, gaps) in self.stretches.iter().zip(gaps) {
            for i in 0..=gaps {
                let end = if i == 0 { Some(first) } else { Some(last).filter(|_| i == gaps) };
                let is_free = end.is_none_or(|&end| !std::mem::replace(&mut taken[end], true));
                if is_free {
                    places_m.push(self.in_table(line.at(line.length_m() * i as f64 / gaps as f64)));
                }
            }
        }
        Some(places_m)
    }

    /// Number of gaps of each stretch after adding `more` places, one after another in the widest gap.
    fn gaps(&self, more: usize) -> Option<Vec<usize>> {
        let mut gaps = vec![1; self.stretches.len()];
        for _ in 0..more {
            let width = |(i, gaps): &(usize, &mut usize)| self.stretches[*i].line.length_m() / **gaps as f64;
            let wider = |a, b| if width(&b) > width(&a) * (1.0 + SAME_GAP) { b } else { a };
            let widest = gaps.iter_mut().enumerate().reduce(wider);
            *widest?.1 += 1;
        }
        Some(gaps)
    }
}

/// Segments of every line of `path` as polylines; segments of no length are left out.
fn lines_of(path: &BezPath) -> Vec<Vec<Vec<Vec2>>> {
    let has_length = |chain: &Vec<Vec2>| chain.windows(2).any(|pair| (pair[1] - pair[0]).norm() > SAME);
    path.subpaths()
        .map(|line| kurbo::segments(line.iter().copied()).map(flattened).filter(has_length).collect::<Vec<_>>())
        .filter(|line| !line.is_empty())
        .collect()
}

/// The segment as straight pieces.
pub(super) fn flattened(segment: PathSeg) -> Vec<Vec2> {
    let mut points = Vec::new();
    kurbo::flatten([PathEl::MoveTo(segment.start()), segment.as_path_el()], TOLERANCE, |element| {
        points.extend(element.end_point().map(|point| Vec2::new(point.x, point.y)));
    });
    points
}

/// Points at which ends of segments meet that are not consecutive.
fn junctions(lines: &[Vec<Vec<Vec2>>]) -> Vec<Vec2> {
    let starts = lines.iter().filter_map(|line| line.first()?.first());
    let ends = lines.iter().flatten().filter_map(|segment| segment.last());
    let mut seen: Vec<Vec2> = Vec::new();
    let mut shared: Vec<Vec2> = Vec::new();
    for point in starts.chain(ends) {
        let list = if contains(&seen, point) { &mut shared } else { &mut seen };
        list.push(*point);
    }
    shared
}

/// True if the line has a corner between two consecutive segments.
fn turns(before: &[Vec2], after: &[Vec2]) -> bool {
    let (Some([.., a, b]), Some([c, d, ..])) = (before.last_chunk::<2>(), after.first_chunk::<2>()) else {
        return false;
    };
    let (ahead, next) = (b - a, d - c);
    ahead.dot(&next) < COS_CORNER * ahead.norm() * next.norm()
}

fn contains(points: &[Vec2], point: &Vec2) -> bool {
    points.iter().any(|other| (other - point).norm() <= SAME)
}

/// Index of the knot at `point`, added if it is new.
fn knot(knots: &mut Vec<Vec2>, point: Vec2) -> usize {
    knots.iter().position(|knot| (knot - point).norm() <= SAME).unwrap_or_else(|| {
        knots.push(point);
        knots.len() - 1
    })
}

/// The consecutive polylines joined into one.
fn joined(chains: &[Vec<Vec2>]) -> Vec<Vec2> {
    let first = chains.first().and_then(|chain| chain.first()).copied();
    first.into_iter().chain(chains.iter().flat_map(|chain| chain.iter().skip(1).copied())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawn(d: &str, knots: Knots) -> Drawing {
        Drawing::of_path(&BezPath::from_svg(d).unwrap(), knots, 1.0, Vec2::zeros())
    }

    #[test]
    fn lines_that_meet_share_the_place_where_they_do() {
        let tee = drawn("M0 0 H1 H2 M1 0 V-2", Knots::EndsCornersJunctions);
        assert_eq!((tee.fewest(), tee.places(3)), (4, None));
        let places = tee.places(5).unwrap();
        assert_eq!(places.len(), 5);
        assert!(contains(&places, &Vec2::new(1.0, 0.0)) && contains(&places, &Vec2::new(1.0, -1.0)), "{places:?}");
    }
}
