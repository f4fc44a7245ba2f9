//! Invariants of every plan of rotations.

use proptest::prelude::*;

use super::planner;
use crate::planner::corridor::UNSEEN_M;
use crate::planner::fixture::{
    HALF_SIDE_M, PENNY_M, ends_without_a_plan, library, mm, params, penny, rotations, scene,
};
use crate::planner::{Corridor, Limit, PartState, Plan, PlanStatus, RotationPlanner};
use upm_core::geometry::{Polyline, Vec2};

/// Checks the forecast of each pulse, its setting, and the limits along the path.
fn keeps_its_promises(parts: &[PartState], plan: &Plan) -> Result<(), TestCaseError> {
    let (planner, params) = (planner(), params());
    prop_assert_eq!(plan.pulses.len(), plan.predicted_m.len());
    prop_assert_eq!(plan.status == PlanStatus::Solved, !plan.pulses.is_empty());
    let mut at = parts.to_vec();
    for (pulse, predicted) in rotations(plan).zip(&plan.predicted_m) {
        prop_assert!(pulse.amplitude > 0.0 && pulse.amplitude <= 1.0);
        prop_assert!((0.0..=params.max_sustain_s).contains(&pulse.sustain_s) && pulse.rest_s > 0.0);
        let forecast = planner.forecast(&at, pulse);
        for (part, (forecast, predicted)) in at.iter_mut().zip(forecast.iter().zip(predicted)) {
            prop_assert!((forecast - predicted).norm() < 2e-6, "{forecast} {predicted}");
            part.position_m = *predicted;
        }
    }
    for stage in &plan.predicted_m {
        for (i, p) in stage.iter().enumerate() {
            let start = parts[i].position_m.amax();
            prop_assert!(p.amax() <= (HALF_SIDE_M - PENNY_M - 0.5 * params.edge_margin_m).max(start) + 1e-6);
            for (j, q) in stage.iter().enumerate().skip(i + 1) {
                let start = (parts[i].position_m - parts[j].position_m).norm();
                prop_assert!((p - q).norm() >= (2.0 * PENNY_M + 0.5 * params.separation_m).min(start) - 1e-6);
            }
        }
    }
    Ok(())
}

/// Root of the sum of the squared distances left after the plan, m.
fn left_m(parts: &[PartState], plan: &Plan) -> f64 {
    let end = plan.predicted_m.last().cloned().unwrap_or_else(|| parts.iter().map(|part| part.position_m).collect());
    end.iter().zip(parts).map(|(end, part)| (part.position_m + part.step_m - end).norm_squared()).sum::<f64>().sqrt()
}

/// A corridor straight along a part's step.
fn straight(part: &PartState, half_width_m: f64) -> Option<Corridor> {
    let line = Polyline::new(vec![part.position_m, part.position_m + part.step_m]);
    Some(Corridor { line, half_width_m })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn plans_match_their_forecasts_and_keep_the_limits(count in 1usize..9, reach_m in 0.0..0.03f64, seed: u64) {
        let parts = scene(count, reach_m, seed);
        let plan = planner().plan(&parts, &[]);
        keeps_its_promises(&parts, &plan)?;
        prop_assert!(!matches!(plan.status, PlanStatus::SolverFailed(_)), "{:?}", plan.status);
        prop_assert_eq!(&planner().plan(&parts, &[]), &plan, "the same again");
    }

    /// Alone, a part goes straight: no place after a pulse, nor halfway through one, is outside the corridor. About one
    /// step in 400 is halved for that, since every sequence over all of it leaves the corridor.
    #[test]
    fn one_part_stays_in_its_corridor(x in -60.0..60.0f64, y in -60.0..60.0f64, angle in 0.0..6.3f64, way in 1.0..12.0f64) {
        let part = penny(mm(x, y), mm(way * angle.cos(), way * angle.sin()));
        let plan = planner().plan(&[part], &[straight(&part, 0.3e-3)]);
        prop_assert_eq!((&plan.status, plan.corridor_excess), (&PlanStatus::Solved, None));
        let left = 1e3 * left_m(&[part], &plan) / way;
        prop_assert!([0.0, 0.5, 0.75].iter().any(|halved| (left - halved).abs() < 0.1), "{left} {plan:?}");
        for places_m in &plan.predicted_m {
            let along = part.step_m.normalize();
            let off_m = (places_m[0] - part.position_m).perp(&along).abs();
            prop_assert!(off_m < 0.3e-3 + UNSEEN_M, "{off_m}");
        }
    }

    /// Corridors of several parts narrow their courses, and what is outside is named.
    #[test]
    fn several_parts_leave_their_corridors_least(count in 2usize..4, seed in 0u64..1000) {
        let parts = scene(count, 6e-3, seed);
        let corridors: Vec<_> = parts.iter().map(|part| straight(part, 1e-3)).collect();
        let off_m = |plan: &Plan| -> f64 {
            let off = |(corridor, p_m): (&Option<Corridor>, &Vec2)| corridor.as_ref().unwrap().off(*p_m).norm();
            plan.predicted_m.iter().flat_map(|places_m| corridors.iter().zip(places_m)).map(off).fold(0.0, f64::max)
        };
        let (free, bound) = (planner().plan(&parts, &[]), planner().plan(&parts, &corridors));
        prop_assume!(free.status == PlanStatus::Solved && bound.status == PlanStatus::Solved);
        let excess_m = bound.corridor_excess.map_or(UNSEEN_M, |(_, by_m)| by_m);
        prop_assert!(off_m(&bound) <= 1e-3 + excess_m + 1e-9);
        prop_assert!(off_m(&bound) <= off_m(&free).max(2e-3), "{} {}", off_m(&bound), off_m(&free));
    }

}

