use super::*;
use crate::ExpectedPart;
use upm_core::rig::PartKind;
use upm_planning::task::PathStretch;

const TOLERANCE_M: f64 = 0.5e-3;

fn wanted(subgoal_m: Vec2, target_m: Vec2) -> Setpoints {
    Setpoints { subgoals_m: vec![subgoal_m], targets_m: vec![target_m], ..Setpoints::default() }
}

fn x(x_m: f64) -> Vec2 {
    Vec2::new(x_m, 0.0)
}

/// Feeds observations until a run of one part is ended; `at` gives the request and the part's position in each
/// cycle.
fn ended_at(paths: bool, cycles: u32, at: impl Fn(u32) -> (Setpoints, Vec2)) -> Option<u32> {
    let mut watch = ProgressWatch::new(paths, TOLERANCE_M);
    (0..cycles).find(|&cycle| {
        let (wanted, seen_m) = at(cycle);
        let wanted = Setpoints { paths: vec![None; usize::from(paths)], ..wanted };
        watch.observe(&wanted, &[seen_m], cycle > 0)
    })
}

#[test]
fn part_that_stays_away_ends_a_run_after_twenty_cycles_and_one_that_comes_nearer_does_not() {
    let there = || wanted(x(0.05), x(0.05));
    assert_eq!(ended_at(false, 100, |_| (there(), x(0.0))), Some(FUTILE_CYCLES));
    let jitter = |cycle: u32| (there(), x(0.0460 + 0.0001 * f64::from(cycle % 2)));
    assert_eq!(ended_at(false, 100, jitter), Some(FUTILE_CYCLES + 1), "the least distance counts");
    assert_eq!(ended_at(false, 500, |cycle| (there(), x(0.05 - 0.05 * 0.999_f64.powi(cycle as i32)))), None);
    assert_eq!(ended_at(true, 100, |_| (there(), x(0.0))), Some(FUTILE_CYCLES), "on a path, too");
    let mut watch = ProgressWatch::new(false, TOLERANCE_M);
    let stalls = (0..FUTILE_CYCLES).map(|cycle| (watch.observe(&there(), &[x(0.0)], cycle > 0), watch.stalls()).1);
    assert_eq!(stalls.filter(|stalls| !stalls).count() as u32, FUTILE_CYCLES / 4, "before that it stalls");
    assert_eq!(ended_at(false, 200, |_| (there(), x(0.0494))), Some(NEAR_CYCLES), "within six times the tolerance");
}

#[test]
fn one_part_that_gets_on_is_progress_until_it_is_there() {
    let targets_m = vec![x(0.0), x(0.1)];
    let wanted = Setpoints { subgoals_m: targets_m.clone(), targets_m, ..Setpoints::default() };
    let mut watch = ProgressWatch::new(false, TOLERANCE_M);
    // the first comes nearer step by step while the second moves away by as much or more
    let ended = (0..300).find(|&cycle| {
        let at_m = 0.02 * 0.99_f64.powi(cycle);
        watch.observe(&wanted, &[x(at_m), x(0.1 + 0.05 - at_m)], cycle > 0)
    });
    assert_eq!(ended, Some(DETOUR_CYCLES as i32), "and not without end");
    let mut watch = ProgressWatch::new(false, TOLERANCE_M);
    let ended = (0..200).find(|&cycle| watch.observe(&wanted, &[x(1e-4 * 0.9_f64.powi(cycle)), x(0.15)], cycle > 0));
    assert_eq!(ended, Some(FUTILE_CYCLES as i32), "one that is there does not count");
}

#[test]
fn more_parts_than_one_motion_serves_have_longer() {
    let ended = |parts: usize| {
        let wanted =
            Setpoints { targets_m: vec![x(0.05); parts], subgoals_m: vec![x(0.05); parts], ..Setpoints::default() };
        let mut watch = ProgressWatch::new(false, TOLERANCE_M);
        (0..300).find(|&cycle| watch.observe(&wanted, &vec![x(0.0); parts], cycle > 0))
    };
    assert_eq!([1, 8, 24].map(ended), [Some(20), Some(20), Some(180)]);
}

#[test]
fn hold_that_holds_starts_the_count_again() {
    let drifts = |cycle: u32| {
        let seen_m = x(if cycle % 15 < 14 { 6e-4 } else { 2e-4 });
        (wanted(if cycle % 15 < 14 { x(0.0) } else { seen_m }, x(0.0)), seen_m)
    };
    assert_eq!(ended_at(false, 300, drifts), None);
}

