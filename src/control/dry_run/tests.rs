use std::f64::consts::PI;

use proptest::prelude::*;

use super::kinematic_plate::{OPENING_FRAMES, friction};
use super::*;
use crate::{ExpectedPart, pulse_planner::PulsePlanner};
use upm_cor_library::{DisplacementModel, FieldResponse, testing};
use upm_core::geometry::{Twist, Vec2};
use upm_core::signal::{TwistHarmonic, TwistWave};
use upm_core::{job::Outcome, random::Streams, rig::PartKind};
use upm_planner::{Corridor, FieldPulse, PartState, PlannedPulse, PlannerParams, PlanningMethod, Rotation};
use upm_task::{PathParams, Trajectories, TrajectoriesParams};

const HALF_M: f64 = 0.1;
const RADIUS_M: f64 = 0.01;
const ARRIVE_M: f64 = 0.5e-3;
const FRAME_HZ: f64 = 50.0;
const ATTACK_S: f64 = 0.02;
const REST_S: f64 = 0.05;
/// Displacement speed of a pulse on the fastest belt, m per second of sustain, and its longest sustain, s.
const PACE_MPS: f64 = 0.1;
const LONGEST_S: f64 = 0.2;

/// A library of these motions with displacements proportional to sustain and to the belt's speed up to 0.5 m/s.
fn library(pumps: impl IntoIterator<Item = Twist>, relative_sd: f64) -> Arc<Library> {
    let distance_m = vec![vec![0.0, 0.2 * PACE_MPS * LONGEST_S], vec![0.0, PACE_MPS * LONGEST_S]];
    let displacement = DisplacementModel {
        speed_mps: vec![0.1, 0.5],
        sustain_s: vec![0.0, LONGEST_S],
        sd_m: distance_m.iter().map(|row| row.iter().map(|d| relative_sd * d).collect()).collect(),
        distance_m,
    };
    Arc::new(Library {
        plate_side_m: 2.0 * HALF_M,
        attack_s: ATTACK_S,
        rest_s: REST_S,
        displacement,
        ..testing::library(pumps)
    })
}

/// Translations of the plate in 16 directions.
fn translations() -> impl Iterator<Item = Twist> {
    (0..16).map(|k| PI * f64::from(k) / 16.0).map(|angle| Twist::new(0.5 * angle.cos(), 0.5 * angle.sin(), 0.0))
}

fn rotations() -> impl Iterator<Item = Twist> {
    (0..169).map(|k| Twist::about(Vec2::new(f64::from(k % 13 - 6), f64::from(k / 13 - 6)) * (HALF_M / 6.0), 4.0))
}

fn params(parts: usize) -> ControlParams {
    ControlParams {
        kinds: vec![PartKind { name: "slug".into(), radius_m: RADIUS_M, thickness_m: 0.0015 }],
        parts: (1..=parts).map(|n| ExpectedPart { id: format!("slug-{n}"), kind: 0, expected_m: None }).collect(),
        time_limit_s: 60.0,
        endless: false,
        follows_paths: true,
        tolerance_m: ARRIVE_M,
        lost_after_frames: 2,
        method: PlanningMethod::default(),
        planner: PlannerParams {
            half_side_m: HALF_M,
            edge_margin_m: 0.001,
            separation_m: 0.002,
            min_distance_m: 0.3e-3,
            frame_s: 1.0 / FRAME_HZ,
            exposure_s: 0.002,
            max_sustain_s: 0.3,
        },
        guards: Default::default(),
    }
}

fn dry_run_params(starts_m: &[Vec2], number: u64) -> DryRunParams {
    DryRunParams {
        starts_m: starts_m.to_vec(),
        frame_hz: FRAME_HZ,
        friction_spread: 0.05,
        streams: Streams::new(7),
        number,
        most_work_ms: f64::INFINITY,
    }
}

/// Trajectories of each part straight to its target.
fn to(targets_m: &[Vec2]) -> Trajectories {
    let path = |&target_m: &Vec2| PathParams { waypoints_m: vec![target_m], speed_mps: 0.1, repeat: 1 };
    let (half_side_m, paths) = (0.1016, targets_m.iter().map(path).collect());
    let (lead_m, stride_m, arrive_m, corridor_m) = (0.008, 0.008, ARRIVE_M, 0.001);
    let params =
        TrajectoriesParams { half_side_m, paths, lead_m, stride_m, arrive_m, corridor_m, ..Default::default() };
    Trajectories::new(params)
}