#[test]
fn part_in_a_corner_is_not_moved_off_the_plate() {
    let corner = HALF_SIDE_M - PENNY_M - params().edge_margin_m;
    for step in [mm(5.0, 5.0), mm(5.0, 0.0), mm(0.0, 3.0)] {
        let parts = [penny(Vec2::new(corner, corner), step)];
        let plan = planner().plan(&parts, &[]);
        keeps_its_promises(&parts, &plan).unwrap();
        assert!(plan.predicted_m.iter().flatten().all(|p| p.amax() < corner + params().edge_margin_m));
    }
    let inwards = planner().plan(&[penny(Vec2::new(corner, corner), mm(-5.0, -3.0))], &[]);
    assert_eq!(inwards.status, PlanStatus::Solved);
}

#[test]
fn a_part_beyond_the_margin_is_not_stuck() {
    let parts =
        [penny(Vec2::new(HALF_SIDE_M - PENNY_M + 1e-3, 0.02), mm(-4.0, 0.0)), penny(mm(-30.0, 0.0), mm(0.0, 3.0))];
    let plan = planner().plan(&parts, &[]);
    assert_eq!(plan.status, PlanStatus::Solved);
    keeps_its_promises(&parts, &plan).unwrap();
}

#[test]
fn parts_that_touch_can_be_moved_apart() {
    let touching = [penny(mm(-9.6, 0.0), mm(4.0, 0.0)), penny(mm(9.6, 0.0), mm(-4.0, 0.0))];
    keeps_its_promises(&touching, &planner().plan(&touching, &[])).unwrap();
    let apart = touching.map(|part| penny(part.position_m, -part.step_m));
    let plan = planner().plan(&apart, &[]);
    assert_eq!(plan.status, PlanStatus::Solved);
    keeps_its_promises(&apart, &plan).unwrap();
}

#[test]
fn plans_end_without_pulses_where_there_is_nothing_to_do_or_nothing_that_moves() {
    ends_without_a_plan(|parts| planner().plan(parts, &[]).status);
    let mut still = (*library()).clone();
    still.entries.truncate(3);
    still.entries.iter_mut().for_each(|entry| entry.pump = entry.pump * 1e-4);
    let plan = RotationPlanner::new(still.into(), params()).plan(&[penny(mm(1.0, 2.0), mm(1.0, 0.0))], &[]);
    assert_eq!(plan.status, PlanStatus::Infeasible(Limit::Unreachable));
}

#[test]
fn a_target_that_jumps_ends_the_sequence_and_one_that_creeps_is_followed() {
    let mut planner = planner();
    let parts = scene(3, 0.02, 5);
    assert_eq!(planner.plan(&parts, &[]).status, PlanStatus::Solved);
    let creeping: Vec<PartState> =
        parts.iter().map(|part| PartState { step_m: part.step_m + mm(0.2, 0.0), ..*part }).collect();
    keeps_its_promises(&creeping, &planner.plan(&creeping, &[])).unwrap();
    let jumping: Vec<PartState> = parts.iter().map(|part| PartState { step_m: -part.step_m, ..*part }).collect();
    let plan = planner.plan(&jumping, &[]);
    assert_eq!(plan.status, PlanStatus::Solved);
    assert!(left_m(&jumping, &plan) < left_m(&jumping, &Plan { predicted_m: Vec::new(), ..plan.clone() }));
}
