//! A custom task, which job files do not have: the coins form a circle, each at the place of its angle. It runs closed
//! loop, with the camera, the planner and the guards of every other job.
//!
//! ```text
//! cargo run --example own_task
//! ```
#![allow(clippy::disallowed_methods, clippy::print_stdout)] // an example talks to its reader, on its own machine

use std::f64::consts::TAU;
use std::path::Path;

use upm::config::JobSpec;
use upm::geometry::Vec2;
use upm::run::{InMemoryRun, RunError};
use upm::task::{Setpoints, Task};
use upm::time::PlateTime;

/// The task: every part on a circle about the plate's centre.
struct Circle {
    radius_m: f64,
    /// Distance from its place within which a part has arrived, m.
    arrive_m: f64,
    places_m: Vec<Vec2>,
}

impl Task for Circle {
    fn first_seen(&mut self, parts_in_table_m: &[Vec2]) {
        let angle = |&part: &usize| parts_in_table_m[part].y.atan2(parts_in_table_m[part].x);
        let mut round: Vec<usize> = (0..parts_in_table_m.len()).collect();
        round.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
        self.places_m = vec![Vec2::zeros(); round.len()];
        for (i, part) in round.iter().enumerate() {
            let (y, x) = (TAU * i as f64 / round.len() as f64 - TAU / 2.0).sin_cos();
            self.places_m[*part] = self.radius_m * Vec2::new(x, y);
        }
    }

    fn next(&mut self, _: PlateTime, parts_in_table_m: &[Vec2]) -> Setpoints {
        let left_m = parts_in_table_m.iter().zip(&self.places_m).map(|(part, place)| (part - place).norm());
        let arrived = left_m.filter(|&left_m| left_m <= self.arrive_m).count();
        let parts = self.places_m.len();
        Setpoints {
            subgoals_m: self.places_m.clone(),
            targets_m: self.places_m.clone(),
            phase: format!("{arrived} of {parts} parts on the circle"),
            progress: arrived as f64 / parts as f64,
            done: arrived == parts,
            ..Setpoints::default()
        }
    }
}

fn main() -> Result<(), RunError> {
    // rig, coins and limits come from a job file, and only the task is replaced
    let job = JobSpec::load(Path::new("configs/arrange-4.json"))?;
    let circle = Circle { radius_m: 0.06, arrive_m: 0.9 * job.tolerance_m, places_m: Vec::new() };
    let report = InMemoryRun::new(&job)?.with_task(circle).run();

    println!("{}: {}", report.outcome.code(), report.reason);
    println!("{:.1} s of plate time, {} pulses", report.plate_time_s, report.work.pulses);
    for part in &report.parts {
        let [x_mm, y_mm] = part.true_mm.unwrap_or_default();
        println!("{:>8} at {x_mm:7.2}, {y_mm:7.2} mm, {:.1} mm from the centre", part.id, x_mm.hypot(y_mm));
    }
    Ok(())
}
