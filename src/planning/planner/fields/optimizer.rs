//! Search for a motion whose pulse gives every part its step.
//!
//! Damped least squares on the parts' final positions (Levenberg, Marquardt), with two additions. A change of the
//! motion is measured by the motor counts it requires, and no change exceeds a fixed share of the motion. After every
//! change the motion is scaled up to the motors' limit: strong motions carry parts fast and hardly brake moving ones.
//!
//! Errors count with their squares, so a part far from its end may drift a little sideways if that advances the parts
//! as a whole. With reachable ends the drift vanishes as the search converges.

use std::cell::RefCell;

use nalgebra::{DMatrix, DVector};

use super::harmonic_basis::HarmonicBasis;
use super::motor_effort::MotorEffort;
use super::rollout::{Rollout, RolloutDisc};
use super::separation::SeparationPenalty;
use crate::planner::Corridor;
use crate::planner::corridor::UNSEEN_M;
use upm_core::geometry::Vec2;
use upm_core::signal::Envelope;

/// Trust region: longest change of a motion, relative to the motion, at first; its factors after a success and a
/// failure, and its bounds.
pub(super) const REACH: f64 = 0.3;
pub(super) const WIDER: f64 = 1.6;
pub(super) const WIDEST: f64 = 0.8;
pub(super) const NARROWER: f64 = 0.35;
const NARROWEST: f64 = 0.01;
/// Levenberg-Marquardt damping: least value relative to the mean eigenvalue, factor of each raise, number of raises at
/// first and at most.
const DAMPING: f64 = 1e-5;
const MORE_DAMPING: f64 = 3.0;
pub(super) const RAISED: i32 = 6;
const MOST_RAISED: i32 = 64;
/// A start is softened when its best scale factor is below this.
const SOFTEN: f64 = 0.8;
/// Relative remaining error at which the search ends early.
const GOOD: f64 = 0.02;

/// Share of a corridor's half width within which a part may sway: the low harmonics, which carry parts fastest, sway
/// them, too.
const FREE: f64 = 0.2;
/// Instants of a pulse at which the distance from a corridor's line is observed; it counts as an error at the end does.
const INSTANTS: usize = 9;

/// Problem of the search: the motions, the parts and their steps.
#[derive(Clone, Copy)]
pub(super) struct ShootingProblem<'a> {
    pub basis: &'a HarmonicBasis,
    pub effort: &'a MotorEffort,
    pub discs: &'a [RolloutDisc],
    /// Wanted step of every part, x and y in turn, m.
    pub steps_m: &'a DVector<f64>,
    pub envelope: &'a Envelope,
    /// Directions in which parts must keep their distance.
    pub penalties: &'a [SeparationPenalty],
    /// Corridors of the parts; empty where none has one.
    pub corridors: &'a [Option<Corridor>],
    pub pool: &'a RolloutPool,
}

/// Pool of rollouts no longer in use, kept to reuse their large buffers.
#[derive(Clone, Debug, Default)]
pub(super) struct RolloutPool(RefCell<Vec<Rollout>>);

impl RolloutPool {
    pub fn take(&self) -> Rollout {
        self.0.borrow_mut().pop().unwrap_or_default()
    }

    pub fn keep(&self, rollout: Rollout) {
        self.0.borrow_mut().push(rollout);
    }
}

/// A motion and its effect on the parts.
#[derive(Clone, Debug)]
pub(super) struct Iterate {
    pub coefficients: Vec<f64>,
    pub rollout: Rollout,
    went_m: DVector<f64>,
    /// Distances of its course from the lines of the corridors.
    course: Vec<OffLine>,
    /// Sum of the squared remaining steps, penalties included, m².
    cost: f64,
}

/// A part away from the line of its corridor, in the course of a pulse.
#[derive(Clone, Copy, Debug)]
struct OffLine {
    step: usize,
    part: usize,
    /// Unit vector away from the line.
    normal: Vec2,
    /// Distance beyond the free share of the corridor, m.
    off_m: f64,
}

