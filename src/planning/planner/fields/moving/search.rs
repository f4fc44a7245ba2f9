//! Search for the motion of the next segment: damped least squares as for a pulse from rest, on drifts instead of ends.

use nalgebra::{DMatrix, DVector};

use super::aims::{CLOSING_PER_S, MovingPart, Wish};
use super::model::MovingModel;
use super::motion::{Motion, NearEdge};
use crate::planner::PlannerParams;
use crate::planner::fields::optimizer::{NARROWER, RAISED, REACH, RolloutPool, WIDER, WIDEST, damped_change};
use crate::planner::fields::rollout::{Rollout, RolloutDisc};
use upm_core::geometry::Vec2;
use upm_core::signal::Envelope;

/// Weight of a guard relative to a part's own residual.
const GUARD: f64 = 5.0;
/// Closing speed per gap that a guard allows, relative to that of the wishes.
const STRICT: f64 = 1.3;
/// Gap of a pair, and distance from the edge, within which it may need a guard, m.
const NEAR_PAIR_M: f64 = 0.03;
const NEAR_EDGE_M: f64 = 0.02;

/// The search for one segment.
pub(super) struct SegmentProblem<'a> {
    pub model: &'a MovingModel,
    pub params: &'a PlannerParams,
    pub last: &'a Motion,
    pub parts: &'a [MovingPart],
    pub discs: Vec<RolloutDisc>,
    /// Parts beside the edge.
    pub edges: Vec<NearEdge>,
    /// The drifts at its end; `None` for a segment after which the parts rest at their targets.
    pub wish: Option<&'a Wish>,
    pub pool: &'a RolloutPool,
}

/// A pair of parts, or a part and the edge, that end too close or close in too fast.
#[derive(Clone, Copy, Debug)]
pub(super) struct Guard {
    part: usize,
    other: Option<usize>,
    /// Unit vector away from the other part or the edge.
    normal: Vec2,
    /// Missing speed, m/s, or distance, m.
    pub missing: f64,
}

impl Guard {
    /// True for guards of the same pair, or of the same part and side.
    pub fn is_of(&self, other: &Self) -> bool {
        let same_side = self.other.is_some() || self.normal.dot(&other.normal) > 0.5;
        (self.part, self.other) == (other.part, other.other) && same_side
    }
}

/// A motion and its effect.
#[derive(Clone, Debug)]
pub(super) struct Shot {
    pub motion: Motion,
    pub rollout: Rollout,
    /// Remaining error of each part, x and y in turn: m/s, or m.
    pub residual: DVector<f64>,
    pub guards: Vec<Guard>,
    pub cost: f64,
}

impl Shot {
    /// The largest residual of a part.
    pub fn worst(&self) -> f64 {
        self.residual.as_slice().chunks_exact(2).map(|r| Vec2::new(r[0], r[1]).norm()).fold(0.0, f64::max)
    }
}