fn play(library: &Arc<Library>, task: &mut dyn Task, params: &ControlParams, how: &DryRunParams) -> DryRun {
    dry_run(library, &FreshPlanner::new(params.method, library, params.planner), task, params, how, &mut |_, _| ())
}

/// A task that wants parts to stay where they are; done after a time, or never.
struct Stay {
    until_s: Option<f64>,
}

impl Task for Stay {
    fn next(&mut self, now: PlateTime, parts_in_table_m: &[Vec2]) -> Setpoints {
        let progress = self.until_s.map_or(0.0, |until_s| (now.secs() / until_s).min(1.0));
        let places_m = parts_in_table_m.to_vec();
        Setpoints {
            subgoals_m: places_m.clone(),
            targets_m: places_m,
            progress,
            done: progress >= 1.0,
            ..Setpoints::default()
        }
    }
}

/// A task that wants the first part in one place at once.
struct There(Vec2);

impl Task for There {
    fn next(&mut self, _: PlateTime, parts_in_table_m: &[Vec2]) -> Setpoints {
        let mut places_m = parts_in_table_m.to_vec();
        places_m[0] = self.0;
        let done = (parts_in_table_m[0] - self.0).norm() < ARRIVE_M;
        Setpoints {
            subgoals_m: places_m.clone(),
            targets_m: places_m,
            done,
            phase: "there".into(),
            ..Setpoints::default()
        }
    }
}

#[test]
fn one_pulse_takes_its_time_in_whole_frames() {
    let (start_m, there_m) = (Vec2::new(-0.01, 0.02), Vec2::new(-0.002, 0.02));
    let made = library(translations(), 0.0);
    let done = play(&made, &mut There(there_m), &params(1), &dry_run_params(&[start_m], 0));
    assert_eq!((done.ending.outcome, done.cycles, done.pulses), (Outcome::Completed, 1, 1), "{done:?}");
    let frames = done.plate_time_s * FRAME_HZ;
    assert!((frames - frames.round()).abs() < 1e-6, "{done:?}");
    let pulse_s = done.plate_time_s - 2.0 / FRAME_HZ - 2.0 * ATTACK_S;
    assert!(pulse_s > 0.0 && pulse_s < 1.0 / FRAME_HZ + LONGEST_S, "{done:?}");
    let [from_m, to_m] = done.trails_m[0][..] else { panic!("{done:?}") };
    let most_m = 2.0 * disturbance::ENTRY_OFF * (there_m - start_m).norm();
    assert!(from_m == start_m && (to_m - there_m).norm() < most_m, "{done:?}");
    assert_eq!(done.nearest, None);
}

#[test]
fn equal_seeds_give_equal_dry_runs_and_numbers_differ() {
    let made = library(translations().chain(rotations()), 0.03);
    let starts_m = [Vec2::new(-0.06, 0.01), Vec2::new(0.05, -0.03)];
    let ends_m = [Vec2::new(-0.01, 0.04), Vec2::new(0.07, 0.05)];
    let once = |number| play(&made, &mut to(&ends_m), &params(2), &dry_run_params(&starts_m, number));
    for number in 0..3 {
        let done = once(number);
        assert_eq!(done.ending.outcome, Outcome::Completed, "{done:?}");
        for (trail_m, end_m) in done.trails_m.iter().zip(&ends_m) {
            assert!((trail_m[trail_m.len() - 1] - end_m).norm() < ARRIVE_M, "{done:?}");
        }
        assert_eq!(done.trails_m[0].len() as u64, done.pulses + 1);
        assert_eq!(done, once(number));
        assert_ne!(done, once(number + 1));
    }
}

#[test]
fn direction_that_the_library_lacks_is_refused_at_the_first_observation() {
    let along_x = library([Twist::new(0.5, 0.0, 0.0), Twist::new(-0.3, 0.0, 0.0)], 0.03);
    let done = play(&along_x, &mut There(Vec2::new(0.0, 0.05)), &params(1), &dry_run_params(&[Vec2::zeros()], 0));
    assert_eq!((done.ending.outcome, done.ending.cause), (Outcome::Failed, Some(StopCause::Uncontrollable)));
    assert!(done.ending.reason.contains("slug-1 towards 90 deg with"), "{done:?}");
    assert_eq!((done.cycles, done.pulses), (0, 0));
    let done = play(&along_x, &mut Stay { until_s: Some(1.0) }, &params(1), &dry_run_params(&[Vec2::zeros()], 0));
    assert_eq!(done.ending.outcome, Outcome::Completed, "nothing is to be moved: {done:?}");
    let two_m = [Vec2::new(-0.05, 0.0), Vec2::new(0.05, 0.0)];
    let done = play(&library(translations(), 0.0), &mut There(Vec2::zeros()), &params(2), &dry_run_params(&two_m, 0));
    assert_eq!(done.ending.cause, Some(StopCause::Uncontrollable), "translations carry both alike: {done:?}");
}

