//! Refinement of a sequence for its exact end: damped Gauss-Newton steps, each a quadratic program with the limits at
//! every stage.
//!
//! ```text
//!   minimise    ½ |r - J δ|² + ½ λ tr(JᵀJ)/K Σ δ_k² / (ε + min(|d_k|, D)) + price Σ |d_k + δ_k| + penalty s
//!   subject to  shortest <= |d_k + δ_k| <= longest, no sign changes
//!               effect of all δ on a gap or on the distance to the edge, at each stage <= its room + s,   s >= 0
//! ```
//!
//! Lengths are in millimetres. Equation sheet, section 1.7 (ours; Φ and d as in Eqs. 1 and 2 of the UPM paper).

use super::motion_set::{LibraryMotion, MotionSet, Pulse};
use super::rollout::{SequenceRollout, Slopes};
use super::subgoals::{Clearance, Shortfall};
use crate::planner::PartState;
use crate::qp::{ColumnWriter, Cone, Program};
use upm_core::geometry::Vec2;

/// Weight of a metre by which a limit is broken against a metre of error, and the excess below which it is tolerated,
/// m.
const BROKEN: f64 = 8.0;
const TOLERATED_M: f64 = 0.2e-3;
/// Weight of a metre outside a corridor against a metre of error, and the share of its half width from which on a
/// corridor becomes a constraint.
const LEFT: f64 = 2.0;
const NEAR_BORDER: f64 = 0.5;
/// Damping at first, at least and at most.
const DAMPING: f64 = 0.03;
const LEAST_DAMPING: f64 = 1e-5;
const MOST_DAMPING: f64 = 100.0;
/// Bounds of a pulse's length in the damping term, mm.
const STIFF_MM: (f64, f64) = (0.3, 3.0);
/// Price of a millimetre of pulse length, and of a millimetre by which the linear forecast breaks a limit.
const PRICE: f64 = 2e-3;
const PENALTY: f64 = 3.0;
/// Limits become constraints when nearer than this, m, and are kept with the spare distance; only the tightest of each
/// stage are used, this many per part.
const NEAR_M: f64 = 3e-3;
const SPARE_M: f64 = 0.2e-3;
const ROWS_PER_PART: usize = 3;
/// Error at which a sequence is good enough, root mean square over the parts, m.
const ENOUGH_M: f64 = 0.08e-3;
/// A round is slow when it leaves more than this fraction of the merit; three slow rounds in succession end the
/// refinement.
const SLOW: f64 = 0.97;

/// The parts of a sequence, their subgoals, and the clearance that they keep on their way.
pub(super) struct SequenceProblem<'a> {
    pub motion_set: &'a MotionSet,
    pub parts: &'a [PartState],
    pub goal_m: &'a [Vec2],
    pub room: &'a Clearance,
}

/// A sequence and its forecast.
#[derive(Clone, Debug)]
pub(super) struct Refined {
    pub pulses: Vec<Pulse>,
    pub motions: Vec<LibraryMotion>,
    pub rollout: SequenceRollout,
    /// Distance left to the subgoals at the end: root of the sum of squares over the parts, m.
    pub left_m: f64,
    /// The limit broken most along the path.
    pub shortfall: Option<Shortfall>,
    /// The part that leaves its corridor most along the path, and by how much, m.
    pub corridor_excess: Option<(usize, f64)>,
}

impl Refined {
    /// Forecast of `pulses`.
    pub fn of(problem: &SequenceProblem<'_>, pulses: Vec<Pulse>) -> Self {
        let SequenceProblem { motion_set, parts, goal_m, room } = *problem;
        let motions: Vec<LibraryMotion> = pulses.iter().map(|&pulse| motion_set.motion(pulse)).collect();
        let rollout = SequenceRollout::of(&motions, parts);
        let left_m =
            rollout.end().iter().zip(goal_m).map(|(end, goal)| (goal - end).norm_squared()).sum::<f64>().sqrt();
        let shortfall = (0..pulses.len())
            .filter_map(|k| room.shortfall(rollout.at(k), rollout.at(k + 1)))
            .max_by(|a, b| a.by_m.total_cmp(&b.by_m));
        let corridor_excess = corridor_excess(&rollout, room, pulses.len());
        Self { pulses, motions, rollout, left_m, shortfall, corridor_excess }
    }

    /// Excess over the limit that is broken most, m.
    pub fn broken_m(&self) -> f64 {
        self.shortfall.map_or(0.0, |shortfall| shortfall.by_m)
    }

    /// Excess over the corridor that is left most, m.
    pub fn excess_m(&self) -> f64 {
        self.corridor_excess.map_or(0.0, |(_, by_m)| by_m)
    }

    /// Residual, broken limits and corridors as one length, m: less is better.
    pub fn merit_m(&self) -> f64 {
        self.left_m + BROKEN * (self.broken_m() - TOLERATED_M).max(0.0) + LEFT * self.excess_m()
    }

