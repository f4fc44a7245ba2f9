//! Emergency stops while eight coins move on a plate that never rests.
//!
//! A run is played once on a rig that logs what control asks of it. The same drives, taken over at the same times, move
//! a bare plant; at random steps a copy of it is stopped, as the interlock stops the rig's own plant, and followed
//! until everything rests.

use rand_distr::{Distribution, Uniform};
use serde_json::json;

use super::in_memory::InMemoryRun;
use super::testing::{as_its_rig, job_in_configs};
use crate::config::{JobSpec, place_parts};
use upm_core::geometry::{Pose, Vec2};
use upm_core::job::CameraMode;
use upm_core::random::Streams;
use upm_core::rig::{Rig, RigError};
use upm_core::signal::{AccelTrace, Drive, Frame};
use upm_core::time::PlateTime;
use upm_sim::{Plant, SimRig};

const COINS: usize = 8;
/// Least distance of targets, and of a target from the middle of an edge, mm.
const APART_MM: f64 = 25.4;
const INSIDE_MM: f64 = 20.0;
/// Plate time for which a stopped plant is followed, s, and steps from one look at it to the next.
const FOLLOWED_S: f64 = 0.8;
const LOOK_EVERY: u64 = 10;
/// Slip of a coin's centre or rim below which it rests on the plate, m/s.
const REST_MPS: f64 = 1e-3;
/// Largest distance of a coin of the replay from the run's at its last picture, which is between two steps, m.
const SAME_M: f64 = 1e-6;
/// Bar of the time from a stop until every coin rests on the plate, s.
const REST_BAR_S: f64 = 0.4;

/// A rig that logs what is played on it.
struct LoggedRig {
    rig: SimRig,
    log: Vec<Played>,
}

/// A drive, when control asked for it, and whether it was to take over from the one before.
struct Played {
    at: PlateTime,
    drive: Drive,
    takes_over: bool,
}

impl Rig for LoggedRig {
    as_its_rig! { now takes_over settled_at capture trace stop }

    fn play(&mut self, drive: &Drive) -> Result<(), RigError> {
        self.log.push(Played { at: self.now(), drive: drive.clone(), takes_over: false });
        self.rig.play(drive)
    }

    fn take_over(&mut self, drive: &Drive) -> Result<PlateTime, RigError> {
        self.log.push(Played { at: self.now(), drive: drive.clone(), takes_over: true });
        self.rig.take_over(drive)
    }
}

/// Eight pennies from random places to random places.
fn job(seed: u64) -> JobSpec {
    let (mut rng, half_mm) = (Streams::new(seed).stream("targets"), 0.5 * 304.8 - INSIDE_MM);
    let side = Uniform::new(-half_mm, half_mm).unwrap();
    let mut targets_mm: Vec<Vec2> = Vec::new();
    while targets_mm.len() < COINS {
        let place_mm = Vec2::new(side.sample(&mut rng), side.sample(&mut rng));
        if targets_mm.iter().all(|other_mm| (place_mm - other_mm).norm() >= APART_MM) {
            targets_mm.push(place_mm);
        }
    }
    let targets_mm: Vec<[f64; 2]> = targets_mm.iter().map(|place_mm| [place_mm.x, place_mm.y]).collect();
    let job = json!({
        "name": "stopped", "seed": seed, "rig": "rigs/upm-2.json", "planner": "moving_field",
        "parts": [{"kind": "penny", "count": COINS}], "task": {"type": "arrange", "targets_mm": targets_mm},
    });
    job_in_configs(&job).with_camera(CameraMode::Positions)
}

