//! Guarantees of the relaxed program and of the refinement.

use proptest::prelude::*;

use super::motion_set;
use crate::planner::PartState;
use crate::planner::fixture::{params, scene};
use crate::planner::rotations::displacement_matrix::{DisplacementMatrix, PulseScale};
use crate::planner::rotations::least_time::LeastTime;
use crate::planner::rotations::refine::{Refined, SequenceProblem};
use crate::planner::rotations::subgoals::Clearance;
use upm_core::geometry::Vec2;

fn steps_mm(parts: &[PartState]) -> Vec<f64> {
    parts.iter().flat_map(|part| [1e3 * part.step_m.x, 1e3 * part.step_m.y]).collect()
}

/// Limits without corridors around `parts`.
fn room(parts: &[PartState]) -> Clearance {
    let goal_m: Vec<Vec2> = parts.iter().map(|part| part.position_m + part.step_m).collect();
    Clearance::of(parts, &goal_m, &params(), &[])
}

/// Distance that the counts leave of the steps, mm.
fn left_mm(columns: &DisplacementMatrix, found: &LeastTime, steps_mm: &[f64]) -> f64 {
    let mut left = steps_mm.to_vec();
    for (j, count) in found.counts.iter().enumerate() {
        left.iter_mut().zip(columns.column(j)).for_each(|(left, d)| *left -= count * d);
    }
    left.iter().map(|v| v * v).sum::<f64>().sqrt()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    /// Feasible, and no column of the library would shorten it: the optimality conditions of the program.
    #[test]
    fn counts_are_feasible_and_no_column_pays_more(count in 1usize..7, fine: bool, seed in 0u64..1000) {
        let (motion_set, parts) = (motion_set(), scene(count, 4e-3, seed));
        let scale = if fine { PulseScale::FINE } else { PulseScale::COARSE };
        let columns = DisplacementMatrix::all(&motion_set, &parts, &room(&parts), (4e-3, scale));
        let steps_mm = steps_mm(&parts);
        let length_mm = steps_mm.iter().map(|v| v * v).sum::<f64>().sqrt();
        let leave_mm = 0.3 * length_mm;
        let found = LeastTime::solve(&columns, &steps_mm, leave_mm, &[]).unwrap();
        prop_assert!(left_mm(&columns, &found, &steps_mm) < leave_mm + 0.02);
        let most = (0..columns.len()).map(|j| columns.pay(j, &found.prices)).fold(0.0, f64::max);
        prop_assert!(most < 1.05, "{most}");
        // the value of the dual program: y · e - leave |y|
        let price = found.prices.iter().map(|y| y * y).sum::<f64>().sqrt();
        let dual_s = found.prices.iter().zip(&steps_mm).map(|(y, e)| y * e).sum::<f64>() - leave_mm * price;
        let time_s: f64 = found.counts.iter().zip(&columns.duration_s).map(|(count, time_s)| count * time_s).sum();
        prop_assert!((time_s / dual_s - 1.0).abs() < 0.02, "{time_s} {dual_s}");
    }

    #[test]
    fn refinement_never_leaves_more(count in 2usize..6, seed in 0u64..1000) {
        let (motion_set, parts) = (motion_set(), scene(count, 3e-3, seed));
        let goal_m: Vec<Vec2> = parts.iter().map(|part| part.position_m + part.step_m).collect();
        let room = Clearance::of(&parts, &goal_m, &params(), &[]);
        let columns = DisplacementMatrix::all(&motion_set, &parts, &room, (3e-3, PulseScale::COARSE));
        let found = LeastTime::solve(&columns, &steps_mm(&parts), 1.0, &[]).unwrap();
        let used = found.counts.iter().enumerate().filter(|(_, count)| **count > 0.3).map(|(j, _)| columns.pulses[j]);
        let problem = SequenceProblem { motion_set: &motion_set, parts: &parts, goal_m: &goal_m, room: &room };
        let first = Refined::of(&problem, used.collect());
        let before_m = first.merit_m();
        let after = first.refined(&problem, (6, 0.1e-3));
        prop_assert!(after.merit_m() <= before_m);
        for pulse in &after.pulses {
            let (low_m, high_m) = motion_set.range_m(pulse.dial);
            prop_assert!((low_m - 1e-9..=high_m + 1e-9).contains(&pulse.distance_m.abs()));
        }
    }
}