    /// Refines the sequence in up to `rounds` programs, or until its merit is below 0.8 `want_m` (root mean square over
    /// the parts).
    pub fn refined(self, problem: &SequenceProblem<'_>, (rounds, want_m): (usize, f64)) -> Self {
        let enough_m = ENOUGH_M.max(0.8 * want_m) * (problem.parts.len() as f64).sqrt();
        let (mut best, mut damping, mut slow) = (self, DAMPING, 0);
        let mut model: Option<Linear> = None;
        for _ in 0..rounds {
            if best.merit_m() < enough_m || damping > MOST_DAMPING || best.pulses.is_empty() {
                break;
            }
            let linear = model.take().unwrap_or_else(|| Linear::at(problem, &best));
            let Some(changes_mm) = linear.step(problem.motion_set, &best.pulses, damping) else {
                (damping, model) = (5.0 * damping, Some(linear));
                continue;
            };
            let changed = |(pulse, change_mm): (&Pulse, &f64)| Pulse {
                distance_m: pulse.distance_m + 1e-3 * change_mm,
                ..*pulse
            };
            let pulses = best.pulses.iter().zip(&changes_mm).map(changed).collect();
            let next = Self::of(problem, pulses);
            if next.merit_m() < best.merit_m() - 1e-7 {
                slow = if next.merit_m() > SLOW * best.merit_m() { slow + 1 } else { 0 };
                (best, damping) = (next, (damping / 5.0).max(LEAST_DAMPING));
                if slow > 2 {
                    break;
                }
            } else {
                (damping, model) = (5.0 * damping, Some(linear));
            }
        }
        best
    }
}

/// Linearised sequence: errors and limits in mm, per mm of each pulse's length.
struct Linear {
    /// Slopes of every part's end by each pulse's length: `[pulse][coordinate]`.
    slopes: Vec<f64>,
    /// Remaining displacement to the subgoals, mm.
    left_mm: Vec<f64>,
    /// Sum of the squares of all slopes, over the number of pulses.
    stiffness: f64,
    /// Limits, then corridors: slopes by each pulse before its stage, and the room, mm.
    limits: Vec<(Vec<f64>, f64)>,
    corridors: Vec<(Vec<f64>, f64)>,
}

impl Linear {
    fn at(problem: &SequenceProblem<'_>, now: &Refined) -> Self {
        let SequenceProblem { motion_set, parts, goal_m, room } = *problem;
        let count = now.pulses.len();
        let by_stage = Slopes::of(motion_set, &now.pulses, &now.motions, &now.rollout, parts);
        let slopes: Vec<f64> = (0..count).flat_map(|k| by_stage.at(count, k).iter().flat_map(|s| [s.x, s.y])).collect();
        let left = now.rollout.end().iter().zip(goal_m).map(|(end, goal)| (goal - end) * 1e3);
        let left_mm = left.flat_map(|left| [left.x, left.y]).collect();
        let stiffness = slopes.iter().map(|slope| slope * slope).sum::<f64>() / count as f64;
        let limits = limits(now, &by_stage, parts.len(), room);
        Self { slopes, left_mm, stiffness, limits, corridors: corridors(now, &by_stage, room) }
    }

    /// The best changes of the pulses' lengths at this damping, mm; `None` where the solver finds none.
    ///
    /// Variables are the changes, the residuals they leave to the subgoals, and the slacks of limits and corridors.
    /// Rows are the definition of the residuals, the longest and shortest lengths, the slacks' signs, and the limits.
    fn step(&self, motion_set: &MotionSet, pulses: &[Pulse], damping: f64) -> Option<Vec<f64>> {
        let (n, m) = (pulses.len(), self.left_mm.len());
        let (first_bound, slack_row, first_limit) = (m, m + 2 * n, m + 2 * n + 2);
        let rows = || self.limits.iter().chain(&self.corridors);
        let sign = |k: usize| if pulses[k].distance_m < 0.0 { -1.0 } else { 1.0 };
        let (mut hessian, mut constraints) = (ColumnWriter::default(), ColumnWriter::default());
        let mut bounds = vec![0.0; first_limit + rows().count()];
        bounds[..m].copy_from_slice(&self.left_mm);
        for (k, pulse) in pulses.iter().enumerate() {
            let distance_mm = (1e3 * pulse.distance_m.abs()).min(STIFF_MM.1);
            hessian.put(k, damping * self.stiffness / (STIFF_MM.0 + distance_mm));
            hessian.end_column();
            let (low_m, high_m) = motion_set.range_m(pulse.dial);
            let row = first_bound + 2 * k;
            bounds[row] = (1e3 * (high_m - pulse.distance_m.abs())).max(0.0);
            bounds[row + 1] = (1e3 * (pulse.distance_m.abs() - low_m)).max(0.0);
            self.slopes[k * m..][..m].iter().enumerate().for_each(|(row, &slope)| constraints.put(row, slope));
            constraints.put(row, sign(k));
            constraints.put(row + 1, -sign(k));
            for (limit, (by, _)) in rows().enumerate().filter(|(_, (by, _))| k < by.len()) {
                constraints.put(first_limit + limit, by[k]);
            }
            constraints.end_column();
        }
        for row in 0..m {
            hessian.put(n + row, 1.0);
            hessian.end_column();
            constraints.put(row, 1.0);
            constraints.end_column();
        }
        rows().zip(&mut bounds[first_limit..]).for_each(|((_, room_mm), bound)| *bound = *room_mm);
        let split = first_limit + self.limits.len();
        for (slack, limits) in [first_limit..split, split..bounds.len()].into_iter().enumerate() {
            hessian.end_column();
            constraints.put(slack_row + slack, -1.0);
            limits.for_each(|row| constraints.put(row, -1.0));
            constraints.end_column();
        }
        let price = (0..n).map(|k| PRICE * sign(k));
        let program = Program {
            hessian: hessian.finish(n + m + 2),
            gradient: price.chain(std::iter::repeat_n(0.0, m)).chain([PENALTY; 2]).collect(),
            constraints: constraints.finish(bounds.len()),
            cones: vec![Cone::ZeroConeT(m), Cone::NonnegativeConeT(bounds.len() - m)],
            bounds,
        };
        let mut found = program.solve().ok()?;
        found.x.truncate(n);
        Some(found.x)
    }
}

