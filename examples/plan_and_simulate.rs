//! Plans one motion that moves three coins towards each other, plays it on the simulated rig, and compares the forecast
//! with the truth.
//!
//! ```text
//! cargo run --example plan_and_simulate
//! ```
#![allow(clippy::print_stdout)] // an example talks to its reader

use std::error::Error;
use std::path::Path;

use upm::config::RigSpec;
use upm::geometry::{Pose, Vec2};
use upm::planner::{FieldPlanner, PartState};
use upm::random::Streams;
use upm::rig::Rig;
use upm::run::{RunError, planner_params, rig_library};
use upm::signal::Frame;
use upm::sim::SimRig;
use upm::units::mm_from_m;

/// Position of each coin and its wanted step, mm.
const WANTED_MM: [([f64; 2], [f64; 2]); 3] =
    [([-100.0, -60.0], [1.5, 1.0]), ([0.0, 90.0], [0.0, -2.0]), ([100.0, -60.0], [-1.5, 1.0])];

fn main() -> Result<(), Box<dyn Error>> {
    // the rig as described by its file, and the library measured on it by calibration
    let spec = RigSpec::load(Path::new("configs/rigs/upm-2.json")).map_err(RunError::from)?;
    let library = rig_library(&spec).map_err(RunError::from)?;
    let penny = &spec.kinds[spec.kind("penny").ok_or("the rig has no kind `penny`")?];

    // one plan for all coins
    let metres = |mm: [f64; 2]| Vec2::from(mm) * 1e-3;
    let coins = WANTED_MM.map(|(at_mm, step_mm)| PartState {
        position_m: metres(at_mm),
        step_m: metres(step_mm),
        radius_m: penny.kind.radius_m,
        gain: 1.0,
    });
    let mut planner = FieldPlanner::new(&library, planner_params(&spec.model)).ok_or("the library has no fields")?;
    let plan = planner.plan(&coins, &[]);
    println!("{:?}: {} motions for {} coins", plan.status, plan.pulses.len(), coins.len());

    // play the plan on the simulated rig until the coins are at rest
    let parts = coins.iter().map(|coin| (penny.part(), Pose::at(coin.position_m))).collect();
    let mut rig = SimRig::new(spec.model, spec.sim, parts, Streams::new(1));
    let mut frame = Frame::new(0, 0);
    for pulse in &plan.pulses {
        rig.play(&pulse.drive(&library).ok_or("the library cannot drive this pulse")?)?;
        while rig.now() <= rig.settled_at() {
            rig.capture(&mut frame)?;
        }
    }

    println!("{:>6} {:>17} {:>17} {:>17} {:>8}", "coin", "wanted mm", "forecast mm", "truth mm", "off mm");
    let forecast_m = plan.predicted_m.last().ok_or("nothing was planned")?;
    for (i, ((coin, forecast_m), part)) in coins.iter().zip(forecast_m).zip(&rig.probe().read().parts).enumerate() {
        let truth_m = part.part_in_table.position_m;
        let moved = |to_m: Vec2| {
            let moved_m = to_m - coin.position_m;
            format!("{:8.2} {:8.2}", mm_from_m(moved_m.x), mm_from_m(moved_m.y))
        };
        let (wanted, forecast, truth) = (moved(coin.position_m + coin.step_m), moved(*forecast_m), moved(truth_m));
        println!("{i:>6} {wanted} {forecast} {truth} {:8.2}", mm_from_m((truth_m - forecast_m).norm()));
    }
    Ok(())
}
