//! Paths of least effort: the intermediate stages of a path are moved until the total effort between them is least.
//!
//! ```text
//!   minimise  K Σ_k e_k' M((x_k + x_k+1) / 2) e_k + penalties      e_k = x_k+1 - x_k
//! ```
//!
//! `x_k` are the positions of all parts at stage k, `M` the squared effort of a step there. The least sum of squares is
//! a path with evenly spread and least total effort (a geodesic). Parts too near to each other or to the edge pay the
//! square of the missing distance.

use std::collections::VecDeque;

use super::multi_disc::MultiDiscProblem;
use super::routes::PLANNED_GAP_M;
use upm_core::geometry::Vec2;

/// Clearance in addition to that of planned paths, to other parts and to the edge, m: sequences of rotations stray by
/// some millimetres from the straight path between two stages, and are cut short where they break a limit.
const SPARE_M: f64 = 2e-3;
const EDGE_SPARE_M: f64 = 10e-3;
/// Price of missing clearance, per square metre: 1 mm counts like 5 pulses.
const PENALTY: f64 = 25e6;
/// Rounds of a search, which ends when one gains less than this fraction of the rest; a rough search only ranks paths.
pub(super) const ROUNDS: usize = 40;
pub(super) const ROUGH_ROUNDS: usize = 6;
const WORTH: f64 = 2e-3;
/// Length of the first step of a search and longest of any, per coordinate, m.
const FIRST_M: f64 = 2e-3;
const MOST_M: f64 = 15e-3;
/// Steps kept as curvature information (L-BFGS), and halvings of one step.
const MEMORY: usize = 6;
const HALVINGS: usize = 8;

/// Effort of moving all parts at once.
pub trait Effort: std::fmt::Debug + Send + Sync {
    /// Squared effort of steps of parts at these positions, in pulses squared; adds its slopes (by position, by step;
    /// 1/m) to `slopes`. Infinite where the step is impossible.
    fn squared(&self, places_m: &[Vec2], steps_m: &[Vec2], slopes: Option<(&mut [Vec2], &mut [Vec2])>) -> f64;
}

/// Path of all parts: their positions at every stage; the first and last stages are fixed.
pub(super) type JointPath = Vec<Vec<Vec2>>;

/// Effort of a path, in pulses.
pub(super) fn effort_of(way_m: &[Vec<Vec2>], effort: &dyn Effort) -> f64 {
    let of = |pair: &[Vec<Vec2>]| {
        let (middle_m, step_m) = middle_and_step(&pair[0], &pair[1]);
        effort.squared(&middle_m, &step_m, None).sqrt()
    };
    way_m.windows(2).map(of).sum()
}

/// `way_m` with its stages moved, in up to `rounds` rounds, to the least effort; and its cost: squared effort with all
/// penalties.
pub(super) fn eased(
    way_m: JointPath,
    problem: &MultiDiscProblem,
    effort: &dyn Effort,
    rounds: usize,
) -> (JointPath, f64) {
    let mut now = Descent::at(way_m, problem, effort);
    let mut known: VecDeque<(Vec<f64>, Vec<f64>)> = VecDeque::new();
    for _ in 0..rounds {
        let direction = now.direction(&known);
        let downhill: f64 = direction.iter().zip(&now.slopes).map(|(d, s)| d * s).sum();
        if !downhill.is_finite() || downhill >= 0.0 {
            break;
        }
        let mut share =
            if known.is_empty() { FIRST_M / largest(&direction) } else { 1.0_f64.min(MOST_M / largest(&direction)) };
        let mut next = None;
        for _ in 0..HALVINGS {
            let tried = Descent::at(now.moved(&direction, share), problem, effort);
            if tried.cost < now.cost + 1e-4 * share * downhill {
                next = Some(tried);
                break;
            }
            share *= 0.5;
        }
        let Some(next) = next else { break };
        let gained = now.cost - next.cost;
        let step: Vec<f64> = direction.iter().map(|d| d * share).collect();
        let bend: Vec<f64> = next.slopes.iter().zip(&now.slopes).map(|(a, b)| a - b).collect();
        if step.iter().zip(&bend).map(|(s, b)| s * b).sum::<f64>() > 0.0 {
            known.push_back((step, bend));
            if known.len() > MEMORY {
                known.pop_front();
            }
        }
        now = next;
        if gained < WORTH * now.cost {
            break;
        }
    }
    (now.way_m, now.cost)
}

/// State of the descent: a path, its cost and its slopes by every coordinate of the inner stages.
struct Descent {
    way_m: JointPath,
    cost: f64,
    slopes: Vec<f64>,
}

