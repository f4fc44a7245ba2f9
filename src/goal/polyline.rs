use crate::geometry::Vec2;

/// The point of the segment from `a_m` to `b_m` nearest to `p_m`.
pub(super) fn nearest_on_segment(a_m: Vec2, b_m: Vec2, p_m: Vec2) -> Vec2 {
    let along = b_m - a_m;
    let length_squared = along.norm_squared();
    let part = if length_squared > 0.0 { ((p_m - a_m).dot(&along) / length_squared).clamp(0.0, 1.0) } else { 0.0 };
    a_m + part * along
}

/// A chain of straight segments, measured along its length.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Polyline {
    points_m: Vec<Vec2>,
    /// Length up to each point, m.
    reached_m: Vec<f64>,
}

impl Polyline {
    /// Through `points_m` in turn.
    pub(super) fn new(points_m: Vec<Vec2>) -> Self {
        let mut length_m = 0.0;
        let mut reached_m = Vec::with_capacity(points_m.len());
        for (i, point) in points_m.iter().enumerate() {
            length_m += i.checked_sub(1).map_or(0.0, |before| (point - points_m[before]).norm());
            reached_m.push(length_m);
        }
        Self { points_m, reached_m }
    }

    /// Its whole length, m.
    pub(super) fn length_m(&self) -> f64 {
        self.reached_m.last().copied().unwrap_or(0.0)
    }

    /// The point `s_m` along, held to the ends; the origin when there are no points.
    pub(super) fn at(&self, s_m: f64) -> Vec2 {
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

    /// Distance of `p_m` from the stretch between `from_m` and `to_m` along, m.
    pub(super) fn distance_m(&self, p_m: Vec2, from_m: f64, to_m: f64) -> f64 {
        let mut a = self.at(from_m);
        let mut nearest = (p_m - a).norm();
        let corners = self.points_m.iter().zip(&self.reached_m).filter(|(_, s)| (from_m..to_m).contains(*s));
        for b in corners.map(|(corner, _)| *corner).chain([self.at(to_m)]) {
            nearest = nearest.min((p_m - nearest_on_segment(a, b, p_m)).norm());
            a = b;
        }
        nearest
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
    fn points_lie_along_it() {
        assert!((corner().length_m() - 0.7).abs() < 1e-15);
        for (s, expected) in
            [(-1.0, (0.0, 0.0)), (0.1, (0.1, 0.0)), (0.3, (0.3, 0.0)), (0.5, (0.3, 0.2)), (9.0, (0.3, 0.4))]
        {
            assert!((corner().at(s) - Vec2::new(expected.0, expected.1)).norm() < 1e-15, "at {s}");
        }
        assert_eq!(Polyline::new(vec![]).at(1.0), Vec2::zeros());
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
            prop_assert!((line.distance_m(p, from, to) - sampled).abs() < 1e-3);
            prop_assert!(line.distance_m(p, from, to) <= sampled + 1e-12);
        }
    }
}
