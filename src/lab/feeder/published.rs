//! The paper's experiments: feed rate against duty (Figs. 15 and 18), against an external force (Fig. 19), and our own
//! wave of two harmonics compared with the paper's.

use std::f64::consts::TAU;

use super::part::{Sliding, quasi_static_mps};
use super::plate::PlateCycle;
use super::{DYN_N, Feeder};
use crate::coulomb_pump;
use crate::numerics::line_through;
use crate::pumped::{PUMP, PumpedLine};
use crate::sweep::Progress;
use crate::texts::{chart, figure, sheet};
use crate::{ExperimentResult, Figure, LabError, LabRig};
use upm_chart::Color;
use upm_core::background::on_all_cores;
use upm_core::units::GRAVITY_MPS2;
use upm_sim::PartParams;

/// Accelerations of Fig. 18, m/s², and the duties at which they saturate by Eq. 5.
const ACCELS_MPS2: [f64; 3] = [100.0, 150.0, 200.0];
const SATURATIONS: [f64; 3] = [0.602, 0.609, 0.613];
/// Duties of Fig. 18.
const DUTIES: u32 = 50;
/// `2 - √2`, half way between no feed and saturation.
const DUTY_OPTIMAL: f64 = 0.585_786_437_626_905;
/// The experiment with a force (section III-C.3): plate, friction, duty, and forces, dyn. The paper does not print the
/// duty; its intercept `-K ν` determines it.
const FORCED: PlateCycle = PlateCycle { accel_mps2: 100.0, period_s: 0.01, duty: 0.548 };
const FORCED_FRICTION: f64 = 0.5;
const FORCES_DYN: i32 = 15;
/// Time before a force and after it, s.
const SETTLING_S: f64 = 1.0;
const MEASURED_S: f64 = 2.0;
/// Steps of a cycle of the two harmonics, for the simulated plate's own friction engine.
const STEPS: u32 = 20_000;
const PUMP_CYCLES: u32 = 60;

const CM: f64 = 0.01;

/// Reproduces all of them.
///
/// # Errors
///
/// None in the published settings.
pub fn reproduce(rig: &LabRig, progress: Progress<'_>) -> Result<ExperimentResult, LabError> {
    let mut outcome = ExperimentResult::default();
    let mut chart = chart("feeder-duty");
    for (i, (&accel_mps2, &saturates)) in ACCELS_MPS2.iter().zip(&SATURATIONS).enumerate() {
        // Feed rates over all duties at one acceleration, simulated and by the closed form.
        let (plate, sliding) = (Feeder::published().plate, Feeder::published().sliding());
        let largest_mps = accel_mps2 * plate.period_s / 16.0;
        let (mut rates, mut before, mut beyond) = (Vec::new(), 0.0f64, 0.0f64);
        for duty in (0..=DUTIES).map(|i| 0.5 + 0.5 * f64::from(i) / f64::from(DUTIES)) {
            let plate = PlateCycle { accel_mps2, duty, ..plate };
            let rate_mps = sliding.settled(&plate)?.way_m / plate.period_s;
            let off = (rate_mps - sliding.rate_mps(&plate).unwrap_or(f64::NAN)).abs() / largest_mps;
            let worst = if duty <= sliding.saturation(accel_mps2) { &mut before } else { &mut beyond };
            *worst = worst.max(off);
            rates.push([duty, rate_mps / CM]);
        }
        let at = format!("at {:.0} cm/s²", accel_mps2 / CM);
        let found = [
            figure("rate off the closed form before saturation, largest, {}", before),
            figure("rate off the closed form beyond saturation, largest, {}", beyond),
            figure("duty at which the part saturates, {}", sliding.saturation(accel_mps2)).with(Some(saturates)),
        ];
        outcome.figures.extend(found.map(|figure| figure.of(&at)));
        let rate = |duty: f64| Some([duty, sliding.rate_mps(&PlateCycle { accel_mps2, duty, ..plate })? / CM]);
        let exact = (0..=250).map(|i| 0.5 + 0.002 * f64::from(i)).filter_map(rate);
        let label = format!("{:.0} cm/s²: closed form", accel_mps2 / CM);
        chart = chart.line(&label, Color::nth(i), exact).dots("", Color::nth(i), rates);
        progress(0.2 * (i + 1) as f64 / ACCELS_MPS2.len() as f64);
    }
    landmarks(&mut outcome);
    rate_against_force(&|share| progress(0.2 + 0.8 * share), &mut outcome);
    drives(rig, &mut outcome);
    outcome.charts.push(chart);
    Ok(outcome)
}