impl SegmentProblem<'_> {
    /// The motion `coefficients`, as strong as it can be where it asks for more than `least` of the limits, and its
    /// effect: over a period after the cross-fade, or over the last segment's decay, too.
    pub fn shot(&self, coefficients: &[f64], least: f64) -> Shot {
        let motion = Motion::scaled(self.model, &self.edges, coefficients, self.last, least);
        let mut rollout = self.pool.take();
        let plates = [self.last.plate.as_slice(), motion.plate.as_slice()];
        // a segment that sets the parts down decays as soon as it has risen
        let sustain_s = self.wish.map_or(0.0, |_| self.model.envelope.sustain_s);
        let envelope = Envelope { sustain_s, ..self.model.envelope };
        let judged = 0..2 * self.model.basis.steps_a_period();
        rollout.run_faded(&self.model.basis, plates, (&envelope, judged), &self.discs);
        let (places_m, drifts_mps) = self.places_and_drifts(&rollout);
        let residual: Vec<Vec2> = match self.wish {
            Some(Wish { rates, aims_mps, .. }) => {
                let each = drifts_mps.iter().zip(&places_m).zip(rates).zip(aims_mps);
                each.map(|(((drift, place), rate), aim)| drift + place * *rate - aim).collect()
            }
            None => places_m.iter().zip(self.parts).map(|(end, part)| end - part.target_m).collect(),
        };
        let residual = DVector::from_iterator(2 * residual.len(), residual.iter().flat_map(|r| [r.x, r.y]));
        let guards = self.guards(&rollout, 0.0);
        let guarded: f64 = guards.iter().map(|guard| guard.missing * guard.missing).sum();
        let cost = residual.norm_squared() + GUARD * GUARD * guarded;
        Shot { motion, rollout, residual, guards, cost }
    }

    /// Places, m, and drifts, m/s, at the end of the segment, or where the parts rest after it.
    fn places_and_drifts(&self, rollout: &Rollout) -> (Vec<Vec2>, Vec<Vec2>) {
        if self.wish.is_none() {
            return (rollout.ends_m.clone(), vec![Vec2::zeros(); self.parts.len()]);
        }
        let drifts_mps = rollout.drifts_mps(&self.model.basis, self.model.basis.steps_a_period());
        (rollout.last().map(|(place_m, _)| place_m).collect(), drifts_mps)
    }

    /// Pairs and edges that are closed in on too fast or nearly so, with no more than `spare` left; where the parts
    /// rest, those that are too close.
    pub fn guards(&self, rollout: &Rollout, spare: f64) -> Vec<Guard> {
        let rate = if self.wish.is_some() { STRICT * CLOSING_PER_S } else { 1.0 };
        let (places_m, drifts_mps) = self.places_and_drifts(rollout);
        let mut guards = Vec::new();
        let mut note = |part: usize, other: Option<usize>, normal: Vec2, gap_m: f64, margin_m: f64| {
            let relative = drifts_mps[part] - other.map_or(Vec2::zeros(), |other| drifts_mps[other]);
            let missing = rate * (margin_m - gap_m) - normal.dot(&relative);
            if missing > -spare {
                guards.push(Guard { part, other, normal, missing });
            }
        };
        for (i, (a_m, a)) in places_m.iter().zip(self.parts).enumerate() {
            for (j, (b_m, b)) in places_m[..i].iter().zip(self.parts).enumerate() {
                let apart_m = a_m - b_m;
                let gap_m = apart_m.norm() - a.disc.radius_m - b.disc.radius_m;
                if let Some(normal) = apart_m.try_normalize(0.0).filter(|_| gap_m < NEAR_PAIR_M) {
                    note(i, Some(j), normal, gap_m, self.params.separation_m);
                }
            }
            for axis in 0..2 {
                let gap_m = self.params.half_side_m - a.disc.radius_m - a_m[axis].abs();
                if gap_m < NEAR_EDGE_M {
                    let mut normal = Vec2::zeros();
                    normal[axis] = if a_m[axis] > 0.0 { -1.0 } else { 1.0 };
                    note(i, None, normal, gap_m, a.edge_margin_m(self.params));
                }
            }
        }
        guards
    }

    /// Improves `shot` in `rounds` rounds.
    pub fn improved(&self, mut shot: Shot, rounds: usize) -> Shot {
        let (mut reach, mut raised, mut slopes) = (REACH, RAISED, None);
        for _ in 0..rounds {
            let of_shot = slopes.get_or_insert_with(|| self.slopes(&shot));
            let missing = shot.residual.iter().map(|r| -r).chain(shot.guards.iter().map(|g| GUARD * g.missing));
            let missing = DVector::from_iterator(of_shot.ncols(), missing);
            let length: f64 = self.priced(&shot.motion.coefficients).iter().map(|c| c * c).sum();
            let Some(change) = damped_change(of_shot, &missing, reach * length.sqrt(), &mut raised) else { break };
            let next = self.shot(&self.changed(&shot.motion.coefficients, &change), 0.0);
            if next.cost < shot.cost {
                (reach, slopes) = ((WIDER * reach).min(WIDEST), None);
                self.pool.keep(std::mem::replace(&mut shot, next).rollout);
            } else {
                reach *= NARROWER;
                self.pool.keep(next.rollout);
            }
        }
        shot
    }

    /// The coefficients as their prices measure them.
    pub fn priced(&self, coefficients: &[f64]) -> Vec<f64> {
        coefficients.iter().zip(&self.model.prices).map(|(c, price)| c * price).collect()
    }

    /// The coefficients after `change`, as prices measure it.
    pub fn changed(&self, coefficients: &[f64], change: &DVector<f64>) -> Vec<f64> {
        let changes = change.iter().zip(&self.model.prices);
        coefficients.iter().zip(changes).map(|(c, (change, price))| c + change / price).collect()
    }

    /// Slopes of residuals and guards, a column for each, by coefficients as the prices measure them.
    fn slopes(&self, shot: &Shot) -> DMatrix<f64> {
        let slopes = self.task_slopes(shot);
        if shot.guards.is_empty() {
            return slopes;
        }
        let columns = self.guard_columns(&self.gap_slopes(shot), &shot.guards) * GUARD;
        let first = slopes.ncols();
        let mut all = slopes.resize_horizontally(first + columns.ncols(), 0.0);
        all.columns_mut(first, columns.ncols()).copy_from(&columns);
        all
    }

    /// Slopes of the residuals.
    pub fn task_slopes(&self, shot: &Shot) -> DMatrix<f64> {
        self.part_slopes(shot, |wish| wish.rates.clone())
    }

    /// Slopes of what guards are made of, x and y of each part in turn.
    pub fn gap_slopes(&self, shot: &Shot) -> DMatrix<f64> {
        self.part_slopes(shot, |wish| vec![STRICT * CLOSING_PER_S; wish.rates.len()])
    }

    /// Slopes of each part's drift plus `rates` times its place, or of the place where it rests.
    fn part_slopes(&self, shot: &Shot, rates: impl Fn(&Wish) -> Vec<f64>) -> DMatrix<f64> {
        let basis = &self.model.basis;
        let mut slopes = match self.wish {
            Some(wish) => shot.rollout.drift_slopes(basis, basis.steps_a_period(), &rates(wish)),
            None => shot.rollout.slopes(basis),
        };
        slopes.row_iter_mut().zip(&self.model.prices).for_each(|(mut row, price)| row /= *price);
        slopes
    }

    /// Slopes of each guard, a column for each, from those of the parts.
    pub fn guard_columns(&self, of_parts: &DMatrix<f64>, guards: &[Guard]) -> DMatrix<f64> {
        let mut columns = DMatrix::zeros(of_parts.nrows(), guards.len());
        for (mut column, guard) in columns.column_iter_mut().zip(guards) {
            for axis in 0..2 {
                column.axpy(guard.normal[axis], &of_parts.column(2 * guard.part + axis), 1.0);
                if let Some(other) = guard.other {
                    column.axpy(-guard.normal[axis], &of_parts.column(2 * other + axis), 1.0);
                }
            }
        }
        columns
    }
}
