//! The search for a motion whose pulse brings every part its step.
//!
//! Damped least squares on where the parts end (Levenberg, Marquardt), with two things of its own. A change of the
//! motion is measured by the counts it asks of the motors, and none is larger than a share of the motion itself. After
//! every change the motion is made as strong as the motors allow: strong motions carry parts fast and hardly brake
//! moving ones.
//!
//! What goes astray counts with its square, so a part far from its end may go a little sideways if the parts as a whole
//! get on faster. Aimed at ends that can be reached, nothing is left of that.

use std::cell::RefCell;

use nalgebra::{DMatrix, DVector};

use super::course::{Course, Disc};
use super::guard::Guard;
use super::strength::Strength;
use super::waves::Waves;
use upm_core::signal::Envelope;

/// Longest change of a motion at first, as a part of the motion; how that changes after a success and a failure.
const REACH: f64 = 0.3;
const WIDER: f64 = 1.6;
const WIDEST: f64 = 0.8;
const NARROWER: f64 = 0.35;
const NARROWEST: f64 = 0.01;
/// Least damping, as a part of the mean eigenvalue; steps in which it is raised; how often at first, and at most.
const DAMPING: f64 = 1e-5;
const MORE_DAMPING: f64 = 3.0;
const RAISED: i32 = 6;
const MOST_RAISED: i32 = 64;
/// A start that should go less far than this part of its way is softened.
const SOFTEN: f64 = 0.8;
/// Part of the steps that may be left when the search ends early.
const GOOD: f64 = 0.02;

/// What is aimed with and at.
#[derive(Clone, Copy)]
pub(super) struct Range<'a> {
    pub waves: &'a Waves,
    pub strength: &'a Strength,
    pub discs: &'a [Disc],
    /// Step of every part, x and y in turn, m.
    pub steps_m: &'a DVector<f64>,
    pub envelope: &'a Envelope,
    /// Directions in which parts must get away.
    pub guards: &'a [Guard],
    pub spare: &'a Spare,
}

/// Courses that are done with: large pieces of memory, used again.
#[derive(Clone, Debug, Default)]
pub(super) struct Spare(RefCell<Vec<Course>>);

impl Spare {
    fn take(&self) -> Course {
        self.0.borrow_mut().pop().unwrap_or_default()
    }

    pub fn keep(&self, shot: Shot) {
        self.0.borrow_mut().push(shot.course);
    }
}

/// A motion and what becomes of the parts.
#[derive(Clone, Debug)]
pub(super) struct Shot {
    pub coefficients: Vec<f64>,
    pub course: Course,
    went_m: DVector<f64>,
    /// Sum of the squares of what is left of the steps, guards included, m².
    cost: f64,
}

impl Shot {
    /// Part of the steps that is left, root of the sums of squares.
    pub fn left(&self, steps_m: &DVector<f64>) -> f64 {
        (steps_m - &self.went_m).norm() / steps_m.norm()
    }
}

impl Range<'_> {
    /// The shot that `start` makes, as strong as can be.
    pub fn shot(&self, start: &[f64]) -> Shot {
        let mut coefficients = start.to_vec();
        self.strength.fill(self.waves, &mut coefficients);
        let mut course = self.spare.take();
        course.run(self.waves, &coefficients, self.envelope, self.discs);
        let went = course.ends_m.iter().zip(self.discs).flat_map(|(end, disc)| <[f64; 2]>::from(end - disc.position_m));
        let went_m = DVector::from_iterator(self.steps_m.len(), went);
        let missing_m = self.steps_m - &went_m;
        let guarded: f64 = self.guards.iter().map(|guard| guard.missing(went_m.as_slice()).powi(2)).sum();
        Shot { coefficients, course, cost: missing_m.norm_squared() + guarded, went_m }
    }

    /// The shot of `start`, softened where it goes too far or the wrong way. A motion without even harmonics runs back in
    /// the second half of a period as it went in the first, and carries parts nowhere; so parts go about as far as the
    /// even harmonics are large.
    pub fn softened_shot(&self, start: &[f64]) -> Shot {
        let shot = self.shot(start);
        let share = shot.went_m.dot(self.steps_m) / shot.went_m.norm_squared();
        if share.is_nan() || share > SOFTEN {
            return shot;
        }
        let even = |j: usize| self.waves.harmonic_of(j).is_multiple_of(2);
        let soft = |(j, c): (usize, &f64)| if even(j) { c * share.max(0.0) } else { *c };
        let softened = self.shot(&start.iter().enumerate().map(soft).collect::<Vec<f64>>());
        self.cheaper(softened, shot)
    }

    fn cheaper(&self, a: Shot, b: Shot) -> Shot {
        let (cheaper, other) = if a.cost < b.cost { (a, b) } else { (b, a) };
        self.spare.keep(other);
        cheaper
    }

    /// `shot`, bettered in at most `rounds`.
    pub fn better(&self, mut shot: Shot, rounds: usize) -> Shot {
        let good = (GOOD * self.steps_m.norm()).powi(2);
        let mut reach = REACH;
        let mut slopes = None;
        let mut raised = RAISED;
        for _ in 0..rounds {
            if shot.cost < good || reach < NARROWEST {
                break;
            }
            let of_shot = slopes.get_or_insert_with(|| self.slopes(&shot));
            let Some(change) = self.change(of_shot, &shot, reach, &mut raised) else { break };
            let changed: Vec<f64> = shot.coefficients.iter().zip(&change).map(|(c, d)| c + d).collect();
            let next = self.shot(&changed);
            if next.cost < shot.cost {
                slopes = None;
                reach = (WIDER * reach).min(WIDEST);
            } else {
                reach *= NARROWER;
            }
            shot = self.cheaper(next, shot);
        }
        shot
    }

    /// Slopes of what is missing, guards included, by the motors' counts: a column for each.
    fn slopes(&self, shot: &Shot) -> DMatrix<f64> {
        let (n, ends) = (self.waves.len(), self.steps_m.len());
        let mut slopes = shot.course.slopes(self.waves).resize_horizontally(ends + self.guards.len(), 0.0);
        for (mut row, weight) in slopes.row_iter_mut().zip(&self.strength.weights) {
            row /= weight.sqrt();
        }
        for (k, guard) in self.guards.iter().enumerate() {
            let sum = guard.terms().fold(DVector::zeros(n), |sum, (end, factor)| sum + slopes.column(end) * factor);
            slopes.set_column(ends + k, &sum);
        }
        slopes
    }

    /// The least damped change of the motion that the slopes ask for and that is no longer than `reach` of it. `raised`
    /// tells how often damping was raised, from the last change on to this one.
    fn change(&self, slopes: &DMatrix<f64>, shot: &Shot, reach: f64, raised: &mut i32) -> Option<Vec<f64>> {
        let missing_m = self.steps_m - &shot.went_m;
        let guarded = self.guards.iter().map(|guard| guard.missing(shot.went_m.as_slice()));
        let missing = DVector::from_iterator(slopes.ncols(), missing_m.iter().copied().chain(guarded));
        let normal = slopes.tr_mul(slopes);
        let least = DAMPING * normal.trace() / normal.nrows() as f64;
        let longest = reach * self.strength.norm(&shot.coefficients);
        let damped = |raised: i32| {
            let mut damped = normal.clone();
            let damping = least * MORE_DAMPING.powi(raised);
            (0..damped.nrows()).for_each(|i| damped[(i, i)] += damping);
            Some(slopes * damped.cholesky()?.solve(&missing))
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
        Some(change.iter().zip(&self.strength.weights).map(|(d, w)| d / w.sqrt()).collect())
    }
}
