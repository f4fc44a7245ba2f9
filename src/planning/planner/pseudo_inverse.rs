//! The papers' plain method, for comparison: fixed centres, the ideal field, the pseudo-inverse.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::types::largest_step_m;
use super::{Limit, PartState, Plan, PlanStatus, PlannedPulse, PlannerParams, Rotation};
use crate::cor_library::{Entry, Library};
use upm_core::geometry::Vec2;

/// Longest step of a part and longest single rotation in one cycle, m: the field is straight only over a short
/// distance.
const LONGEST_M: f64 = 4e-3;

/// An entry counts as strong from this fraction of the 90th percentile of spin on the plate.
const STRONG: f64 = 0.4;

/// Singular values below this fraction of the largest count as zero.
const RANK: f64 = 1e-6;

/// The manipulation algorithm as published (Reznik, Moshkovich, Canny: Building a Universal Planar Manipulator, section
/// 2.1): N parts, 2N centres chosen beforehand, `ΔP = Φ d` with the ideal unit field `τ_j(P_i)` in column j, at any
/// distance of the part from the centre; `d = Φ⁺ ΔP`, all rotations one after another. It ignores the edge, other parts
/// and all measurements except the sustain for a distance.
///
/// There are two sets of centres: strong motions, and gentle ones for distances too short for those.
#[derive(Clone, Debug)]
pub struct PseudoInverse {
    library: Arc<Library>,
    params: PlannerParams,
    /// Indices of the strong and of the gentle entries.
    fixed_centers: [Vec<usize>; 2],
    planned_for: Option<usize>,
}

impl PseudoInverse {
    /// A planner for one rig's library. Of `params` it uses the plate's side and the smallest distance.
    pub fn new(library: Arc<Library>, params: PlannerParams) -> Self {
        Self { library, params, fixed_centers: Default::default(), planned_for: None }
    }

    /// Plans one cycle: the rotations that to first order give every part its step. All steps are shortened by the same
    /// factor where the longest is too long, and so is each rotation that is too long. The prediction uses the ideal
    /// field.
    pub fn plan(&mut self, parts: &[PartState]) -> Plan {
        if let Some(status) = self.params.nothing_to_plan(parts) {
            return status.into();
        }
        if self.planned_for.replace(parts.len()) != Some(parts.len()) {
            self.fixed_centers = fixed_centers(&self.library, self.params.half_side_m, 2 * parts.len());
        }
        let mut plan = Plan::from(PlanStatus::Infeasible(Limit::Unreachable));
        for centers in self.fixed_centers.iter().filter(|centers| !centers.is_empty()) {
            plan = match self.distances_m(centers, parts) {
                Ok(distances_m) => self.sequence(centers, parts, &distances_m),
                Err(words) => ended(PlanStatus::SolverFailed(words), centers),
            };
            if plan.status != PlanStatus::NothingToDo {
                break;
            }
        }
        plan
    }

    /// `Φ⁺ ΔP`, the distance about each of the centres, m; all steps are shortened by the same factor where the longest
    /// is too long.
    fn distances_m(&self, centers: &[usize], parts: &[PartState]) -> Result<Vec<f64>, String> {
        let unit_field = |row: usize, j: usize| {
            self.library.entries[centers[j]].pump.direction_at(parts[row / 2].position_m)[row % 2]
        };
        let phi = DMatrix::from_fn(2 * parts.len(), centers.len(), unit_field);
        let scale = LONGEST_M / largest_step_m(parts).max(LONGEST_M);
        let steps = parts.iter().flat_map(|part| [scale * part.step_m.x, scale * part.step_m.y]);
        let steps_m = DVector::from_iterator(2 * parts.len(), steps);
        let svd = phi.svd(true, true);
        let least = RANK * svd.singular_values.max();
        Ok(svd.solve(&steps_m, least)?.as_slice().to_vec())
    }