impl Descent {
    fn at(way_m: JointPath, problem: &MultiDiscProblem, effort: &dyn Effort) -> Self {
        let (legs, parts) = (way_m.len().saturating_sub(1), problem.len());
        let mut by = vec![Vec2::zeros(); way_m.len() * parts];
        let mut cost = 0.0;
        for leg in 0..legs {
            let (middle_m, step_m) = middle_and_step(&way_m[leg], &way_m[leg + 1]);
            let (mut by_place, mut by_step) = (vec![Vec2::zeros(); parts], vec![Vec2::zeros(); parts]);
            cost += legs as f64 * effort.squared(&middle_m, &step_m, Some((&mut by_place, &mut by_step)));
            for i in 0..parts {
                by[leg * parts + i] += (by_place[i] * 0.5 - by_step[i]) * legs as f64;
                by[(leg + 1) * parts + i] += (by_place[i] * 0.5 + by_step[i]) * legs as f64;
            }
        }
        for (stage, places_m) in way_m.iter().enumerate().take(legs).skip(1) {
            let (first_m, last_m) = (&way_m[0], &way_m[legs]);
            let share = stage as f64 / legs as f64;
            // a path that begins or ends near the edge may run along it
            let bounds_m = (0..parts).map(|i| {
                let along_m = first_m[i].abs().lerp(&last_m[i].abs(), share);
                along_m.map(|x| x.clamp(problem.reach_m(i) - EDGE_SPARE_M, problem.reach_m(i).max(0.0)))
            });
            let bounds_m: Vec<Vec2> = bounds_m.collect();
            cost += crowding((places_m, &bounds_m), problem, &mut by[stage * parts..][..parts]);
        }
        let slopes =
            by.get(parts..legs * parts).unwrap_or_default().iter().flat_map(|slope| [slope.x, slope.y]).collect();
        Self { way_m, cost, slopes }
    }

    /// Descent direction by L-BFGS (Nocedal 1980), from the curvature along earlier steps.
    fn direction(&self, known: &VecDeque<(Vec<f64>, Vec<f64>)>) -> Vec<f64> {
        let dot = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
        let mut direction: Vec<f64> = self.slopes.iter().map(|slope| -slope).collect();
        let mut shares = Vec::with_capacity(known.len());
        for (step, bend) in known.iter().rev() {
            let share = dot(step, &direction) / dot(step, bend);
            direction.iter_mut().zip(bend).for_each(|(d, b)| *d -= share * b);
            shares.push(share);
        }
        if let Some((step, bend)) = known.back() {
            let scale = dot(step, bend) / dot(bend, bend);
            direction.iter_mut().for_each(|d| *d *= scale);
        }
        for ((step, bend), share) in known.iter().zip(shares.into_iter().rev()) {
            let back = dot(bend, &direction) / dot(step, bend);
            direction.iter_mut().zip(step).for_each(|(d, s)| *d += (share - back) * s);
        }
        direction
    }

    fn moved(&self, direction: &[f64], share: f64) -> JointPath {
        let mut way_m = self.way_m.clone();
        let last = way_m.len() - 1;
        let between = way_m[1..last].iter_mut().flatten();
        for (place, by) in between.zip(direction.chunks_exact(2)) {
            *place += Vec2::new(by[0], by[1]) * share;
        }
        way_m
    }
}

/// Penalty of parts that are too near to each other or to the edge; adds its slopes to `slopes`.
fn crowding((places_m, bounds_m): (&[Vec2], &[Vec2]), problem: &MultiDiscProblem, slopes: &mut [Vec2]) -> f64 {
    let mut cost = 0.0;
    for i in 0..places_m.len() {
        for axis in 0..2 {
            let beyond_m = places_m[i][axis].abs() - bounds_m[i][axis];
            if beyond_m > 0.0 {
                cost += PENALTY * beyond_m * beyond_m;
                slopes[i][axis] += 2.0 * PENALTY * beyond_m * places_m[i][axis].signum();
            }
        }
        for j in 0..i {
            let apart = places_m[i] - places_m[j];
            let missing_m = problem.least_m(i, j, PLANNED_GAP_M + SPARE_M) - apart.norm();
            if missing_m > 0.0 {
                cost += PENALTY * missing_m * missing_m;
                let push = apart.try_normalize(0.0).unwrap_or_else(Vec2::x) * (2.0 * PENALTY * missing_m);
                slopes[i] -= push;
                slopes[j] += push;
            }
        }
    }
    cost
}

fn middle_and_step(from_m: &[Vec2], to_m: &[Vec2]) -> (Vec<Vec2>, Vec<Vec2>) {
    from_m.iter().zip(to_m).map(|(from, to)| (from.lerp(to, 0.5), to - from)).unzip()
}

fn largest(direction: &[f64]) -> f64 {
    direction.iter().map(|d| d.abs()).fold(1e-12, f64::max)
}
