use super::Vec2;

/// Price of a distance along the line from the expected point, as a share of one from the line: it decides only between
/// passes over the same place.
const UNEXPECTED: f64 = 1e-3;

/// A chain of straight segments, parametrised by arc length.
#[derive(Clone, Debug, PartialEq)]
pub struct Polyline {
    points_m: Vec<Vec2>,
    /// Arc length at each point, m.
    reached_m: Vec<f64>,
}

impl Polyline {
    /// The polyline through `points_m` in this order.
    pub fn new(points_m: Vec<Vec2>) -> Self {
        let mut length_m = 0.0;
        let mut reached_m = Vec::with_capacity(points_m.len());
        for (i, point) in points_m.iter().enumerate() {
            length_m += i.checked_sub(1).map_or(0.0, |before| (point - points_m[before]).norm());
            reached_m.push(length_m);
        }
        Self { points_m, reached_m }
    }

    /// Corners, m.
    pub fn points_m(&self) -> &[Vec2] {
        &self.points_m
    }

    /// Total length, m.
    pub fn length_m(&self) -> f64 {
        self.reached_m.last().copied().unwrap_or(0.0)
    }

    /// The point at arc length `s_m`, clamped to the ends; the origin when there are no points.
    pub fn at(&self, s_m: f64) -> Vec2 {
        let next = self.reached_m.partition_point(|&reached| reached <= s_m);
        match (next.checked_sub(1).and_then(|i| self.points_m.get(i)), self.points_m.get(next)) {
            (Some(a), Some(b)) => {
                let (from, to) = (self.reached_m[next - 1], self.reached_m[next]);
                a + (b - a) * ((s_m - from) / (to - from))
            }
            (Some(end), None) | (None, Some(end)) => *end,
            (None, None) => Vec2::zeros(),
        }
    }

    /// The stretch of a closed line between two arc lengths, which keep growing from lap to lap.
    pub fn stretch(&self, from_m: f64, to_m: f64) -> Self {
        let length_m = self.length_m();
        let lap_of = |s_m: f64| if length_m > 0.0 { (s_m / length_m).floor() } else { 0.0 };
        let at = |s_m: f64| self.at(s_m - lap_of(s_m) * length_m);
        let mut points_m = vec![at(from_m)];
        let mut lap = lap_of(from_m);
        while lap <= lap_of(to_m) {
            let passed = |s_m: &f64| from_m < s_m + lap * length_m && s_m + lap * length_m < to_m;
            points_m.extend(self.points_m.iter().zip(&self.reached_m).filter(|(_, s_m)| passed(s_m)).map(|(p, _)| *p));
            lap += 1.0;
        }
        points_m.push(at(to_m));
        Self::new(points_m)
    }

    /// Arc length of the point nearest to `p_m`, m, and its distance from `p_m`, m. Only the stretch between `from_m`
    /// and `to_m` is searched.
    pub fn nearest(&self, p_m: Vec2, from_m: f64, to_m: f64) -> (f64, f64) {
        self.nearest_by(p_m, (from_m, to_m), |_, off_m| off_m)
    }

    /// The nearest point by `distance_m` of its arc length and its distance from `p_m`.
    fn nearest_by(&self, p_m: Vec2, (from_m, to_m): (f64, f64), distance_m: impl Fn(f64, f64) -> f64) -> (f64, f64) {
        let (mut a, mut a_at_m) = (self.at(from_m), from_m.clamp(0.0, self.length_m()));
        let mut nearest = (a_at_m, (p_m - a).norm());
        let corners = self.points_m.iter().zip(&self.reached_m).filter(|(_, s)| (from_m..to_m).contains(*s));
        let end = (self.at(to_m), to_m.clamp(0.0, self.length_m()));
        for (b, b_at_m) in corners.map(|(corner, s)| (*corner, *s)).chain([end]) {
            let foot = Segment { from: a, to: b }.nearest(p_m);
            let (at_m, off_m) = (a_at_m + (foot - a).norm(), (p_m - foot).norm());
            if distance_m(at_m, off_m) < distance_m(nearest.0, nearest.1) {
                nearest = (at_m, off_m);
            }
            (a, a_at_m) = (b, b_at_m);
        }
        nearest
    }

    /// The same on a closed line, searched within `reach_m` of arc length `at_m`; the arc length keeps growing from lap
    /// to lap. Where the line runs back over itself the point nearer to `expected_m` along the line is taken.
    pub fn nearest_around(&self, p_m: Vec2, at_m: f64, reach_m: f64, expected_m: f64) -> (f64, f64) {
        let length_m = self.length_m();
        let (first, last) = ((at_m - reach_m) / length_m, (at_m + reach_m) / length_m);
        let distance_m = |along_m: f64, off_m: f64| off_m + UNEXPECTED * (along_m - expected_m).abs();
        let mut nearest = (at_m, f64::INFINITY);
        let mut lap = first.floor();
        while lap <= last {
            let begin_m = lap * length_m;
            let (from_m, to_m) = (at_m - reach_m - begin_m, at_m + reach_m - begin_m);
            let within = (from_m.max(0.0), to_m.min(length_m));
            let (along_m, off_m) = self.nearest_by(p_m, within, |along_m, off_m| distance_m(begin_m + along_m, off_m));
            if distance_m(begin_m + along_m, off_m) < distance_m(nearest.0, nearest.1) {
                nearest = (begin_m + along_m, off_m);
            }
            lap += 1.0;
        }
        nearest
    }
}

