//! Separation penalties: directions in which parts must move away from each other or from the edge.

use crate::planner::{Limit, PartState};
use upm_core::geometry::Vec2;

/// Weight of a penalised direction, relative to any other.
const WEIGHT: f64 = 4.0;

/// Distance that a part should gain from another or from the edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SeparationPenalty {
    pub limit: Limit,
    /// Unit vector away from the other part or the edge.
    normal: Vec2,
    part: usize,
    other: Option<usize>,
    aim_m: f64,
}

impl SeparationPenalty {
    /// Penalty on `limit` at the parts' present positions; it asks for the distance that their steps make. `None` for a
    /// limit without a direction.
    pub fn of_limit(limit: Limit, parts: &[PartState], steps_m: &[f64]) -> Option<Self> {
        let (normal, part, other) = match limit {
            Limit::Edge { part } => {
                let p = parts.get(part)?.position_m;
                let inwards = if p.x.abs() > p.y.abs() { Vec2::new(-p.x, 0.0) } else { Vec2::new(0.0, -p.y) };
                (inwards.try_normalize(0.0)?, part, None)
            }
            Limit::Separation { parts: [a, b] } => {
                ((parts.get(a)?.position_m - parts.get(b)?.position_m).try_normalize(0.0)?, a, Some(b))
            }
            Limit::Unreachable => return None,
        };
        let free = Self { limit, normal, part, other, aim_m: 0.0 };
        Some(Self { aim_m: free.along(steps_m), ..free })
    }

    /// Penalties of every pair of parts with a gap below `separation_m`; each asks for at least the missing distance.
    pub fn of_near(parts: &[PartState], separation_m: f64, steps_m: &[f64]) -> Vec<Self> {
        let pairs = (0..parts.len()).flat_map(|a| (a + 1..parts.len()).map(move |b| [a, b]));
        let near = pairs.filter_map(|pair| {
            let [a, b] = pair.map(|part| parts[part]);
            let missing_m = a.radius_m + b.radius_m + separation_m - (a.position_m - b.position_m).norm();
            let penalty = Self::of_limit(Limit::Separation { parts: pair }, parts, steps_m)?;
            (missing_m > 0.0).then(|| Self { aim_m: penalty.aim_m.max(missing_m), ..penalty })
        });
        near.collect()
    }

    /// Raises the distance asked for by `by_m`, and to no less than `by_m`.
    pub fn push(&mut self, by_m: f64) {
        self.aim_m = self.aim_m.max(0.0) + by_m;
    }

    /// Indices and factors of the flat vector (x, y of every part) in this penalty's residual.
    pub fn terms(&self) -> impl Iterator<Item = (usize, f64)> {
        let of = |part: usize, sign: f64| {
            let along = self.normal * (sign * WEIGHT);
            [(2 * part, along.x), (2 * part + 1, along.y)]
        };
        of(self.part, 1.0).into_iter().chain(self.other.map(|other| of(other, -1.0)).into_iter().flatten())
    }

    /// Weighted distance still missing after displacements of `went_m`, m.
    pub fn missing(&self, went_m: &[f64]) -> f64 {
        WEIGHT * (self.aim_m - self.along(went_m))
    }

    /// Distance gained by flat displacements, m.
    fn along(&self, flat_m: &[f64]) -> f64 {
        self.terms().map(|(i, factor)| flat_m.get(i).map_or(0.0, |v| v * factor / WEIGHT)).sum()
    }
}
