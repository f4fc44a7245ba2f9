use proptest::prelude::*;
use rand::RngExt;
use std::f64::consts::TAU;

use super::*;
use crate::task::{PENNY_M, PartOutline};
use upm_core::random::Streams;

const ARRIVE_M: f64 = 0.0005;
const CORNERS: usize = 60;

fn params(paths: Vec<PathParams>, in_phase: bool) -> TrajectoriesParams {
    TrajectoriesParams {
        scene: PlateScene {
            half_side_m: 0.1524,
            discs: vec![PartOutline { kind: 0, radius_m: PENNY_M }; paths.len()],
            ..PlateScene::default()
        },
        paths,
        in_phase,
        lead_m: 0.004,
        stride_m: 0.012,
        arrive_m: ARRIVE_M,
        corridor_m: 0.001,
    }
}

fn square(side_m: f64) -> Vec<Vec2> {
    [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(x, y)| Vec2::new(x, y) * side_m).to_vec()
}

fn square_path(side_m: f64, speed_mps: f64, repeat: u32) -> PathParams {
    PathParams { waypoints_m: square(side_m), speed_mps, repeat, exchange: false }
}

/// A figure eight that starts at fraction `turn` of its corners.
fn eight(turn: f64) -> Vec<Vec2> {
    let at = |i: usize| TAU * (i as f64 / CORNERS as f64 + turn);
    (0..CORNERS).map(|i| Vec2::new(0.08 * at(i).sin(), 0.04 * (2.0 * at(i)).sin())).collect()
}

fn three_on_one_eight(laps: u32) -> TrajectoriesParams {
    let speed_mps = Polyline::new([eight(0.0), eight(0.0)[..1].to_vec()].concat()).length_m() / 30.0;
    let path =
        |i| PathParams { waypoints_m: eight(0.05 + f64::from(i) / 3.0), speed_mps, repeat: laps, exchange: false };
    TrajectoriesParams { corridor_m: 0.002, ..params((0..3).map(path).collect(), true) }
}

/// Result of a run on the paths.
#[derive(Debug, Default)]
struct Course {
    /// Time from the first waypoints to the end, s.
    took_s: f64,
    phase_error: f64,
    off_m: f64,
    gap_m: f64,
    late_laps: Vec<u32>,
    end: String,
}

/// Parts that make `gain` of their steps within a few percent, in cycles of changing length.
fn run(params: TrajectoriesParams, starts_m: &[Vec2], mut gain: impl FnMut(usize, f64) -> f64) -> Course {
    let mut rng = Streams::new(3).stream("strays");
    let mut parts = starts_m.to_vec();
    let mut course = Course { gap_m: f64::INFINITY, ..Course::default() };
    let mut task = Trajectories::new(params);
    let (mut progress, mut laps, mut begun_at_s, mut at_s) = (0.0, 0, None, 0.0);
    for _ in 0..3000 {
        let wanted = task.next(PlateTime::from_secs(at_s), &parts);
        assert!(wanted.progress >= progress && wanted.progress <= 1.0 && wanted.laps >= laps, "{wanted:?}");
        (progress, laps) = (wanted.progress, wanted.laps);
        course.took_s = at_s - begun_at_s.unwrap_or(at_s);
        if wanted.done {
            assert!(parts.iter().zip(&wanted.targets_m).all(|(part, target)| (part - target).norm() <= ARRIVE_M));
            return Course { end: wanted.phase, ..course };
        }
        if !wanted.paths.is_empty() {
            begun_at_s.get_or_insert(at_s);
        }
        let late = wanted.late_lap.map(|late| late.lap).filter(|lap| course.late_laps.last() != Some(lap));
        course.late_laps.extend(late);
        course.phase_error = wanted.phase_error.iter().fold(course.phase_error, |most, error| most.max(error.abs()));
        course.off_m = wanted.cross_track_m.iter().copied().fold(course.off_m, f64::max);
        for (i, part) in parts.iter_mut().enumerate() {
            let step = wanted.subgoals_m[i] - *part;
            let stray = Vec2::new(rng.random_range(-0.04..0.04), rng.random_range(-0.04..0.04)) * step.norm();
            *part += gain(i, at_s) * step.cap_magnitude(0.012) + stray;
        }
        for i in 0..parts.len() {
            for j in 0..i {
                course.gap_m = course.gap_m.min((parts[i] - parts[j]).norm() - 2.0 * PENNY_M);
            }
        }
        at_s += rng.random_range(0.3..0.6);
    }
    panic!("not done: {course:?}");
}

