//! Limits of a synthesised field at the plate's edge and between the parts' rims: linear for the steps, exact for a
//! forecast.

use crate::planner::{Limit, PartState, PlannerParams};
use upm_core::geometry::{Segment, Vec2};

/// Slack below which a limit counts as kept, m.
const ROUNDING_M: f64 = 1e-7;

/// The limit that flat steps break most, to first order; `None` when they keep all. A limit that is already broken may
/// stay so but not get worse.
pub(super) fn most_violated(parts: &[PartState], params: &PlannerParams, steps_m: &[f64]) -> Option<Limit> {
    let step_m = |part: usize| Vec2::new(steps_m[2 * part], steps_m[2 * part + 1]);
    let mut worst = (0.0, None);
    let mut note = |excess_m: f64, limit: Limit| {
        if excess_m > worst.0 {
            worst = (excess_m, Some(limit));
        }
    };
    for (i, part) in parts.iter().enumerate() {
        for normal in [Vec2::x(), -Vec2::x(), Vec2::y(), -Vec2::y()] {
            let room_m = edge_bound_m(part, params) - normal.dot(&part.position_m);
            note(normal.dot(&step_m(i)) - room_m.max(0.0), Limit::Edge { part: i });
        }
    }
    for (i, a) in parts.iter().enumerate() {
        for (j, b) in parts.iter().enumerate().skip(i + 1) {
            let apart = b.position_m - a.position_m;
            if let Some(normal) = apart.try_normalize(0.0) {
                let room_m = apart.norm() - a.radius_m - b.radius_m - params.separation_m;
                let excess_m = normal.dot(&step_m(i)) - normal.dot(&step_m(j)) - room_m.max(0.0);
                note(excess_m, Limit::Separation { parts: [i, j] });
            }
        }
    }
    worst.1
}

fn edge_bound_m(part: &PartState, params: &PlannerParams) -> f64 {
    params.half_side_m - part.radius_m - params.edge_margin_m
}

/// Fraction of edge margin and separation that a sequence may use up along its path; the plan as a whole keeps all of
/// both.
pub(super) const ON_THE_WAY: f64 = 0.5;

/// Assumed error of a forecast, relative to its step.
const UNSURE: f64 = 0.05;

/// The limits that a whole sequence keeps: each as configured, or the value at the start where that was worse.
#[derive(Clone, Debug)]
pub(super) struct Clearances {
    /// For each part the configured largest |x| or |y|, m.
    asked_bound_m: Vec<f64>,
    /// For each part the larger of that and its value at the start, m.
    bound_m: Vec<f64>,
    /// For each pair i < j, row by row, the configured smallest distance of centres, and the smaller of that and the
    /// one at the start, m.
    distance_m: Vec<(f64, f64)>,
}

impl Clearances {
    /// Limits for parts at their present positions.
    pub fn of(parts: &[PartState], params: &PlannerParams) -> Self {
        let spare_m = ON_THE_WAY * params.edge_margin_m.max(0.0);
        let asked_bound_m: Vec<f64> = parts.iter().map(|p| edge_bound_m(p, params) + spare_m).collect();
        let bound_m =
            parts.iter().zip(&asked_bound_m).map(|(p, asked_m)| asked_m.max(p.position_m.amax()) + ROUNDING_M);
        let distance = |a: &PartState, b: &PartState| {
            let asked_m = a.radius_m + b.radius_m + (1.0 - ON_THE_WAY) * params.separation_m;
            (asked_m, ((a.position_m - b.position_m).norm().min(asked_m) - ROUNDING_M).max(0.0))
        };
        let pairs = parts.iter().enumerate().flat_map(|(i, a)| parts[i + 1..].iter().map(move |b| distance(a, b)));
        Self { bound_m: bound_m.collect(), distance_m: pairs.collect(), asked_bound_m }
    }

    /// The first limit broken while all parts move in straight lines from `before` to `after`, in step: a piece of a
    /// forecast path that began at `start_m`. A limit is kept with an allowance for the forecast's error, which grows
    /// along the path, unless the parts move away from it. A limit that is broken at the start may be broken by
    /// `sway_m` more, because shaken parts sway.
    pub fn broken_after(&self, start_m: &[Vec2], before_m: &[Vec2], after_m: &[Vec2], sway_m: f64) -> Option<Limit> {
        let unsure_m: Vec<f64> = start_m.iter().zip(after_m).map(|(s, a)| UNSURE * (a - s).norm()).collect();
        for (part, (start, after)) in start_m.iter().zip(after_m).enumerate() {
            let asked_m = self.asked_bound_m[part];
            let sway_m = if start.amax() > asked_m { sway_m } else { 0.0 };
            let careful_m = (asked_m - unsure_m[part]).max(start.amax() + ROUNDING_M + sway_m);
            if after.amax() > careful_m.min(self.bound_m[part] + sway_m) {
                return Some(Limit::Edge { part });
            }
        }
        let mut pairs = self.distance_m.iter();
        for i in 0..after_m.len() {
            for j in i + 1..after_m.len() {
                let (asked_m, least_m) = pairs.next().copied().unwrap_or_default();
                let at_first_m = (start_m[i] - start_m[j]).norm();
                let sway_m = if at_first_m < asked_m { sway_m } else { 0.0 };
                let careful_m = (asked_m + unsure_m[i] + unsure_m[j]).min(at_first_m - ROUNDING_M - sway_m);
                let apart = Segment { from: before_m[i] - before_m[j], to: after_m[i] - after_m[j] };
                if apart.nearest(Vec2::zeros()).norm_squared() < careful_m.max(least_m - sway_m).max(0.0).powi(2) {
                    return Some(Limit::Separation { parts: [i, j] });
                }
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planner::fixture::{HALF_SIDE_M, PENNY_M, params, penny};

    #[test]
    fn a_limit_that_is_broken_may_stay_but_not_get_worse() {
        let over = penny(Vec2::new(HALF_SIDE_M, 0.0), Vec2::zeros());
        let near = penny(Vec2::new(HALF_SIDE_M - 2.0 * PENNY_M, 0.0), Vec2::zeros());
        let violated = |steps_m: &[f64]| most_violated(&[over, near], &params(), steps_m);
        assert_eq!(violated(&[0.0; 4]), None);
        assert_eq!(violated(&[0.001, 0.0, 0.0, 0.0]), Some(Limit::Edge { part: 0 }));
        assert_eq!(violated(&[-0.001, 0.0, 0.001, 0.0]), Some(Limit::Separation { parts: [0, 1] }));
        let clearances = Clearances::of(&[over, near], &params());
        let at = [over.position_m, near.position_m];
        let broken_by = |after_m: &[Vec2]| clearances.broken_after(&at, &at, after_m, 0.0);
        assert_eq!(broken_by(&at), None);
        assert_eq!(broken_by(&[at[0] + Vec2::new(1e-4, 0.0), at[1]]), Some(Limit::Edge { part: 0 }));
        let closer = [at[0], at[1] + Vec2::new(1e-4, 0.0)];
        assert_eq!(broken_by(&closer), Some(Limit::Separation { parts: [0, 1] }));
    }
}