/// A stop and its consequences.
#[derive(Clone, Copy, Debug, Default)]
struct Stop {
    seed: u64,
    /// Time of the stop since the first motion, s.
    at_s: f64,
    /// Largest component of the coils' wrench one step after the stop, N or N m.
    wrench: f64,
    /// Time after which every coin rests on the plate, s.
    rests_s: f64,
    /// Largest speed of a coin on the table from the bar of that time on, m/s: the plate swings on its rods.
    swings_mps: f64,
    /// Largest way of a coin, m.
    way_m: f64,
    /// Smallest distance of a coin's centre from the plate's edge, m; negative for one that fell.
    edge_m: f64,
    /// Smallest gap between two rims, m, and touches.
    gap_m: f64,
    touches: u64,
}

/// Least distance of two of these places.
fn least_distance(places_m: &[Vec2]) -> f64 {
    let nearest = |(i, a_m): (usize, &Vec2)| {
        places_m[..i].iter().map(|b_m| (a_m - b_m).norm_squared()).fold(f64::INFINITY, f64::min)
    };
    places_m.iter().enumerate().map(nearest).fold(f64::INFINITY, f64::min).sqrt()
}

/// Stops `plant` and follows it.
fn stopped(mut plant: Plant, job: &JobSpec) -> Stop {
    let (step_s, half_side_m) = (job.rig.sim.step_s, 0.5 * job.rig.sim.plate.side_m);
    let radius_m = place_parts(job, Streams::new(job.seed())).unwrap()[0].params.radius_m;
    let places = |plant: &Plant| plant.parts().motions().map(|part| part.part_in_table.position_m).collect::<Vec<_>>();
    let (before_m, touches) = (places(&plant), plant.parts().collisions());
    plant.stop();
    let mut stop = Stop { edge_m: f64::INFINITY, gap_m: f64::INFINITY, ..Stop::default() };
    for step in 1..=(FOLLOWED_S / step_s) as u64 {
        plant.step();
        if step == 1 {
            stop.wrench = plant.wrench().amax();
        }
        if !step.is_multiple_of(LOOK_EVERY) {
            continue;
        }
        let t_s = step as f64 * step_s;
        let plate = *plant.plate();
        stop.gap_m = stop.gap_m.min(least_distance(&places(&plant)) - 2.0 * radius_m);
        for part in plant.parts().motions() {
            let arm_m = part.part_in_table.position_m - plate.plate_in_table.position_m;
            let slide_mps = (part.velocity_mps - plate.twist.velocity_at(arm_m)).norm();
            let rim_mps = radius_m * (part.spin_radps - plate.twist.spin_radps).abs();
            if part.on_plate && slide_mps.max(rim_mps) > REST_MPS {
                stop.rests_s = t_s;
            }
            if t_s >= REST_BAR_S {
                stop.swings_mps = stop.swings_mps.max(part.velocity_mps.norm());
            }
            let tilt = plate.plate_in_table.heading_rad;
            let along_plate_m = Vec2::new(arm_m.x + tilt * arm_m.y, arm_m.y - tilt * arm_m.x);
            stop.edge_m = stop.edge_m.min(half_side_m - along_plate_m.amax());
        }
    }
    let ways_m = places(&plant).into_iter().zip(before_m).map(|(after_m, before_m)| (after_m - before_m).norm());
    stop.way_m = ways_m.fold(0.0, f64::max);
    Stop { touches: plant.parts().collisions() - touches, ..stop }
}

