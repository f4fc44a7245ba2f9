//! Search for the motion of the next segment: damped least squares as for a pulse from rest, on drifts instead of ends.

use nalgebra::{DMatrix, DVector};

use super::aims::{CLOSING_PER_S, Goal, MovingPart};
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
/// Missing speed per missing gap, 1/s.
const RATE: f64 = STRICT * CLOSING_PER_S;
/// Instants in a period at which the parts' courses are observed.
const INSTANTS: usize = 16;
/// Share of the gap to keep that is kept under way, where parts sway: forecasts err by less.
const KEPT: f64 = 0.5;
/// Missing gap that nobody sees, m: half of a forecast's error.
const UNSEEN_M: f64 = 0.15e-3;
/// Gap of a pair, and distance from the edge, within which it may need a guard, m.
const NEAR_PAIR_M: f64 = 0.03;
const NEAR_EDGE_M: f64 = 0.02;

/// The search for one segment.
#[derive(Clone, Copy)]
pub(super) struct SegmentProblem<'a> {
    pub model: &'a MovingModel,
    pub params: &'a PlannerParams,
    pub last: &'a Motion,
    pub parts: &'a [MovingPart],
    pub discs: &'a [RolloutDisc],
    /// Parts beside the edge.
    pub edges: &'a [NearEdge],
    pub goal: &'a Goal,
    pub pool: &'a RolloutPool,
}

/// Something that a part keeps away from.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Obstacle {
    Part(usize),
    /// A side of the plate, by the unit vector away from it.
    Side(Vec2),
}

/// A part and an obstacle that end too close or close in too fast, or come too close under way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Guard {
    part: usize,
    from: Obstacle,
    /// Unit vector away from the obstacle.
    normal: Vec2,
    /// The step before which they are too close under way.
    pub step: Option<usize>,
    /// Missing speed, m/s, or distance, m.
    pub missing: f64,
}

impl Guard {
    /// True for guards of the same gap, at the end or under way within `steps` of each other.
    pub fn is_of(&self, other: &Self, steps: usize) -> bool {
        let is_near = match (self.step, other.step) {
            (Some(a), Some(b)) => a.abs_diff(b) <= steps,
            (a, b) => a == b,
        };
        (self.part, self.from) == (other.part, other.from) && is_near
    }