#[test]
fn way_round_others_counts_by_its_stages_and_not_without_end() {
    // each stage of ten cycles leads away from the target
    let leads_away = |cycle: u32| {
        let at_m = |cycle: u32| x(-0.002 * f64::from(cycle));
        (wanted(at_m(10 * (cycle / 10 + 1)), x(0.1)), at_m(cycle))
    };
    assert_eq!(ended_at(false, 150, leads_away), None);
    assert_eq!(ended_at(false, 500, leads_away), Some(DETOUR_CYCLES));
}

#[test]
fn reference_that_moves_on_is_progress_on_a_path_alone() {
    // a lap of 40 cycles; the part keeps its distance from its subgoal
    let round = |cycle: u32| {
        let angle = f64::from(cycle) * std::f64::consts::TAU / 40.0;
        let at_m = |angle: f64| 0.05 * Vec2::new(angle.cos(), angle.sin());
        (wanted(at_m(angle + 0.1), at_m(0.0)), at_m(angle))
    };
    assert_eq!(ended_at(true, 1000, round), None);
    assert!(ended_at(false, 1000, round).is_some());
}

#[test]
fn part_that_creeps_is_not_getting_on() {
    // the reference stays 4 mm ahead of the part, which advances by 0.2 mm or by 1 mm in each cycle
    let creeps = |step_m: f64| {
        move |cycle: u32| {
            let at_m = step_m * f64::from(cycle);
            (wanted(x(at_m + 0.004), x(0.01)), x(at_m))
        }
    };
    assert_eq!(ended_at(true, 100, creeps(2e-4)), Some(FUTILE_CYCLES));
    assert_eq!(ended_at(true, 100, creeps(1e-3)), None);
    let makes_progress = |step_m: f64| {
        let mut watch = ProgressWatch::new(false, TOLERANCE_M);
        for (wanted, seen_m) in (0..10).map(creeps(step_m)) {
            let wanted = Setpoints { paths: vec![None], ..wanted };
            assert!(!watch.observe(&wanted, &[seen_m], true));
        }
        watch.makes_progress()
    };
    assert_eq!([2e-4, 1e-3].map(makes_progress), [false, true]);
}

#[test]
fn part_that_is_held_up_is_named_with_way_and_limit() {
    let mut watch = ProgressWatch::new(false, TOLERANCE_M);
    let wanted =
        Setpoints { subgoals_m: vec![x(0.0), x(0.02)], targets_m: vec![x(0.0), x(0.02)], ..Setpoints::default() };
    let seen_m = [x(0.001), Vec2::new(0.02, -0.003)];
    watch.observe(&wanted, &seen_m, false);
    watch.note(&PlanStatus::Infeasible(Limit::Edge { part: 1 }));
    let ended = (0..FUTILE_CYCLES).filter(|_| watch.observe(&wanted, &seen_m, true)).count();
    assert_eq!(ended, 1, "in the last cycle");
    let part = |id: &str| ExpectedPart { id: id.into(), kind: 0, expected_m: None };
    let kinds = vec![PartKind { name: "disc".into(), radius_m: 5e-3, thickness_m: 1e-3 }];
    let params = ControlParams { parts: ["a", "b"].map(part).to_vec(), kinds, ..ControlParams::default() };
    let ending = watch.ending(&wanted, &seen_m, &params);
    assert_eq!(ending.cause, Some(Finding::NoProgress.into()));
    let parts = ["less than 1 % nearer in 20 plans", "b is 3.00 mm", "towards 90 deg", "b would cross the edge margin"];
    assert!(parts.iter().all(|part| ending.reason.contains(part)), "{}", ending.reason);
    let blocked = Setpoints { blocked: vec![0], ..wanted.clone() };
    let said = watch.blocking_part_description(&blocked, &seen_m, &params);
    assert_eq!(said, "a is 1.00 mm from its place, which is towards 180 deg, and blocked by other parts");
    watch.note(&PlanStatus::Infeasible(Limit::Separation { parts: [0, 1] }));
    let ending = watch.ending(&wanted, &seen_m, &params);
    assert_eq!(ending.cause, Some(Finding::PartsHinder.into()));
    assert!(ending.reason.starts_with("parts wait for each other: a and b; less"), "{}", ending.reason);
    let (line, from_m, lap_m, is_over) = (upm_core::geometry::Polyline::new(vec![x(0.0), x(0.1)]), 0.0, 0.1, false);
    let path = PathStretch { line, from_m, reference_m: 0.0, speed_mps: 0.01, lap_m, corridor_m: 1e-3, is_over };
    let ending = watch.ending(&Setpoints { paths: vec![Some(path), None], ..wanted.clone() }, &seen_m, &params);
    assert!(ending.reason.contains(": a and b; a `corridor_mm` above 1.0 may help; less"), "{}", ending.reason);
    watch.observe(&wanted, &[x(0.0), x(0.0201)], true);
    assert_eq!(watch.limit, None, "nearer again");
}