/// Individual figures of section III-B and III-C.1.
fn landmarks(outcome: &mut ExperimentResult) {
    let plate = PlateCycle { duty: DUTY_OPTIMAL, ..Feeder::published().plate };
    let half = quasi_static_mps(&plate) / plate.peak_mps();
    let source = "(a T/2)(d - sqrt(2 d - 1)) at 15,000 cm/s²";
    outcome.figures.extend([
        figure("rate over the plate's largest speed at d = 2 - √2", half),
        Figure::against("largest speed of the plate", "cm/s", plate.peak_mps() / CM, 25.7, source),
        figure("half stroke of the plate, the paper's x_max", plate.stroke_m() / CM),
    ]);
}

/// The rate under each force, and the line through all of them (Fig. 19).
fn rate_against_force(progress: Progress<'_>, outcome: &mut ExperimentResult) {
    let (plate, mass_kg) = (FORCED, Feeder::published().mass_kg);
    let cycles = |time_s: f64| (time_s / plate.period_s).round() as usize;
    let forces_dyn: Vec<i32> = (-FORCES_DYN..=FORCES_DYN).collect();
    let under = |force_dyn: i32| Sliding {
        drag_mps2: FORCED_FRICTION * GRAVITY_MPS2,
        push_mps2: f64::from(force_dyn) * DYN_N / mass_kg,
    };
    let rates_mps = on_all_cores(&forces_dyn, progress, |&force_dyn| {
        under(force_dyn).mean_mps(&plate, cycles(SETTLING_S), cycles(MEASURED_S))
    });
    let points = |rate_mps: &dyn Fn(usize) -> f64| -> Vec<[f64; 2]> {
        forces_dyn.iter().enumerate().map(|(i, &force)| [rate_mps(i) / CM, f64::from(force)]).collect()
    };
    let exact = points(&|i| under(forces_dyn[i]).rate_mps(&plate).unwrap_or(f64::NAN));
    let (points, [exact_intercept, exact_slope]) = (points(&|i| rates_mps[i]), line_through(&exact));
    let [intercept, slope] = line_through(&points);
    let found = [
        figure("slope of force over rate, K, at d = 0.548, ±15 dyn", slope).with(Some(exact_slope)),
        figure("force at rate zero, -K ν, at d = 0.548, ±15 dyn", intercept).with(Some(exact_intercept)),
    ];
    outcome.figures.extend(found);
    let ends = [points.first(), points.last()].into_iter().flatten().map(|at| [at[0], intercept + slope * at[0]]);
    let chart = chart("feeder-force-548").line(&format!("{intercept:.2} + {slope:.2} x"), Color::Gray, ends);
    outcome.charts.push(chart.dots("simulated", Color::Orange, points));
}

/// The paper's wave at two duties and the pump's two harmonics, all with the same acceleration and period.
fn drives(rig: &LabRig, outcome: &mut ExperimentResult) {
    let feeder = Feeder::published();
    let (Feeder { plate, friction, .. }, sliding) = (feeder, feeder.sliding());
    let (accel_mps2, period_s) = (plate.accel_mps2, plate.period_s);
    let saturated = PlateCycle { duty: sliding.saturation(accel_mps2), ..plate };
    let mut rows = Vec::new();
    for plate in [PlateCycle { duty: DUTY_OPTIMAL, ..plate }, saturated] {
        let rate_mps = sliding.settled(&plate).map_or(f64::NAN, |cycle| cycle.way_m / period_s);
        rows.push(vec![plate.duty, plate.peak_mps() / CM, plate.stroke_m() / CM, rate_mps / CM]);
    }
    let amplitude_mps = accel_mps2 * period_s / (TAU * coulomb_pump::peak_acceleration());
    let line = PumpedLine { amplitude_mps, base_radps: TAU / period_s, second: PUMP, steps: STEPS };
    let part = PartParams { friction, ..rig.penny };
    let rate_mps = line.carried_mps(part, PUMP_CYCLES, PUMP_CYCLES);
    rows.push(vec![f64::NAN, 0.75 * amplitude_mps / CM, line.stroke_m() / CM, rate_mps / CM]);
    let rate = figure("rate of the two harmonics cos wt - ½ cos 2wt", rate_mps / CM);
    outcome.figures.push(rate.of(&format!("{:.2}", 0.5 * amplitude_mps / CM)));
    outcome.sheet = Some(sheet("feeder", rows));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{assert_sources_are_short, lab_rig};

    #[test]
    fn published_figures_come_out() {
        let outcome = reproduce(&lab_rig("upm-1"), &|_| ()).unwrap();
        assert_sources_are_short(&outcome);
        let figure = |start: &str| outcome.figures.iter().find(|figure| figure.name.starts_with(start)).unwrap();
        for figure in outcome.figures.iter().filter(|figure| figure.name.starts_with("rate off the closed form")) {
            assert!(figure.measured < 1e-4, "{figure:?}");
        }
        let slope = figure("slope of force over rate, K, at d = 0.548").measured;
        let intercept = figure("force at rate zero, -K ν, at d = 0.548").measured;
        assert!((slope / 1.96 - 1.0).abs() < 0.01 && (intercept / -4.72 - 1.0).abs() < 0.01, "{slope} {intercept}");
    }
}
