//! Directions in which parts must not go astray: towards each other, over the edge.

use crate::geometry::Vec2;
use crate::planner::{Limit, PartState};

/// How much more a guarded direction counts than any other.
const WEIGHT: f64 = 4.0;

/// What is missing along `normal`, of one part or between two.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Guard {
    pub limit: Limit,
    normal: Vec2,
    part: usize,
    other: Option<usize>,
}

impl Guard {
    /// For `limit` as the parts lie; `None` for a limit without a direction.
    pub fn of_limit(limit: Limit, parts: &[PartState]) -> Option<Self> {
        match limit {
            Limit::Edge { part } => {
                let p = parts.get(part)?.position_m;
                let normal = if p.x.abs() > p.y.abs() { Vec2::x() } else { Vec2::y() };
                Some(Self { limit, normal, part, other: None })
            }
            Limit::Separation { parts: [a, b] } => {
                let normal = (parts.get(b)?.position_m - parts.get(a)?.position_m).try_normalize(0.0)?;
                Some(Self { limit, normal, part: a, other: Some(b) })
            }
            Limit::Unreachable => None,
        }
    }

    /// Its factors of the flat vector x, y of every part.
    pub fn terms(&self) -> impl Iterator<Item = (usize, f64)> {
        let of = |part: usize, sign: f64| {
            let along = self.normal * (sign * WEIGHT);
            [(2 * part, along.x), (2 * part + 1, along.y)]
        };
        of(self.part, 1.0).into_iter().chain(self.other.map(|other| of(other, -1.0)).into_iter().flatten())
    }

    /// Its share of a flat vector.
    pub fn of(&self, flat: &[f64]) -> f64 {
        self.terms().map(|(i, factor)| flat.get(i).map_or(0.0, |v| v * factor)).sum()
    }
}