    /// The parts whose places count, and the directions along which they do.
    fn terms(&self) -> impl Iterator<Item = (usize, Vec2)> {
        let other = if let Obstacle::Part(other) = self.from { Some((other, -self.normal)) } else { None };
        [(self.part, self.normal)].into_iter().chain(other)
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
    fn window(&self) -> usize {
        self.model.basis.steps_a_period()
    }

    /// The steps that are judged: those of a period after the cross-fade, or of the last segment's decay, too.
    fn judged(&self) -> usize {
        2 * self.window()
    }

    /// The motion `coefficients` as strong as it can be, and its effect.
    pub fn shot(&self, coefficients: &[f64]) -> Shot {
        self.effect(Motion::strongest(self.model, self.edges, coefficients, self.last))
    }

    /// The motion `coefficients`, weakened where it is too strong, and its effect.
    pub fn within_limits(&self, coefficients: &[f64]) -> Shot {
        self.effect(Motion::within_limits(self.model, self.edges, coefficients, self.last))
    }

    /// The parts over the first `steps` of `motion`.
    fn rollout(&self, motion: &Motion, steps: usize) -> Rollout {
        let mut rollout = self.pool.take();
        let plates = [self.last.plate.as_slice(), motion.plate.as_slice()];
        let envelope = Envelope { sustain_s: self.goal.sustain_s(&self.model.envelope), ..self.model.envelope };
        rollout.run_faded(&self.model.basis, plates, (&envelope, 0..steps), self.discs);
        rollout
    }

    /// True where all gaps are kept until `motion` has faded out, no other one following it, and the parts rest.
    pub fn is_clear(&self, motion: &Motion) -> bool {
        let steps = 3 * self.window();
        let rollout = self.rollout(motion, steps);
        let is_clear = self.under_way(&rollout, steps, -RATE * UNSEEN_M).is_empty();
        self.pool.keep(rollout);
        is_clear
    }

    fn effect(&self, motion: Motion) -> Shot {
        let rollout = self.rollout(&motion, self.judged());
        let (residual, guards): (Vec<Vec2>, _) = match self.goal {
            Goal::Drifts { rates, aims_mps } => {
                let drifts_mps = rollout.drifts_mps(&self.model.basis, self.window());
                let places_m: Vec<Vec2> = rollout.last().map(|(place_m, _)| place_m).collect();
                let each = drifts_mps.iter().zip(&places_m).zip(rates).zip(aims_mps);
                let residual = each.map(|(((drift, place), rate), aim)| drift + place * *rate - aim).collect();
                (residual, self.guards(&places_m, Some(&drifts_mps), 0.0))
            }
            Goal::Ends => {
                let off = rollout.ends_m.iter().zip(self.parts).map(|(end, part)| end - part.target_m).collect();
                (off, self.guards(&rollout.ends_m, None, 0.0))
            }
        };
        let residual = DVector::from_iterator(2 * residual.len(), residual.iter().flat_map(|r| [r.x, r.y]));
        let guarded: f64 = guards.iter().map(|guard| guard.missing * guard.missing).sum();
        let cost = residual.norm_squared() + GUARD * GUARD * guarded;
        Shot { motion, rollout, residual, guards, cost }
    }

    /// All pairs and edges with no more than `spare` left.
    pub fn gaps(&self, shot: &Shot, spare: f64) -> Vec<Guard> {
        if let Goal::Ends = self.goal {
            return self.guards(&shot.rollout.ends_m, None, spare);
        }
        let drifts_mps = shot.rollout.drifts_mps(&self.model.basis, self.window());
        let places_m: Vec<Vec2> = shot.rollout.last().map(|(place_m, _)| place_m).collect();
        self.guards(&places_m, Some(&drifts_mps), spare)
    }

    /// Guards of the gaps in the segment, before the next one follows.
    pub fn within(&self, shot: &Shot, spare: f64) -> Vec<Guard> {
        self.under_way(&shot.rollout, self.window(), spare)
    }

    /// A guard of each gap that becomes less than it should be up to the step `until`, at the instant when it is least;
    /// of all with no more than `spare` left.
    fn under_way(&self, rollout: &Rollout, until: usize, spare: f64) -> Vec<Guard> {
        let every = self.window() / INSTANTS;
        let course = (0..=until).step_by(every).zip(rollout.places_m(every));
        let course: Vec<(usize, Vec<Vec2>)> = course.collect();
        let least = |(part, from)| {
            let gaps = course.iter().map(|(step, places_m)| (*step, self.gap(part, from, |part| places_m[part])));
            let (step, (gap_m, normal)) = gaps.min_by(|(_, (a, _)), (_, (b, _))| a.total_cmp(b))?;
            let missing = RATE * (self.kept_m(part, from) - gap_m);
            (step > 0 && missing > -spare).then_some(Guard { part, from, normal, step: Some(step), missing })
        };
        self.obstacles().filter_map(least).collect()
    }

    /// The guard of the same gap as it is in `shot`; `None` where it is wide at the end.
    pub fn in_shot(&self, guard: &Guard, shot: &Shot) -> Option<Guard> {
        let &Guard { part, from, step: Some(step), .. } = guard else {
            return self.gaps(shot, f64::INFINITY).into_iter().find(|gap| gap.is_of(guard, 0));
        };
        let places_m = shot.rollout.places_at(step);
        let (gap_m, normal) = self.gap(part, from, |part| places_m[part]);
        Some(Guard { normal, missing: RATE * (self.kept_m(part, from) - gap_m), ..*guard })
    }

    /// The gap to keep under way, m: not more than there is at the beginning.
    fn kept_m(&self, part: usize, from: Obstacle) -> f64 {
        let place_m = |part: usize| self.discs[part].position_m;
        self.gap(part, from, place_m).0.min(KEPT * self.margin_m(part, from))
    }

    fn obstacles(&self) -> impl Iterator<Item = (usize, Obstacle)> {
        let sides = [Vec2::x(), -Vec2::x(), Vec2::y(), -Vec2::y()].map(Obstacle::Side);
        let of_part = move |part| (0..part).map(Obstacle::Part).chain(sides).map(move |from| (part, from));
        (0..self.parts.len()).flat_map(of_part)
    }

    /// The gap between a part and an obstacle, m, and the unit vector that widens it.
    fn gap(&self, part: usize, from: Obstacle, place_m: impl Fn(usize) -> Vec2) -> (f64, Vec2) {
        let radius_m = self.parts[part].disc.radius_m;
        match from {
            Obstacle::Part(other) => {
                let apart_m = place_m(part) - place_m(other);
                let distance_m = apart_m.norm();
                let normal = apart_m / distance_m.max(f64::MIN_POSITIVE);
                (distance_m - radius_m - self.parts[other].disc.radius_m, normal)
            }
            Obstacle::Side(inwards) => (self.params.half_side_m - radius_m + inwards.dot(&place_m(part)), inwards),
        }
    }

    /// The gap to keep, m.
    fn margin_m(&self, part: usize, from: Obstacle) -> f64 {
        match from {
            Obstacle::Part(_) => self.params.separation_m,
            Obstacle::Side(_) => self.parts[part].edge_margin_m(self.params),
        }
    }

    /// Pairs and edges at `places_m` that are closed in on too fast with these drifts or nearly so, with no more than
    /// `spare` left; without drifts, that are too close.
    fn guards(&self, places_m: &[Vec2], drifts_mps: Option<&[Vec2]>, spare: f64) -> Vec<Guard> {
        let rate = if drifts_mps.is_some() { RATE } else { 1.0 };
        let speed = |part: usize| drifts_mps.map_or(Vec2::zeros(), |drifts| drifts[part]);
        let guard = |(part, from)| {
            let (gap_m, normal) = self.gap(part, from, |part| places_m[part]);
            let (near_m, other_mps) = match from {
                Obstacle::Part(other) => (NEAR_PAIR_M, speed(other)),
                Obstacle::Side(_) => (NEAR_EDGE_M, Vec2::zeros()),
            };
            let missing = rate * (self.margin_m(part, from) - gap_m) - normal.dot(&(speed(part) - other_mps));
            (gap_m < near_m && missing > -spare).then_some(Guard { part, from, normal, step: None, missing })
        };
        self.obstacles().filter_map(guard).collect()
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
            let next = self.shot(&self.changed(&shot.motion.coefficients, &change));
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
        let columns = self.guard_columns(shot, &self.gap_slopes(shot), &shot.guards) * GUARD;
        let first = slopes.ncols();
        let mut all = slopes.resize_horizontally(first + columns.ncols(), 0.0);
        all.columns_mut(first, columns.ncols()).copy_from(&columns);
        all
    }

    /// Slopes of the residuals.
    pub fn task_slopes(&self, shot: &Shot) -> DMatrix<f64> {
        let basis = &self.model.basis;
        let mut slopes = match self.goal {
            Goal::Drifts { rates, .. } => shot.rollout.drift_slopes(basis, self.window(), rates),
            Goal::Ends => shot.rollout.slopes(basis),
        };
        self.price(&mut slopes);
        slopes
    }

    /// Slopes of what guards are made of, x and y of each part in turn.
    pub fn gap_slopes(&self, shot: &Shot) -> DMatrix<f64> {
        let basis = &self.model.basis;
        let mut slopes = match self.goal {
            Goal::Drifts { .. } => shot.rollout.drift_slopes(basis, self.window(), &vec![RATE; self.parts.len()]),
            Goal::Ends => shot.rollout.slopes(basis),
        };
        self.price(&mut slopes);
        slopes
    }

    /// Slopes of each guard, a column for each; those of the end from `of_parts`.
    pub fn guard_columns(&self, shot: &Shot, of_parts: &DMatrix<f64>, guards: &[Guard]) -> DMatrix<f64> {
        let mut columns = DMatrix::zeros(of_parts.nrows(), guards.len());
        let (mut rows, mut columns_of_rows) = (Vec::new(), Vec::new());
        for (index, guard) in guards.iter().enumerate() {
            for (part, along) in guard.terms() {
                if let Some(step) = guard.step {
                    rows.push((part, step, along));
                    columns_of_rows.push(index);
                    continue;
                }
                for axis in 0..2 {
                    columns.column_mut(index).axpy(along[axis], &of_parts.column(2 * part + axis), 1.0);
                }
            }
        }
        let mut slopes = shot.rollout.slopes_along(&self.model.basis, &rows);
        self.price(&mut slopes);
        for (index, slopes) in columns_of_rows.into_iter().zip(slopes.column_iter()) {
            columns.column_mut(index).axpy(RATE, &slopes, 1.0);
        }
        columns
    }

    fn price(&self, slopes: &mut DMatrix<f64>) {
        slopes.row_iter_mut().zip(&self.model.prices).for_each(|(mut row, price)| row /= *price);
    }
}
