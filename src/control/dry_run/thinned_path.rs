use upm_core::geometry::Vec2;

/// Largest number of points kept of one trail.
pub(super) const MOST_POINTS: usize = 2000;

/// Path of a part, thinned out evenly as it grows.
#[derive(Clone, Debug)]
pub(super) struct ThinnedPath {
    kept_m: Vec<Vec2>,
    last_m: Vec2,
    /// Interval of the points that are kept, and the number that came since the last kept one.
    every: usize,
    since: usize,
}

impl ThinnedPath {
    /// A trail that begins at `start_m`.
    pub fn from(start_m: Vec2) -> Self {
        Self { kept_m: vec![start_m], last_m: start_m, every: 1, since: 0 }
    }

    /// Appends the part's present position.
    pub fn push(&mut self, position_m: Vec2) {
        self.last_m = position_m;
        self.since += 1;
        if self.since < self.every {
            return;
        }
        if self.kept_m.len() + 2 >= MOST_POINTS {
            self.kept_m = self.kept_m.iter().step_by(2).copied().collect();
            self.every *= 2;
        }
        self.kept_m.push(position_m);
        self.since = 0;
    }

    /// The points from start to end.
    pub fn into_points(mut self) -> Vec<Vec2> {
        if self.since > 0 {
            self.kept_m.push(self.last_m);
        }
        self.kept_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_trail_is_bounded_and_keeps_both_ends(steps in 0usize..30_000) {
            let place = |k: usize| Vec2::new(k as f64, 0.0);
            let mut trail = ThinnedPath::from(place(0));
            (1..=steps).for_each(|k| trail.push(place(k)));
            let points = trail.into_points();
            prop_assert!(points.len() <= MOST_POINTS);
            prop_assert_eq!((points[0], points[points.len() - 1]), (place(0), place(steps)));
            let longest = points.windows(2).map(|pair| pair[1].x - pair[0].x).fold(0.0, f64::max);
            let shortest = points.windows(2).map(|pair| pair[1].x - pair[0].x).fold(f64::INFINITY, f64::min);
            prop_assert!(shortest > 0.0 && longest <= 1.0 + 4.0 * steps as f64 / MOST_POINTS as f64, "{}", longest);
        }
    }
}