    /// The rotations in sequence, each limited to the library's longest pulse; those too short for a pulse are left
    /// out.
    fn sequence(&self, centers: &[usize], parts: &[PartState], distances_m: &[f64]) -> Plan {
        let mut at_m: Vec<Vec2> = parts.iter().map(|part| part.position_m).collect();
        let mut plan = ended(PlanStatus::Solved, centers);
        for (&number, &wanted_m) in centers.iter().zip(distances_m) {
            let Some(entry) = self.library.entries.get(number) else { continue };
            let Some((length_m, sustain_s)) = self.pulse(entry, &at_m, wanted_m.abs()) else { continue };
            let distance_m = length_m.copysign(wanted_m);
            at_m = after(entry, distance_m, &at_m);
            let rest_s = self.library.rest_after(sustain_s);
            let rotation = Rotation { entry: number, distance_m, amplitude: 1.0, sustain_s, rest_s };
            plan.pulses.push(PlannedPulse::Rotation(rotation));
            plan.predicted_m.push(at_m.clone());
        }
        if plan.pulses.is_empty() {
            plan.status = PlanStatus::NothingToDo;
        }
        plan
    }

    /// Length, m, and sustain, s, of the pulse about `entry` closest to `wanted_m`; `None` where no pulse is closer
    /// than no motion.
    fn pulse(&self, entry: &Entry, at_m: &[Vec2], wanted_m: f64) -> Option<(f64, f64)> {
        let model = &self.library.displacement;
        let speed = at_m.iter().map(|&p| entry.speed_at(p)).fold(0.0, f64::max);
        let shortest_m = model.min_distance(speed);
        let length_m = wanted_m.min(LONGEST_M).max(shortest_m).min(model.max_distance(speed));
        let worth = length_m > 0.0 && wanted_m >= 0.5 * shortest_m;
        let sustain_s = worth.then(|| model.sustain_for(speed, length_m)).flatten()?;
        Some((length_m, sustain_s))
    }
}

fn ended(status: PlanStatus, centers: &[usize]) -> Plan {
    Plan { status, candidates: centers.to_vec(), ..Plan::default() }
}

/// Positions after `distance_m` along the ideal field of `entry`, at any distance from its centre.
fn after(entry: &Entry, distance_m: f64, at_m: &[Vec2]) -> Vec<Vec2> {
    at_m.iter().map(|&p| p + entry.pump.direction_at(p) * distance_m).collect()
}

/// Up to `count` each of the library's strong and gentle rotations about centres on the plate.
fn fixed_centers(library: &Library, half_side_m: f64, count: usize) -> [Vec<usize>; 2] {
    let center_of = |(number, entry): (usize, &Entry)| Some((number, entry.center_m()?, entry.pump.spin_radps.abs()));
    let on_plate: Vec<(usize, Vec2, f64)> =
        library.entries.iter().enumerate().filter_map(center_of).filter(|(_, c, _)| c.amax() <= half_side_m).collect();
    let mut spins: Vec<f64> = on_plate.iter().map(|&(_, _, spin)| spin).collect();
    spins.sort_by(f64::total_cmp);
    let least = STRONG * spins.get(spins.len() * 9 / 10).copied().unwrap_or_default();
    let (strong, gentle): (Vec<_>, Vec<_>) = on_plate.into_iter().partition(|&(_, _, spin)| spin >= least);
    [strong, gentle].map(|set| spread(&set, count))
}