impl Iterate {
    /// The part that leaves its corridor most, and by how much, m.
    pub fn corridor_excess(&self, corridors: &[Option<Corridor>]) -> Option<(usize, f64)> {
        let excess = |off: &OffLine| {
            let half_width_m = corridors.get(off.part)?.as_ref()?.half_width_m;
            Some((off.part, off.off_m - (1.0 - FREE) * half_width_m)).filter(|(_, by_m)| *by_m > UNSEEN_M)
        };
        self.course.iter().filter_map(excess).max_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Remaining part of the steps: ratio of the root sums of squares.
    pub fn left(&self, steps_m: &DVector<f64>) -> f64 {
        (steps_m - &self.went_m).norm() / steps_m.norm()
    }
}

impl ShootingProblem<'_> {
    /// Iterate of `start` scaled to the motors' limit.
    pub fn iterate(&self, start: &[f64]) -> Iterate {
        let mut coefficients = start.to_vec();
        self.effort.scale(self.basis, &mut coefficients, f64::INFINITY);
        let mut rollout = self.pool.take();
        rollout.run(self.basis, &coefficients, self.envelope, self.discs);
        let went =
            rollout.ends_m.iter().zip(self.discs).flat_map(|(end, disc)| <[f64; 2]>::from(end - disc.position_m));
        let went_m = DVector::from_iterator(self.steps_m.len(), went);
        let missing_m = self.steps_m - &went_m;
        let penalised: f64 = self.penalties.iter().map(|penalty| penalty.missing(went_m.as_slice()).powi(2)).sum();
        let course = self.off_lines(&rollout);
        let off: f64 = course.iter().map(|off| off.off_m.powi(2)).sum();
        Iterate { coefficients, rollout, cost: missing_m.norm_squared() + penalised + off, went_m, course }
    }

    /// The parts with corridors away from their lines, at each instant of observation.
    fn off_lines(&self, rollout: &Rollout) -> Vec<OffLine> {
        let instants = if self.corridors.is_empty() { 0 } else { INSTANTS };
        let at = |instant: usize| {
            let step = rollout.steps() * instant / (INSTANTS + 1);
            let places = rollout.places_at(step).into_iter().zip(self.corridors).enumerate();
            places.filter_map(move |(part, (place_m, corridor))| {
                let corridor = corridor.as_ref()?;
                let off = corridor.off(place_m);
                let (normal, off_m) = (off.try_normalize(0.0)?, off.norm() - FREE * corridor.half_width_m);
                (off_m > 0.0).then_some(OffLine { step, part, normal, off_m })
            })
        };
        (1..=instants).flat_map(at).collect()
    }

    /// Iterate of `start`, weakened where it carries parts too far or backwards. A motion without even harmonics
    /// retraces in the second half of a period its path of the first and carries parts nowhere; net displacement is
    /// therefore roughly proportional to the even harmonics.
    pub fn regularized_step(&self, start: &[f64]) -> Iterate {
        let iterate = self.iterate(start);
        let share = iterate.went_m.dot(self.steps_m) / iterate.went_m.norm_squared();
        if share.is_nan() || share > SOFTEN {
            return iterate;
        }
        let even = |j: usize| self.basis.harmonic_of(j).is_multiple_of(2);
        let soft = |(j, c): (usize, &f64)| if even(j) { c * share.max(0.0) } else { *c };
        let softened = self.iterate(&start.iter().enumerate().map(soft).collect::<Vec<f64>>());
        self.cheaper(softened, iterate)
    }

    fn cheaper(&self, a: Iterate, b: Iterate) -> Iterate {
        let (cheaper, other) = if a.cost < b.cost { (a, b) } else { (b, a) };
        self.pool.keep(other.rollout);
        cheaper
    }