/// A straight line segment between two points.
///
/// Two points that move straight and in step have their least distance where the segment from their first to their last
/// difference is nearest to the origin.
///
/// ```
/// use upm_core::geometry::{Segment, Vec2};
/// let segment = Segment { from: Vec2::new(-1.0, 2.0), to: Vec2::new(3.0, 2.0) };
/// assert_eq!(segment.nearest_share(Vec2::zeros()), 0.25);
/// assert_eq!(segment.distance(Vec2::zeros()), 2.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// Start point.
    pub from: Vec2,
    /// End point.
    pub to: Vec2,
}

impl Segment {
    /// Position of the point nearest to `p` as a share of the length, from 0 at the start to 1 at the end; 0 where both
    /// ends are one point.
    #[inline]
    pub fn nearest_share(&self, p: Vec2) -> f64 {
        let along = self.to - self.from;
        let length_sq = along.norm_squared();
        if length_sq > 0.0 { ((p - self.from).dot(&along) / length_sq).clamp(0.0, 1.0) } else { 0.0 }
    }

    /// The point of the segment nearest to `p`.
    #[inline]
    pub fn nearest(&self, p: Vec2) -> Vec2 {
        self.from + (self.to - self.from) * self.nearest_share(p)
    }

    /// Distance of `p` from the segment.
    #[inline]
    pub fn distance(&self, p: Vec2) -> f64 {
        (self.nearest(p) - p).norm()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn corner() -> Polyline {
        Polyline::new(vec![Vec2::new(0.0, 0.0), Vec2::new(0.3, 0.0), Vec2::new(0.3, 0.0), Vec2::new(0.3, 0.4)])
    }

    #[test]
    fn point_at_an_arc_length_is_on_the_polyline() {
        assert!((corner().length_m() - 0.7).abs() < 1e-15);
        for (s, expected) in
            [(-1.0, (0.0, 0.0)), (0.1, (0.1, 0.0)), (0.3, (0.3, 0.0)), (0.5, (0.3, 0.2)), (9.0, (0.3, 0.4))]
        {
            assert!((corner().at(s) - Vec2::new(expected.0, expected.1)).norm() < 1e-15, "at {s}");
        }
        assert_eq!(Polyline::new(vec![]).at(1.0), Vec2::zeros());
    }

    fn square() -> Polyline {
        let corners = [(0.0, 0.0), (0.1, 0.0), (0.1, 0.1), (0.0, 0.1), (0.0, 0.0)];
        Polyline::new(corners.map(|(x, y)| Vec2::new(x, y)).to_vec())
    }

    #[test]
    fn stretch_goes_on_from_lap_to_lap() {
        for (from_m, to_m) in [(0.02, 0.07), (0.05, 0.25), (0.35, 0.45), (0.75, 1.65), (0.3, 0.3)] {
            let stretch = square().stretch(from_m, to_m);
            assert!((stretch.length_m() - (to_m - from_m)).abs() < 1e-12, "{from_m} {to_m}: {stretch:?}");
            let middle_m = 0.5 * (from_m + to_m);
            assert!((stretch.at(middle_m - from_m) - square().at(middle_m.rem_euclid(0.4))).norm() < 1e-12);
        }
        assert_eq!(Polyline::new(vec![Vec2::x()]).stretch(0.0, 1.0).points_m(), [Vec2::x(), Vec2::x()]);
    }

    #[test]
    fn arc_length_continues_across_laps() {
        let square = square();
        for (p, at, expected) in [
            ((0.05, 0.01), 0.04, (0.05, 0.01)),
            ((0.05, 0.01), 0.84, (0.85, 0.01)),
            ((0.0, 0.02), 0.01, (-0.02, 0.0)),
            ((0.03, -0.01), 1.19, (1.23, 0.01)),
        ] {
            let (along, off) = square.nearest_around(Vec2::new(p.0, p.1), at, 0.06, at);
            assert!((along - expected.0).abs() < 1e-12 && (off - expected.1).abs() < 1e-12, "{p:?}: {along}, {off}");
        }
    }

    proptest! {
        #[test]
        fn distance_is_that_of_the_nearest_of_many_points(
            points in proptest::collection::vec((-0.1..0.1f64, -0.1..0.1f64), 1..6), x in -0.2..0.2f64, y in -0.2..0.2f64,
            ends in (0.0..1.0f64, 0.0..1.0f64),
        ) {
            let line = Polyline::new(points.into_iter().map(|(x, y)| Vec2::new(x, y)).collect());
            let (from, to) = (ends.0.min(ends.1) * line.length_m(), ends.0.max(ends.1) * line.length_m());
            let p = Vec2::new(x, y);
            let sampled = (0..=2000).map(|i| (line.at(from + (to - from) * f64::from(i) / 2000.0) - p).norm()).fold(f64::MAX, f64::min);
            let (along, off) = line.nearest(p, from, to);
            prop_assert!((off - sampled).abs() < 1e-3 && off <= sampled + 1e-12);
            prop_assert!(along >= from && along <= to + 1e-12 && ((line.at(along) - p).norm() - off).abs() < 1e-9);
        }
    }
}