#[test]
fn it_ends_at_the_time_limit_and_when_nothing_goes_on() {
    let made = library(translations(), 0.0);
    let (start_m, far_m) = ([Vec2::new(-0.08, 0.0)], Vec2::new(0.08, 0.0));
    let short = ControlParams { time_limit_s: 0.5, ..params(1) };
    let done = play(&made, &mut There(far_m), &short, &dry_run_params(&start_m, 0));
    assert_eq!(done.ending, RunEnd::failed("plate time limit of 0.5 s reached"));
    assert!((0.5..0.5 + 2.0 * LONGEST_S).contains(&done.plate_time_s), "{done:?}");
    let endless = ControlParams { endless: true, ..short };
    let done = play(&made, &mut There(far_m), &endless, &dry_run_params(&start_m, 0));
    assert_eq!(done.ending.outcome, Outcome::Completed);

    let done = play(&made, &mut Stay { until_s: None }, &params(1), &dry_run_params(&start_m, 0));
    assert!(done.ending.outcome == Outcome::Failed && done.ending.reason.starts_with("stalled"), "{done:?}");
    assert!((done.plate_time_s - STALLED_S).abs() < 0.2, "{done:?}");
    let done = play(&made, &mut Stay { until_s: Some(25.0) }, &params(1), &dry_run_params(&start_m, 0));
    assert_eq!((done.ending.outcome, done.pulses), (Outcome::Completed, 0), "time alone is progress, too: {done:?}");
}

#[test]
fn dry_run_that_takes_too_much_work_is_left_off_and_has_not_failed() {
    let made = library(translations(), 0.0);
    let forever = ControlParams { time_limit_s: 1e6, ..params(1) };
    let how = DryRunParams { most_work_ms: 5.0, ..dry_run_params(&[Vec2::new(-0.08, 0.0)], 0) };
    let done = play(&made, &mut Stay { until_s: Some(1e6) }, &forever, &how);
    assert!(done.left_off && done.ending.reason.starts_with("left off after"), "{done:?}");
    assert!(done.work_ms > 5.0 && done.work_ms < 5.1 && done.progress < 0.01, "{done:?}");
    let endless = ControlParams { endless: true, ..forever };
    let done = play(&made, &mut Stay { until_s: Some(1e6) }, &endless, &how);
    let far = (done.left_off, done.ending.outcome, done.plate_time_s.round());
    assert_eq!(far, (true, Outcome::Completed, 1e6), "it has no end to reach");
    let how = DryRunParams { most_work_ms: f64::INFINITY, ..how };
    let done = play(&made, &mut There(Vec2::zeros()), &params(1), &how);
    assert!(!done.left_off && done.work_ms > 0.0, "{done:?}");
}

#[test]
fn a_part_whose_center_is_beyond_the_edge_after_a_pulse_falls_off() {
    let made = library(translations(), 0.0);
    let once = |start_x_m: f64| {
        let start_m = [Vec2::new(start_x_m, 0.0)];
        play(&made, &mut There(Vec2::zeros()), &params(1), &dry_run_params(&start_m, 0)).ending
    };
    let beyond = once(HALF_M + 0.05);
    assert_eq!(beyond.outcome, Outcome::Failed);
    assert!(beyond.reason.contains("slug-1 would fall off the plate"), "{beyond:?}");
    assert_eq!(once(HALF_M - RADIUS_M).outcome, Outcome::Completed);
}

#[test]
fn smallest_gap_is_reported_with_its_parts() {
    let made = library(translations().chain(rotations()), 0.0);
    let starts_m = [Vec2::new(-0.05, 0.05), Vec2::new(-0.02, 0.0), Vec2::new(0.005, 0.0)];
    let done = play(&made, &mut There(Vec2::new(-0.03, 0.05)), &params(3), &dry_run_params(&starts_m, 0));
    let nearest = done.nearest.unwrap();
    assert!((0.003..0.0052).contains(&nearest.gap_m), "{nearest:?}");
    assert_eq!(nearest.parts, [1, 2]);
    assert!((OPENING_FRAMES as f64 / FRAME_HZ..=done.plate_time_s).contains(&nearest.at_s), "{nearest:?}");
}

