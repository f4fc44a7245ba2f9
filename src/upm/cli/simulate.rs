use std::path::Path;

use serde_json::json;

use super::args::Common;
use super::output::{Failure, print};
use upm_core::units::mm_from_m;
use upm_runner::config::SimulateSpec;
use upm_runner::run::{OpenLoopTrajectories, simulate as simulate_open_loop};

pub(super) fn simulate(experiment: &Path, common: Common) -> Result<u8, Failure> {
    let spec = SimulateSpec::load(experiment).map_err(Failure::of_files)?;
    let fault = |error| Failure::bad_input(format!("{}: {error}", experiment.display()));
    let result = simulate_open_loop(&spec).map_err(fault)?;
    print(common.json, &as_json(&result), || print_table(&spec, &result))
}

fn as_json(result: &OpenLoopTrajectories) -> serde_json::Value {
    let mm = |values: &[f64]| values.iter().copied().map(mm_from_m).collect::<Vec<_>>();
    let parts = result
        .parts
        .iter()
        .map(|part| json!({ "x_mm": mm(&part.x_m), "y_mm": mm(&part.y_m), "theta_rad": part.theta_rad }));
    json!({ "t_s": result.t_s, "parts": parts.collect::<Vec<_>>() })
}

fn print_table(spec: &SimulateSpec, result: &OpenLoopTrajectories) -> Result<(), Failure> {
    outln!("{:.3} s of plate time, {} pulses", result.t_s.last().unwrap_or(&0.0), spec.pulses.len())?;
    outln!("  {:12} {:>19} {:>19} {:>9} {:>9}", "part", "from mm", "to mm", "moved mm", "turned °")?;
    for (placed, part) in spec.parts.iter().zip(&result.parts) {
        let ends = |values: &[f64]| [values.first(), values.last()].map(|v| v.copied().unwrap_or_default());
        let (x, y, theta) = (ends(&part.x_m).map(mm_from_m), ends(&part.y_m).map(mm_from_m), ends(&part.theta_rad));
        let [from, to] = [0, 1].map(|end| format!("{:9.3},{:9.3}", x[end], y[end]));
        let (moved, turned_deg) = (libm::hypot(x[1] - x[0], y[1] - y[0]), (theta[1] - theta[0]).to_degrees());
        outln!("  {:12} {from} {to} {moved:9.3} {turned_deg:9.2}", placed.id)?;
    }
    Ok(())
}