    /// Improves `iterate` in at most `rounds` rounds.
    pub fn improved(&self, mut iterate: Iterate, rounds: usize) -> Iterate {
        let good = (GOOD * self.steps_m.norm()).powi(2);
        let mut reach = REACH;
        let mut slopes = None;
        let mut raised = RAISED;
        for _ in 0..rounds {
            if iterate.cost < good || reach < NARROWEST {
                break;
            }
            let of_iterate = slopes.get_or_insert_with(|| self.slopes(&iterate));
            let Some(change) = self.change(of_iterate, &iterate, reach, &mut raised) else { break };
            let changed: Vec<f64> = iterate.coefficients.iter().zip(&change).map(|(c, d)| c + d).collect();
            let next = self.iterate(&changed);
            if next.cost < iterate.cost {
                slopes = None;
                reach = (WIDER * reach).min(WIDEST);
            } else {
                reach *= NARROWER;
            }
            iterate = self.cheaper(next, iterate);
        }
        iterate
    }

    /// Slopes of the remaining error, penalties included, by motor counts, one column for each.
    fn slopes(&self, iterate: &Iterate) -> DMatrix<f64> {
        let (n, ends) = (self.basis.len(), self.steps_m.len());
        let (penalties, columns) = (self.penalties.len(), ends + self.penalties.len() + iterate.course.len());
        let mut slopes = iterate.rollout.slopes(self.basis).resize_horizontally(columns, 0.0);
        let mut column = ends + penalties;
        for offs in iterate.course.chunk_by(|a, b| a.step == b.step) {
            let mut normals = vec![Vec2::zeros(); self.discs.len()];
            offs.iter().for_each(|off| normals[off.part] = off.normal);
            let by_part = iterate.rollout.slopes_at(self.basis, offs[0].step, &normals);
            for off in offs {
                slopes.set_column(column, &by_part.column(off.part));
                column += 1;
            }
        }
        for (mut row, weight) in slopes.row_iter_mut().zip(&self.effort.weights) {
            row /= weight.sqrt();
        }
        for (k, penalty) in self.penalties.iter().enumerate() {
            let sum = penalty.terms().fold(DVector::zeros(n), |sum, (end, factor)| sum + slopes.column(end) * factor);
            slopes.set_column(ends + k, &sum);
        }
        slopes
    }

    /// The least damped change of the motion that follows the slopes and is no longer than `reach` times the motion.
    /// `raised` is the number of times damping was raised, carried over from the previous change.
    fn change(&self, slopes: &DMatrix<f64>, iterate: &Iterate, reach: f64, raised: &mut i32) -> Option<Vec<f64>> {
        let missing_m = self.steps_m - &iterate.went_m;
        let penalised = self.penalties.iter().map(|penalty| penalty.missing(iterate.went_m.as_slice()));
        let off = iterate.course.iter().map(|off| -off.off_m);
        let missing = DVector::from_iterator(slopes.ncols(), missing_m.iter().copied().chain(penalised).chain(off));
        let longest = reach * self.effort.norm(&iterate.coefficients);
        let change = damped_change(slopes, &missing, longest, raised)?;
        Some(change.iter().zip(&self.effort.weights).map(|(d, w)| d / w.sqrt()).collect())
    }
}

/// The least damped change that follows `slopes`, a column for each residual, towards `missing` and is no longer than
/// `longest`. `raised` is the number of times damping was raised, carried over from the previous change.
pub(super) fn damped_change(
    slopes: &DMatrix<f64>,
    missing: &DVector<f64>,
    longest: f64,
    raised: &mut i32,
) -> Option<DVector<f64>> {
    let normal = slopes.tr_mul(slopes);
    let least = DAMPING * normal.trace() / normal.nrows() as f64;
    let damped = |raised: i32| {
        let mut damped = normal.clone();
        let damping = least * MORE_DAMPING.powi(raised);
        (0..damped.nrows()).for_each(|i| damped[(i, i)] += damping);
        Some(slopes * damped.cholesky()?.solve(missing))
    };
    let mut change = damped(*raised)?;
    while change.norm() > longest {
        *raised += 1;
        if *raised > MOST_RAISED {
            return None;
        }
        change = damped(*raised)?;
    }
    while *raised > 0 {
        let longer = damped(*raised - 1)?;
        if longer.norm() > longest {
            break;
        }
        *raised -= 1;
        change = longer;
    }
    Some(change)
}
