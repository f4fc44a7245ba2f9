use super::PartOutline;
use upm_core::geometry::{Segment, Vec2};

/// Rounding error that does not count as an approach, m.
pub(super) const ROUNDING_M: f64 = 1e-9;

/// Gap between rims and the plate's edge, m. A part that is already nearer may stay as near.
const EDGE_GAP_M: f64 = 1.5e-3;

/// True when the centres of two parts that move straight and in step never come nearer than `least_m`, or than they are
/// at the beginning.
pub(super) fn keep_apart(a: &Segment, b: &Segment, least_m: f64) -> bool {
    let from = a.from - b.from;
    let by = a.to - b.to - from;
    let closing = -from.dot(&by);
    if closing <= 0.0 {
        return true;
    }
    let by_squared = by.norm_squared();
    let nearest = if closing < by_squared {
        from.norm_squared() - closing * closing / by_squared
    } else {
        (from + by).norm_squared()
    };
    nearest >= (least_m - ROUNDING_M).powi(2) || nearest >= from.norm_squared() - ROUNDING_M * least_m
}

/// Discs on a square plate, each with its target.
#[derive(Clone, Debug)]
pub(super) struct MultiDiscProblem {
    discs: Vec<PartOutline>,
    half_side_m: f64,
    /// Target of each disc, m.
    pub(super) targets_m: Vec<Vec2>,
}

impl MultiDiscProblem {
    pub(super) fn new(discs: Vec<PartOutline>, half_side_m: f64, targets_m: Vec<Vec2>) -> Self {
        Self { discs, half_side_m, targets_m }
    }

    /// The same discs with other targets.
    pub(super) fn with_targets(&self, targets_m: Vec<Vec2>) -> Self {
        Self { targets_m, ..self.clone() }
    }

    pub(super) fn len(&self) -> usize {
        self.discs.len()
    }

    /// Least allowed distance of the centres of two parts with `gap_m` between rims, m; less where their targets
    /// require it.
    pub(super) fn least_m(&self, a: usize, b: usize, gap_m: f64) -> f64 {
        let side_by_side_m = self.discs[a].radius_m + self.discs[b].radius_m + gap_m;
        side_by_side_m.min((self.targets_m[a] - self.targets_m[b]).norm())
    }

    /// Largest allowed |x| and |y| of a part's centre, m.
    pub(super) fn reach_m(&self, part: usize) -> f64 {
        (self.half_side_m - self.discs[part].radius_m - EDGE_GAP_M).max(0.0)
    }

    /// Pairs of parts that come nearer than `gap_m`, and nearer than they are, when all move in step.
    pub(super) fn conflicts<'a>(
        &'a self,
        from_m: &'a [Vec2],
        to_m: &'a [Vec2],
        gap_m: f64,
    ) -> impl Iterator<Item = (usize, usize)> + 'a {
        let step = |i: usize| Segment { from: from_m[i], to: to_m[i] };
        let pairs = (0..self.len()).flat_map(|a| (0..a).map(move |b| (a, b)));
        pairs.filter(move |&(a, b)| !keep_apart(&step(a), &step(b), self.least_m(a, b, gap_m)))
    }

    /// True when all can move in step without coming nearer than `gap_m`, or than they are.
    pub(super) fn is_clear(&self, from_m: &[Vec2], to_m: &[Vec2], gap_m: f64) -> bool {
        self.conflicts(from_m, to_m, gap_m).next().is_none()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = Vec2> {
        (-0.1..0.1f64, -0.1..0.1f64).prop_map(|(x, y)| Vec2::new(x, y))
    }

    proptest! {
        #[test]
        fn steps_are_judged_as_many_moments_are(a in (point(), point()), b in (point(), point()), least_m in 0.01..0.1f64) {
            let (a, b) = (Segment { from: a.0, to: a.1 }, Segment { from: b.0, to: b.1 });
            let at = |step: &Segment, t: f64| step.from + t * (step.to - step.from);
            let moments = (0..=4000).map(|k| f64::from(k) / 4000.0);
            let nearest_m = moments.map(|t| (at(&a, t) - at(&b, t)).norm()).fold(f64::INFINITY, f64::min);
            let needed_m = least_m.min((a.from - b.from).norm());
            let (from, by) = (at(&a, 0.0) - at(&b, 0.0), at(&a, 1.0) - at(&b, 1.0) - (at(&a, 0.0) - at(&b, 0.0)));
            prop_assume!((nearest_m - needed_m).abs() > 1e-4 || from.dot(&by) > 0.0);
            prop_assert_eq!(keep_apart(&a, &b, least_m), nearest_m >= needed_m);
            prop_assert_eq!(keep_apart(&b, &a, least_m), nearest_m >= needed_m);
        }
    }

    #[test]
    fn close_discs_may_stay_close_but_not_approach() {
        let [a, b] = [Vec2::zeros(), Vec2::new(0.02, 0.0)];
        let go = |from: Vec2, by: Vec2| Segment { from, to: from + by };
        let rest = go(b, Vec2::zeros());
        let up = Vec2::new(0.0, 0.01);
        assert!(keep_apart(&go(a, up), &go(b, up), 0.05) && keep_apart(&go(a, -up), &rest, 0.05));
        assert!(!keep_apart(&go(a, Vec2::new(1e-4, 0.0)), &rest, 0.05));
        let discs = vec![PartOutline { kind: 0, radius_m: 0.01 }; 2];
        let problem = MultiDiscProblem::new(discs, 0.1, vec![a, b + Vec2::new(0.0015, 0.0)]);
        assert!(
            (problem.least_m(0, 1, 0.003) - 0.0215).abs() < 1e-15
                && (problem.least_m(0, 1, 0.001) - 0.021).abs() < 1e-15
        );
        assert!((problem.reach_m(0) - 0.0885).abs() < 1e-15);
    }
}