#[test]
fn parts_that_meet_push_each_other_aside() {
    let made = library([Twist::about(Vec2::zeros(), 20.0)], 0.0);
    // the drawn friction varies so much that one part moves much farther than the other and runs into it
    let starts_m = [Vec2::new(0.05, 0.0), Vec2::new(0.05, 0.021)];
    let mut met = 0;
    for number in 1..20 {
        let how = DryRunParams { friction_spread: 0.4, ..dry_run_params(&starts_m, number) };
        let mut stage = KinematicPlate::new(Arc::clone(&made), &params(2), &how);
        let plans = FreshPlanner::new(PlanningMethod::CorSequence, &made, params(2).planner).plans().ok().unwrap();
        let pulse = PlannedPulse::Rotation(Rotation {
            entry: 0,
            distance_m: 0.01,
            amplitude: 1.0,
            sustain_s: 0.1,
            rest_s: 0.04,
        });
        stage.play(&pulse, plans.as_ref());
        let gap_m = (stage.positions_m[0] - stage.positions_m[1]).norm() - 2.0 * RADIUS_M;
        let least_m = stage.nearest.unwrap().gap_m;
        met += usize::from(least_m < 0.0);
        assert!(gap_m > -1e-12 && least_m <= gap_m + 1e-12, "{gap_m} {least_m}");
    }
    assert!(met > 3, "{met}");
}

/// A planner that forecasts the same displacement by every field at gain 1.
struct Along(Vec2);

impl PulsePlanner for Along {
    fn plan(&mut self, _: &[PartState], _: &[Option<Corridor>]) -> Plan {
        Plan::default()
    }

    fn forecast(&self, parts: &[PartState], pulse: &PlannedPulse) -> Option<Vec<Vec2>> {
        let carried = || parts.iter().map(|part| part.position_m + self.0 * part.gain).collect();
        matches!(pulse, PlannedPulse::Field(_)).then(carried)
    }
}

#[test]
fn a_field_carries_parts_as_forecast_with_their_own_friction() {
    let mut made = (*library([], 0.03)).clone();
    let fields =
        FieldResponse { base_radps: 200.0, attack_s: 0.06, rest_s: 0.07, limit_counts: 1.0, twist_from_counts: vec![] };
    made.fields = Some(fields);
    let (starts_m, way_m) = ([Vec2::new(-0.05, 0.0), Vec2::new(0.05, 0.0)], Vec2::new(0.0, 0.01));
    let pulse =
        PlannedPulse::Field(FieldPulse { wave: Default::default(), follows: Default::default(), sustain_s: 0.1 });
    let made = Arc::new(made);
    let mut scattered = Vec::new();
    for number in 0..400 {
        let how = dry_run_params(&starts_m, number);
        let mut stage = KinematicPlate::new(Arc::clone(&made), &params(2), &how);
        let before = stage.now();
        stage.play(&pulse, &Along(way_m));
        assert!((stage.now() - before - 0.3).abs() < 1e-9, "15 frames, for 0.29 s");
        for ((start_m, end_m), friction) in starts_m.iter().zip(&stage.positions_m).zip(friction(&how)) {
            let off_m = end_m - start_m - way_m * friction;
            scattered.push(off_m / disturbance::FIELD_SD_M);
        }
    }
    let n = scattered.len() as f64;
    let (mean, square) =
        (scattered.iter().sum::<Vec2>() / n, scattered.iter().map(Vec2::norm_squared).sum::<f64>() / n);
    assert!(mean.norm() < 4.0 / n.sqrt(), "{mean}");
    assert!((square - 1.0).abs() < 4.0 / n.sqrt(), "{square}: four standard deviations, that of one square is 1");
}

/// A planner that forecasts displacements by the first harmonic of the wave that is played, 1 s long.
struct ByWave;

impl PulsePlanner for ByWave {
    fn plan(&mut self, _: &[PartState], _: &[Option<Corridor>]) -> Plan {
        Plan::default()
    }