const THREE_STARTS: [Vec2; 3] = [Vec2::new(-0.1, -0.1), Vec2::new(0.1, -0.1), Vec2::new(0.0, 0.1)];

#[test]
fn speed_is_held_in_plate_time() {
    // three sides of the last lap, four of each before
    for (repeat, sides) in [(1, 3.0), (2, 7.0), (3, 11.0)] {
        let course = run(params(vec![square_path(0.04, 0.01, repeat)], false), &[Vec2::new(-0.02, 0.0)], |_, _| 1.0);
        assert!((course.took_s - sides * 4.0).abs() < 1.5, "{repeat}: {course:?}");
        assert!(course.late_laps.is_empty() && course.end == "all paths followed to their ends", "{course:?}");
    }
}

/// Where a path runs back over itself both passes are equally near: the part is on the one where it is expected.
#[test]
fn path_there_and_back_is_followed_round_both_ends() {
    for (speed_mps, repeat) in [(0.004, 1), (0.01, 2), (0.02, 3), (0.008, 3)] {
        let path =
            PathParams { waypoints_m: vec![Vec2::zeros(), Vec2::new(0.06, 0.03)], speed_mps, repeat, exchange: false };
        let asked_s = f64::from(2 * repeat - 1) * Vec2::new(0.06, 0.03).norm() / speed_mps;
        let course = run(params(vec![path], false), &[Vec2::new(0.001, -0.02)], |_, _| 1.0);
        assert!((course.took_s / asked_s - 1.0).abs() < 0.1 && course.off_m < 0.001, "{asked_s}: {course:?}");
    }
}

#[test]
fn speed_that_cannot_be_held_is_reported_with_its_laps() {
    let course = run(params(vec![square_path(0.04, 0.5, 3)], false), &[Vec2::zeros()], |_, _| 1.0);
    assert_eq!(course.late_laps, [1, 2]);
    assert!(course.end.starts_with("all paths followed to their ends, at "), "{course:?}");
}

#[test]
fn corners_are_cut_by_less_than_the_corridor() {
    let course = run(params(vec![square_path(0.04, 0.02, 2)], false), &[Vec2::zeros()], |_, _| 1.0);
    assert!(course.off_m < 0.001, "{course:?}");
}

#[test]
fn three_go_round_one_figure_eight_in_phase() {
    let course = run(three_on_one_eight(3), &THREE_STARTS, |_, _| 1.0);
    assert!(course.phase_error < 0.02 && course.off_m < 0.0015 && course.gap_m > 0.01, "{course:?}");
    assert!((course.took_s - 90.0).abs() < 2.0, "they do not lag: {course:?}");
}

#[test]
fn all_in_phase_wait_for_one_that_is_held_up() {
    // the second part stands still for 5 s
    let held = |part: usize, at_s: f64| if part == 1 && (30.0..35.0).contains(&at_s) { 0.0 } else { 1.0 };
    let course = run(three_on_one_eight(2), &THREE_STARTS, held);
    let lap_m = Polyline::new(eight(0.0)).length_m();
    assert!(course.phase_error < (0.012 + 0.004) / lap_m && course.gap_m > 0.01, "{course:?}");
    assert!(course.took_s > 62.0 && course.took_s < 68.0, "{course:?}");
}

