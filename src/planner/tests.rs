use proptest::prelude::*;

use super::field::{Columns, push_column};
use super::fixture::{HALF_SIDE_M, PENNY_M, ends_without_a_plan, library, mm, params, penny, rotations, scene};
use super::{Limit, PartState, Plan, PlanStatus, Planner, Reach};
use upm_core::geometry::Vec2;

fn planner() -> Planner {
    Planner::new(library(), params())
}

/// How far apart the ends of a way lie, as a part of it, when it turns by `angle_rad`: on a circle, and where it is thrown
/// outwards by 0.17 of the squared angle, the most that was measured.
fn bent(angle_rad: f64) -> [f64; 2] {
    if angle_rad.abs() < 1e-6 || !angle_rad.is_finite() {
        return [1.0; 2];
    }
    [0.0, 0.17].map(|growth| {
        let end = 1.0 + growth * angle_rad * angle_rad;
        (end * end - 2.0 * end * angle_rad.cos() + 1.0).max(0.0).sqrt() / angle_rad.abs()
    })
}

/// What a pulse's d and the way that its sustain makes may differ by, m.
const SAME_M: f64 = 1e-6;

/// Every promise a plan makes, whatever its status.
fn keeps_its_promises(parts: &[PartState], plan: &Plan) -> Result<(), TestCaseError> {
    let (library, params) = (library(), params());
    prop_assert_eq!(plan.pulses.len(), plan.predicted_m.len());
    prop_assert_eq!(plan.status == PlanStatus::Solved, !plan.pulses.is_empty());
    prop_assert!(plan.pulses.len() <= params.max_pulses);
    let (low_m, high_m) = (params.min_distance_m - 1e-6, params.max_distance_m + 1e-6);
    let mut at: Vec<Vec2> = parts.iter().map(|part| part.position_m).collect();
    for (pulse, predicted) in rotations(plan).zip(&plan.predicted_m) {
        prop_assert!((low_m..=high_m).contains(&pulse.distance_m.abs()), "{}", pulse.distance_m);
        prop_assert!((0.0..=0.25).contains(&pulse.sustain_s));
        let entry = &library.entries[pulse.entry];
        let (mut farthest_m, mut least_m, mut most_m, mut fastest_mps) = (0.0f64, 0.0, 0.0f64, 0.0);
        for ((part, p), predicted) in parts.iter().zip(&mut at).zip(predicted) {
            let way_m = part.gain * library.displacement_at(pulse.entry, *p, pulse.sustain_s).norm();
            let (step_m, speed_mps) = ((predicted - *p).norm(), entry.speed_at(*p));
            let [chord, grown] = bent(way_m * entry.pump.spin_radps / speed_mps);
            prop_assert!(step_m >= chord * way_m - 1e-9 && step_m <= grown * way_m + 1e-9, "{step_m} {way_m}");
            if speed_mps > fastest_mps {
                (fastest_mps, least_m) = (speed_mps, chord * pulse.distance_m.abs());
            }
            farthest_m = farthest_m.max(step_m);
            most_m = most_m.max(grown * pulse.distance_m.abs());
            *p = *predicted;
        }
        prop_assert!(
            farthest_m >= least_m - SAME_M && farthest_m <= most_m + SAME_M,
            "{farthest_m} {least_m} {most_m}: d is the way on the fastest belt"
        );
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

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn plans_keep_their_promises(count in 1usize..13, reach_m in 0.0..0.02f64, seed: u64) {
        let parts = scene(count, reach_m, seed);
        let plan = planner().plan(&parts);
        keeps_its_promises(&parts, &plan)?;
        prop_assert!(!matches!(plan.status, PlanStatus::SolverFailed(_)), "{:?}", plan.status);
        prop_assert_eq!(&planner().plan(&parts), &plan, "the same again");
    }

    #[test]
    fn one_part_goes_where_it_should(x in -60.0..60.0f64, y in -60.0..60.0f64, angle in 0.0..6.3f64, way in 1.0..12.0f64) {
        let part = penny(mm(x, y), mm(way * angle.cos(), way * angle.sin()));
        let plan = planner().plan(&[part]);
        prop_assert_eq!(&plan.status, &PlanStatus::Solved);
        prop_assert_eq!(plan.pulses.len(), 1, "one of 305 directions is within a few degrees");
        let left = part.position_m + part.step_m - plan.predicted_m[0][0];
        prop_assert!(left.norm() <= (0.15 * part.step_m.norm()).max(0.2e-3), "{}", left.norm());
    }
}

#[test]
fn a_corner_holds_what_wants_out() {
    let corner = HALF_SIDE_M - PENNY_M - params().edge_margin_m;
    for step in [mm(5.0, 5.0), mm(5.0, 0.0), mm(0.0, 3.0)] {
        let plan = planner().plan(&[penny(Vec2::new(corner, corner), step)]);
        assert_eq!(plan.status, PlanStatus::Infeasible(Limit::Edge { part: 0 }));
        assert!(plan.pulses.is_empty() && plan.predicted_m.is_empty());
    }
    let inwards = planner().plan(&[penny(Vec2::new(corner, corner), mm(-5.0, -3.0))]);
    assert_eq!(inwards.status, PlanStatus::Solved);
}

#[test]
fn a_part_beyond_the_margin_is_not_stuck() {
    let parts =
        [penny(Vec2::new(HALF_SIDE_M - PENNY_M + 1e-3, 0.02), mm(-4.0, 0.0)), penny(mm(-30.0, 0.0), mm(0.0, 3.0))];
    let plan = planner().plan(&parts);
    assert_eq!(plan.status, PlanStatus::Solved);
    keeps_its_promises(&parts, &plan).unwrap();
}

#[test]
fn parts_pressed_together_stop_each_other() {
    let parts = [penny(mm(-10.3, 0.0), mm(4.0, 0.0)), penny(mm(10.3, 0.0), mm(-4.0, 0.0))];
    let touching = [penny(mm(-9.6, 0.0), mm(4.0, 0.0)), penny(mm(9.6, 0.0), mm(-4.0, 0.0))];
    for parts in [parts, touching] {
        let plan = planner().plan(&parts);
        keeps_its_promises(&parts, &plan).unwrap();
        if plan.status != PlanStatus::Solved {
            assert_eq!(plan.status, PlanStatus::Infeasible(Limit::Separation { parts: [0, 1] }));
        }
    }
    let apart = touching.map(|part| penny(part.position_m, -part.step_m));
    assert_eq!(planner().plan(&apart).status, PlanStatus::Solved);
}

#[test]
fn endings_that_are_no_plan() {
    ends_without_a_plan(|parts| planner().plan(parts).status);
    let mut still = (*library()).clone();
    still.entries.truncate(3);
    still.displacement.distance_m.iter_mut().flatten().for_each(|d| *d = 0.0);
    let plan = Planner::new(still.into(), params()).plan(&[penny(mm(1.0, 2.0), mm(1.0, 0.0))]);
    assert_eq!(plan.status, PlanStatus::Infeasible(Limit::Unreachable));
}

#[test]
fn gain_shortens_the_pulse() {
    let part = penny(mm(20.0, -30.0), mm(6.0, 0.0));
    let first_m = |parts: &[PartState]| rotations(&planner().plan(parts)).next().unwrap().distance_m.abs();
    let slow = first_m(&[part]);
    let eager = first_m(&[PartState { gain: 1.25, ..part }]);
    assert!((slow / eager - 1.25).abs() < 0.05, "{slow} {eager}");
}

#[test]
fn sparser_and_shorter_than_a_pseudo_inverse() {
    let (library, count) = (library(), 4);
    let (mut planned, mut planned_m, mut plain, mut plain_m) = (0, 0.0, 0, 0.0);
    for seed in 0..8 {
        let parts = scene(count, 0.004, seed);
        let plan = planner().plan(&parts);
        planned += plan.pulses.len();
        planned_m += rotations(&plan).map(|pulse| pulse.distance_m.abs()).sum::<f64>();
        // 2N fixed centres round the plate's rim and middle, every one of them turned each cycle (UPM paper, section 2)
        let fixed = [0, 8, 16, 136, 152, 272, 280, 288];
        let mut columns = Columns::default();
        columns.clear(2 * count);
        for j in fixed {
            let positions = parts.iter().map(|part| part.position_m);
            push_column(&mut columns, &library.entries[j], &parts, positions, |v| {
                library.displacement.distance(v, 0.08)
            });
        }
        let matrix = nalgebra::DMatrix::from_fn(2 * count, fixed.len(), |row, j| columns.column(j)[row]);
        let wanted = nalgebra::DVector::from_iterator(2 * count, parts.iter().flat_map(|p| [p.step_m.x, p.step_m.y]));
        let d = matrix.pseudo_inverse(1e-9).unwrap() * wanted;
        plain += d.iter().filter(|d| d.abs() > 1e-4).count();
        plain_m += d.abs().sum();
    }
    eprintln!("planner {planned} pulses, {planned_m:.3} m; pseudo-inverse {plain} pulses, {plain_m:.3} m");
    assert!(planned < plain && planned_m < 0.5 * plain_m, "{planned} {plain} {planned_m} {plain_m}");
}

#[test]
fn reach_tells_the_weak_direction() {
    let everywhere = Reach::of(&library(), mm(20.0, 30.0));
    assert!(everywhere.weakest_projection > 0.9 && everywhere.singular_values[1] > 1.0);
    let mut along_x = (*library()).clone();
    along_x.entries = vec![along_x.entries[289].clone()];
    let reach = Reach::of(&along_x, mm(20.0, 30.0));
    assert!(reach.weakest_direction.x.abs() < 0.02 && reach.weakest_projection < 0.02);
    assert!(reach.singular_values[0] > 0.5 && reach.singular_values[1] < 1e-9);
}