/// The part that leaves its corridor most in the first `count` pulses, and by how much, m.
pub(super) fn corridor_excess(rollout: &SequenceRollout, room: &Clearance, count: usize) -> Option<(usize, f64)> {
    let courses = (0..count).flat_map(|k| [rollout.middle(k), rollout.at(k + 1)]);
    courses.filter_map(|places_m| room.corridor_excess(places_m)).max_by(|a, b| a.1.total_cmp(&b.1))
}

/// Corridors at the points along each pulse's course where a part is near the border.
fn corridors(now: &Refined, slopes: &Slopes, room: &Clearance) -> Vec<(Vec<f64>, f64)> {
    let mut rows = Vec::new();
    for ((part, corridor), k) in room.corridors().flat_map(|c| (0..now.pulses.len()).map(move |k| (c, k))) {
        // halfway through its own pulse a part has made half of what its end gains by the pulse
        for (place_m, share) in [(now.rollout.middle(k)[part], 0.5), (now.rollout.at(k + 1)[part], 1.0)] {
            let off = corridor.off(place_m);
            let (off_m, half_width_m) = (off.norm(), corridor.half_width_m);
            if off_m > NEAR_BORDER * half_width_m {
                let by = |l: usize| {
                    let share = if l == k { share } else { 1.0 };
                    share * slopes.at(k + 1, l)[part].dot(&off) / off_m
                };
                rows.push(((0..=k).map(by).collect(), 1e3 * (half_width_m - off_m)));
            }
        }
    }
    rows
}

/// The tightest limits at the stages before the end.
fn limits(now: &Refined, slopes: &Slopes, parts: usize, room: &Clearance) -> Vec<(Vec<f64>, f64)> {
    let count = now.pulses.len();
    // room, stage, part, and the other part or the axis
    let mut near: Vec<(f64, usize, usize, Result<usize, usize>)> = Vec::new();
    for stage in 1..count {
        let at_m = now.rollout.at(stage);
        for i in 0..parts {
            for (axis, along) in [at_m[i].x, at_m[i].y].into_iter().enumerate() {
                let room_m = room.bound_m(i) - along.abs();
                if room_m < NEAR_M {
                    near.push((room_m, stage, i, Err(axis)));
                }
            }
            for j in 0..i {
                let room_m = (at_m[i] - at_m[j]).norm() - room.apart_m(i, j);
                if room_m < NEAR_M {
                    near.push((room_m, stage, i, Ok(j)));
                }
            }
        }
    }
    near.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    near.truncate(ROWS_PER_PART * parts);
    let row = |&(room_m, stage, i, other): &(f64, usize, usize, Result<usize, usize>)| {
        let at_m = now.rollout.at(stage);
        let by = |k: usize| {
            let slope = slopes.at(stage, k);
            match other {
                Ok(j) => {
                    let apart = (at_m[i] - at_m[j]).try_normalize(0.0).unwrap_or_else(Vec2::x);
                    -(slope[i] - slope[j]).dot(&apart)
                }
                Err(axis) => slope[i][axis] * at_m[i][axis].signum(),
            }
        };
        let by = (0..stage).map(by).collect();
        let spare_m = if other.is_ok() { SPARE_M } else { 0.0 };
        (by, 1e3 * (room_m - spare_m))
    };
    near.iter().map(row).collect()
}