#[test]
fn the_other_branch_of_a_crossing_is_not_taken() {
    let mut params = three_on_one_eight(0);
    params.paths.truncate(1);
    params.paths[0].waypoints_m = eight(0.0);
    let mut task = Trajectories::new(params);
    let firsts = [Vec2::zeros(), Vec2::new(0.1, 0.1), Vec2::new(-0.1, 0.1)];
    task.next(PlateTime::ZERO, &firsts);
    // half a lap on, the path passes the same position again
    for (observe, x) in (1..).zip([0.001, -0.001, 0.0005]) {
        let seen = [Vec2::new(x, -x), firsts[1], firsts[2]];
        let wanted = task.next(PlateTime::from_secs(0.01 * f64::from(observe)), &seen);
        assert!(wanted.phase_error[0].abs() < 0.01 && wanted.phase_error[1..] == [0.0, 0.0], "{wanted:?}");
        assert_eq!((&wanted.subgoals_m[1..], &wanted.paths[1..]), (&firsts[1..], &[None, None][..]));
    }
}

#[test]
fn parts_that_may_exchange_take_the_nearer_path() {
    let line = |x: f64| PathParams {
        waypoints_m: vec![Vec2::new(x, 0.0), Vec2::new(x, 0.05)],
        exchange: true,
        ..square_path(0.0, 0.01, 1)
    };
    let mut task = Trajectories::new(params(vec![line(-0.05), line(0.05)], false));
    let firsts_m = [0.05, -0.05].map(|x| Vec2::new(x, 0.0));
    let wanted = task.next(PlateTime::ZERO, &firsts_m.map(|first_m| first_m - Vec2::new(0.0, 0.02)));
    assert_eq!(wanted.targets_m, firsts_m);
    let wanted = task.next(PlateTime::from_secs(1.0), &firsts_m);
    assert_eq!(wanted.targets_m, firsts_m.map(|first_m| first_m + Vec2::new(0.0, 0.05)));
}

fn any_path() -> impl Strategy<Value = PathParams> {
    let corner = (-0.08..0.08f64, -0.08..0.08f64).prop_map(|(x, y)| Vec2::new(x, y));
    (proptest::collection::vec(corner, 1..5), 0.004..0.03f64, 1u32..3)
        .prop_map(|(waypoints_m, speed_mps, repeat)| PathParams { waypoints_m, speed_mps, repeat, exchange: false })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn one_part_finishes_its_path_and_never_exceeds_its_speed(path in any_path(), gain in 0.7..1.2f64) {
        let course = run(params(vec![path.clone()], false), &[Vec2::zeros()], |_, _| gain);
        let follower = CurveFollower::new(path, false);
        prop_assert!(course.took_s >= follower.end_m / follower.speed_mps - 1.2);
    }

    #[test]
    fn outputs_are_finite_for_nonfinite_inputs(
        paths in proptest::collection::vec(any_path(), 0..3), in_phase: bool,
        speed_mps in prop_oneof![Just(0.0), Just(f64::NAN), Just(-1.0), Just(1e300)],
        seen in proptest::collection::vec(prop_oneof![Just(f64::NAN), Just(f64::INFINITY), -0.1..0.1f64], 24),
    ) {
        let paths = paths.into_iter().map(|path| PathParams { speed_mps, ..path }).collect();
        let mut task = Trajectories::new(TrajectoriesParams { arrive_m: 1.0, ..params(paths, in_phase) });
        for (cycle, six) in (0u32..).zip(seen.chunks(6)) {
            let parts: Vec<Vec2> = six.chunks(2).map(|p| Vec2::new(p[0], p[1])).collect();
            let wanted = task.next(PlateTime::from_secs(f64::from(cycle)), &parts);
            let numbers = wanted.subgoals_m.iter().chain(&wanted.targets_m).flat_map(|p| p.iter());
            prop_assert!(numbers.chain(&wanted.cross_track_m).chain(&wanted.phase_error).all(|x| x.is_finite()), "{wanted:?}");
            prop_assert!(wanted.progress.is_finite());
        }
    }
}
