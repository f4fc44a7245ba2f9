//! The general two-harmonic wave of the UPM paper's appendix: plate acceleration `cos t + 2b cos(2t + φ)` (Eq. 27)
//! leaves a part in equilibrium at the speed `b sin φ`, |b| < ½ (Eq. 28), in units of the first harmonic's speed.

use std::f64::consts::TAU;

use super::numerics::bisect;
use super::pumped::{FAINT, PumpedLine};
use super::texts::{chart, figure};
use super::{ExperimentResult, LabRig};
use upm_chart::Color;
use upm_sim::PartParams;

/// Shares b of the second harmonic.
const SHARES: [f64; 3] = [0.15, 0.3, 0.49];
/// Phases φ for each, from 0 to a whole turn.
const PHASES: u32 = 12;
/// Steps of a cycle: the resolution of the force.
const STEPS: u32 = 20_000;
/// Halvings of the interval of speeds.
const HALVINGS: usize = 16;
/// Points of the curve of Eq. 28.
const CURVE: u32 = 180;

/// Adds equilibrium speeds, found as zeros of the mean force, compared with Eq. 28.
pub(super) fn report(rig: &LabRig, outcome: &mut ExperimentResult) {
    let part = PartParams { friction: FAINT, ..rig.penny };
    let phase_rad = |i: u32, count: u32| TAU * f64::from(i) / f64::from(count);
    let mut chart = chart("general-wave");
    let mut worst = 0.0f64;
    for (n, share) in SHARES.into_iter().enumerate() {
        let found: Vec<[f64; 2]> = (0..=PHASES)
            .map(|i| {
                let at_rad = phase_rad(i, PHASES);
                let speed = equilibrium(part, share, at_rad);
                worst = worst.max((speed - share * at_rad.sin()).abs());
                [at_rad.to_degrees(), speed]
            })
            .collect();
        let curve = (0..=CURVE).map(|i| phase_rad(i, CURVE)).map(|at_rad| [at_rad.to_degrees(), share * at_rad.sin()]);
        chart = chart.line(&format!("b = {share}: b sin φ"), Color::nth(n), curve).dots("", Color::nth(n), found);
    }
    outcome.figures.push(figure("deviation of the general wave's equilibrium speed, largest", worst));
    outcome.charts.push(chart);
}

/// Speed at which the mean force on `part` changes its sign, in units of the first harmonic's.
fn equilibrium(part: PartParams, share: f64, phase_rad: f64) -> f64 {
    // velocity sin t + b sin(2t + φ), its time counted from a quarter of a cycle on
    let (sin, cos) = phase_rad.sin_cos();
    let second = [-share * sin, -share * cos];
    let line = PumpedLine { amplitude_mps: 1.0, base_radps: TAU, second, steps: STEPS };
    let pulls = |speed: f64| line.mean_force(part, speed) > 0.0;
    let [slow, fast] = bisect([-0.75, 0.75], HALVINGS, |speed| !pulls(speed));
    0.5 * (slow + fast)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::lab_rig;

    #[test]
    fn equilibrium_is_that_of_eq_28_and_the_pumps_is_one_of_them() {
        let part = PartParams { friction: FAINT, ..lab_rig("upm-1").penny };
        for (share, phase_deg) in [(0.3, 35.0), (0.45, 200.0), (0.499_99, 90.0)] {
            let phase_rad = f64::to_radians(phase_deg);
            let speed = equilibrium(part, share, phase_rad);
            assert!((speed - share * phase_rad.sin()).abs() < 1e-3, "{share}, {phase_deg}°: {speed}");
        }
    }
}