    fn forecast(&self, parts: &[PartState], pulse: &PlannedPulse) -> Option<Vec<Vec2>> {
        let PlannedPulse::Field(field) = pulse else { return None };
        Some(parts.iter().map(|part| part.position_m + field.wave.harmonics[0].cos.velocity_mps).collect())
    }
}

#[test]
fn plate_is_off_its_command_by_the_same_share_in_every_pulse() {
    let mut made = (*library([], 0.0)).clone();
    let response = vec![nalgebra::Matrix3::from_diagonal_element(nalgebra::Complex::new(1e-3, 0.0))];
    let (base_radps, limit_counts) = (200.0, 1.0);
    made.fields =
        Some(FieldResponse { base_radps, attack_s: 0.06, rest_s: 0.07, limit_counts, twist_from_counts: response });
    let made = Arc::new(made);
    let pulse = |x: f64| {
        let harmonic = TwistHarmonic { cos: Twist::new(x, 0.0, 0.0), sin: Twist::ZERO };
        let wave = TwistWave { base_radps, harmonics: vec![harmonic] };
        PlannedPulse::Field(FieldPulse { wave, follows: Default::default(), sustain_s: 0.1 })
    };
    let mut squares = 0.0;
    for number in 0..200 {
        let mut stage = KinematicPlate::new(Arc::clone(&made), &params(1), &dry_run_params(&[Vec2::zeros()], number));
        let mut share = |x: f64| {
            let before = stage.positions_m[0].x;
            stage.play(&pulse(x), &ByWave);
            (stage.positions_m[0].x - before) / x - 1.0
        };
        // metres, compared with which the scatter of single pulses is negligible
        let (long, short) = (share(1.0), share(-0.5));
        assert!((long - short).abs() < 1e-3, "{long} {short}");
        squares += long * long;
    }
    let rms = (squares / 200.0_f64).sqrt();
    let expected = disturbance::PLATE_OFF / 2f64.sqrt();
    assert!((rms / expected - 1.0).abs() < 0.2, "{rms}: four standard deviations of 200 draws, half of it is in phase");
}

#[test]
fn rotation_is_off_its_forecast_by_the_same_share_in_every_pulse_of_an_entry() {
    let made = library([Twist::new(0.5, 0.0, 0.0), Twist::new(0.0, 0.5, 0.0)], 0.0);
    let plans = FreshPlanner::new(PlanningMethod::CorSequence, &made, params(1).planner).plans().ok().unwrap();
    let mut squares = 0.0;
    for number in 0..200 {
        let mut stage = KinematicPlate::new(Arc::clone(&made), &params(1), &dry_run_params(&[Vec2::zeros()], number));
        let friction = friction(&dry_run_params(&[Vec2::zeros()], number))[0];
        let mut off_m = |entry: usize, reverse: bool| {
            let before_m = stage.positions_m[0];
            let distance_m = if reverse { -0.02 } else { 0.02 };
            let pulse =
                PlannedPulse::Rotation(Rotation { entry, distance_m, amplitude: 1.0, sustain_s: 0.2, rest_s: 0.04 });
            let mut state = stage.states(|_| friction);
            state[0].position_m = before_m;
            let forecast_m = plans.forecast(&state, &pulse).unwrap()[0];
            stage.play(&pulse, plans.as_ref());
            (stage.positions_m[0] - forecast_m) * if reverse { -1.0 } else { 1.0 }
        };
        let (once, again, other) = (off_m(0, false), off_m(0, true), off_m(1, false));
        assert!((once - again).norm() < 0.2e-3, "{once} {again}: but for the scatter of single pulses");
        squares += (once.norm_squared() + other.norm_squared()) / (0.02 * friction).powi(2);
    }
    let rms = (squares / 400.0_f64).sqrt();
    assert!((rms / disturbance::ENTRY_OFF - 1.0).abs() < 0.15, "{rms}");
}

proptest! {
    #[test]
    fn opposite_frictions_come_in_pairs(seed in 0u64..1000, pair in 1u64..50, spread in 0.0..0.3f64) {
        let of = |number: u64| {
            let own = dry_run_params(&[Vec2::zeros(); 4], number);
            let how = DryRunParams { streams: Streams::new(seed), friction_spread: spread, ..own };
            friction(&how)
        };
        prop_assert_eq!(of(0), vec![1.0; 4]);
        for (a, b) in of(2 * pair - 1).into_iter().zip(of(2 * pair)) {
            prop_assert!((a + b - 2.0).abs() < 1e-12 && a > 0.0 && b > 0.0);
        }
    }
}