/// `count` entries with centres far from each other, by farthest-point sampling: first the one nearest the middle of
/// the plate, then always the one farthest from all chosen so far.
fn spread(set: &[(usize, Vec2, f64)], count: usize) -> Vec<usize> {
    let mut apart_m: Vec<f64> = set.iter().map(|(_, center_m, _)| -center_m.norm()).collect();
    let mut chosen = Vec::with_capacity(count);
    while chosen.len() < count.min(set.len()) {
        let candidates = apart_m.iter().enumerate();
        let farthest = candidates.max_by(|a, b| a.1.total_cmp(b.1).then(b.0.cmp(&a.0))).map(|(i, _)| i);
        let Some(&(number, center_m, _)) = farthest.and_then(|i| set.get(i)) else { break };
        let first = chosen.is_empty();
        for (apart, (_, other_m, _)) in apart_m.iter_mut().zip(set) {
            let to_new = (other_m - center_m).norm();
            *apart = if first { to_new } else { apart.min(to_new) };
        }
        chosen.push(number);
    }
    chosen
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::planner::fixture::{HALF_SIDE_M, ends_without_a_plan, library, mm, params, penny, rotations, scene};
    use upm_core::geometry::Twist;

    fn planner() -> PseudoInverse {
        PseudoInverse::new(library(), params())
    }

    #[test]
    fn two_centers_and_one_part_by_hand() {
        let mut two = (*library()).clone();
        two.entries.truncate(2);
        // left of the part, turning left: the field points up; below it, turning right: the field points right
        two.entries[0].pump = Twist::about(mm(-50.0, 10.0), 8.0);
        two.entries[1].pump = Twist::about(mm(10.0, -30.0), -8.0);
        let plan = PseudoInverse::new(two.into(), params()).plan(&[penny(mm(10.0, 10.0), mm(2.0, -3.0))]);
        assert_eq!(plan.status, PlanStatus::Solved);
        let about: Vec<(usize, f64)> = rotations(&plan).map(|p| (p.entry, (p.distance_m * 1e9).round())).collect();
        assert_eq!(about, [(1, 2e6), (0, -3e6)], "the centre nearer the middle first");
        assert!((plan.predicted_m[0][0] - mm(12.0, 10.0)).norm() < 1e-12);
        assert!((plan.predicted_m[1][0] - mm(12.0, 7.0)).norm() < 1e-12);
    }

    #[test]
    fn unsolvable_inputs_end_without_a_plan() {
        ends_without_a_plan(|parts| planner().plan(parts).status);
        let mut empty = (*library()).clone();
        empty.entries.clear();
        let plan = PseudoInverse::new(empty.into(), params()).plan(&[penny(mm(1.0, 2.0), mm(1.0, 0.0))]);
        assert_eq!(plan.status, PlanStatus::Infeasible(Limit::Unreachable));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(96))]

        /// On the ideal field each rotation starts with an offset by those before it of at most `Σ|d|`; a unit field
        /// about a centre ρ away turns by `δ/ρ` over a displacement δ. Hence the error is at most
        /// `½ (Σ|d|)² / (ρ - Σ|d|)`.
        #[test]
        fn one_step_is_right_to_second_order(count in 1usize..7, seed: u64) {
            let parts = scene(count, 1e-6, seed);
            let planner = planner();
            let [centers, _] = fixed_centers(&planner.library, HALF_SIDE_M, 2 * count);
            let distances_m = planner.distances_m(&centers, &parts).unwrap();
            let entries: Vec<&Entry> = centers.iter().map(|&j| &planner.library.entries[j]).collect();
            let sum_m: f64 = distances_m.iter().map(|d| d.abs()).sum();
            let nearest_m = (entries.iter().flat_map(|e| parts.iter().map(|p| (p.position_m - e.center_m().unwrap()).norm())))
                .fold(f64::INFINITY, f64::min);
            prop_assume!(sum_m < 0.1 * nearest_m);
            let start: Vec<Vec2> = parts.iter().map(|part| part.position_m).collect();
            let end = entries.iter().zip(&distances_m).fold(start, |at, (entry, &d)| after(entry, d, &at));
            let bound_m = 0.5 * sum_m * sum_m / (nearest_m - sum_m) + 1e-12;
            for (part, p) in parts.iter().zip(end) {
                prop_assert!((p - part.position_m - part.step_m).norm() <= bound_m, "{bound_m:e}");
            }
        }

        #[test]
        fn pulses_stay_within_the_library(count in 1usize..9, reach_m in 0.0..0.05f64, seed: u64) {
            let parts = scene(count, reach_m, seed);
            let plan = planner().plan(&parts);
            prop_assert_eq!(&plan, &planner().plan(&parts), "the same again");
            prop_assert_eq!(plan.pulses.len(), plan.predicted_m.len());
            prop_assert_eq!(plan.status == PlanStatus::Solved, !plan.pulses.is_empty());
            let model = &library().displacement;
            let mut at_m: Vec<Vec2> = parts.iter().map(|part| part.position_m).collect();
            for (pulse, predicted_m) in rotations(&plan).zip(&plan.predicted_m) {
                let entry = &library().entries[pulse.entry];
                let speed = at_m.iter().map(|&p| entry.speed_at(p)).fold(0.0, f64::max);
                prop_assert!((model.distance(speed, pulse.sustain_s) - pulse.distance_m.abs()).abs() < 1e-8);
                prop_assert!(pulse.distance_m.abs() <= LONGEST_M + 1e-12);
                for (before, now) in at_m.iter().zip(predicted_m) {
                    let way = (now - before).norm();
                    prop_assert!(way < 1e-12 || (way - pulse.distance_m.abs()).abs() < 1e-12, "equally far, or on the centre");
                }
                at_m.clone_from(predicted_m);
            }
        }
    }
}