/// Stops the run of `seed` at `count` random steps.
fn stops(seed: u64, count: usize) -> Vec<Stop> {
    let job = job(seed);
    let log_of = |rig| LoggedRig { rig, log: Vec::new() };
    let (report, LoggedRig { rig, log }) = InMemoryRun::new(&job).unwrap().run_on(log_of).unwrap();
    assert!(log.iter().any(|played| played.takes_over), "seed {seed}: {}", report.reason);

    let streams = Streams::new(seed);
    let placed = place_parts(&job, streams).unwrap();
    let parts: Vec<_> = placed.iter().map(|part| (part.params, Pose::at(part.position_m))).collect();
    let step_ns = PlateTime::from_secs(job.rig.sim.step_s).nanos();
    let step_of = |at: PlateTime| (at.nanos() - log[0].at.nanos()).div_ceil(step_ns);
    let last = log.last().unwrap();
    let steps = step_of(last.at) + step_of(log[0].at + last.drive.envelope.driven_s());
    let mut rng = streams.stream("stops");
    let mut due: Vec<u64> = Uniform::new(1, steps).unwrap().sample_iter(&mut rng).take(count).collect();
    due.sort_unstable();

    let truth = rig.probe().read();
    let seen_last = step_of(truth.at);
    let mut plant = Plant::new(&job.rig.sim, &parts, &streams);
    let (mut asked, mut due, mut found) = (log.iter().peekable(), due.into_iter().peekable(), Vec::new());
    for step in 0..=steps.max(seen_last) {
        while let Some(played) = asked.next_if(|played| step_of(played.at) <= step) {
            if played.takes_over {
                assert!(plant.take_over(played.drive.clone()).is_some(), "seed {seed}: too late at {:?}", played.at);
            } else {
                plant.play(played.drive.clone());
            }
        }
        while due.next_if_eq(&step).is_some() {
            let at_s = step as f64 * job.rig.sim.step_s;
            found.push(Stop { seed, at_s, ..stopped(plant.clone(), &job) });
        }
        if step == seen_last {
            for end in plant.parts().motions().map(|part| part.part_in_table.position_m) {
                let offs_m = truth.parts.iter().map(|part| (part.part_in_table.position_m - end).norm());
                let off_m = offs_m.fold(f64::INFINITY, f64::min);
                assert!(off_m < SAME_M, "seed {seed}: the replay is {off_m} m from the run");
            }
        }
        plant.step();
    }
    found
}

/// Prints the figures of stops, with the run and the time of the worst, and holds their bars.
fn judge(stops: &[Stop]) {
    let worst = |what: &str, key: fn(&Stop) -> f64, most: bool| {
        let order = |a: &&Stop, b: &&Stop| key(a).total_cmp(&key(b));
        let stop = if most { stops.iter().max_by(order) } else { stops.iter().min_by(order) }.unwrap();
        eprintln!("  {what:40} {:8.4}   seed {}, {:.4} s", key(stop), stop.seed, stop.at_s);
        key(stop)
    };
    eprintln!("{} stops in motion", stops.len());
    let wrench = worst("largest force after one step, N", |stop| stop.wrench, true);
    let rests_s = worst("latest at rest on the plate, s", |stop| stop.rests_s, true);
    worst("swing with the plate from 0.4 s on, mm/s", |stop| 1e3 * stop.swings_mps, true);
    worst("longest way after a stop, mm", |stop| 1e3 * stop.way_m, true);
    let edge_mm = worst("centre from the edge, least, mm", |stop| 1e3 * stop.edge_m, false);
    worst("gap of two rims, least, mm", |stop| 1e3 * stop.gap_m, false);
    let count = |holds: fn(&Stop) -> bool| stops.iter().filter(|stop| holds(stop)).count();
    eprintln!("  over the edge {}, with a touch {}", count(|stop| stop.edge_m < 0.0), count(|stop| stop.touches > 0));
    assert_eq!(wrench, 0.0, "force after a step");
    assert!(rests_s <= REST_BAR_S, "{rests_s} s until every coin rests");
    assert!(edge_mm > 0.0, "a coin over the edge");
}

#[test]
fn coins_rest_on_the_plate_soon_after_a_stop_in_motion() {
    judge(&(1..=2).flat_map(|seed| stops(seed, 10)).collect::<Vec<_>>());
}

#[test]
#[ignore = "long: `cargo test -p upm-runner ten_thousand -- --ignored --nocapture` runs it"]
fn campaign_of_ten_thousand_stops_in_motion() {
    judge(&(1..=1000).flat_map(|seed| stops(seed, 10)).collect::<Vec<_>>());
}
