//! Sweeps of the Impulse paper: mass of the part, position and height of the ridge, external force.

use super::batch::{Batch, BatchJob, Summaries, mean};
use super::bounce::stall_n;
use super::device::Device;
use super::drive::ResonatorDrive;
use super::{DYN_N, belt};
use crate::ExperimentResult;
use crate::numerics::line_through;
use crate::texts::{figure, figures};
use upm_chart::{Chart, Color, Layer, Mark};
use upm_core::units::{GRAVITY_MPS2, mm_from_m};

/// Starts at each value, and length of a run, s.
const STARTS: u64 = 4;
const TIME_S: f64 = 0.2;
/// Masses, µg; positions of the ridge and its heights, µm; forces along the feed, dyn, over the first four of which the
/// rate is about linear.
const MASSES_UG: [f64; 8] = [15.0, 25.0, 40.0, 55.0, 70.0, 95.0, 120.0, 160.0];
const PLACES_UM: [f64; 8] = [-140.0, -135.0, -130.0, -125.0, -120.0, -115.0, -110.0, -100.0];
const HEIGHTS_UM: [f64; 7] = [2.0, 5.0, 8.0, 12.0, 16.0, 20.0, 30.0];
const FORCES_DYN: [f64; 6] = [0.0, -0.005, -0.01, -0.015, -0.025, -0.05];
/// Forces of Table I of the Impulse paper, dyn.
const TABLE_DYN: [f64; 6] = [0.0, -0.025, -0.05, -0.06, -0.075, -0.1];
/// Mass that the closed form of single bounces stops at the table's 0.056 dyn, kg: `F (1 + q)/(μ g (1 - q))`.
const HEAVY_KG: f64 = 207e-9;
/// Duties of the sweeps: that of mass and position, that of height and force.
const DUTY: f64 = 0.5;
const SHORT_DUTY: f64 = 0.36;

/// Sweeps: name, label of the axis, values, duty, and how a value is set.
type ArraySweep = (&'static str, &'static str, &'static [f64], f64, fn(&mut BatchJob, f64));

const SWEEPS: [ArraySweep; 6] = [
    ("mass", "mass (µg)", &MASSES_UG, DUTY, |job, ug| job.setup.part.mass_kg = 1e-9 * ug),
    ("mass, soft", "", &MASSES_UG, DUTY, |job, ug| {
        (job.setup.device, job.setup.part.mass_kg) = (Device::soft(), 1e-9 * ug);
    }),
    ("ridge-distance", "place of the ridge (µm)", &PLACES_UM, DUTY, |job, um| {
        job.setup.device.ridge_place_m = 1e-6 * um;
    }),
    ("ridge-height", "height of the ridge (µm)", &HEIGHTS_UM, SHORT_DUTY, |job, um| {
        job.setup.device.ridge_height_m = 1e-6 * um;
    }),
    ("force", "force along the feed (dyn)", &FORCES_DYN, SHORT_DUTY, |job, force| job.force_n = force * DYN_N),
    ("force-heavy", "force along the feed, 207 µg (dyn)", &TABLE_DYN, SHORT_DUTY, |job, force| {
        (job.setup.part.mass_kg, job.force_n) = (HEAVY_KG, force * DYN_N);
    }),
];

/// Adds the runs of every sweep, a group for each value.
pub fn add_runs(batch: &mut Batch) {
    for (name, _, values, duty, set) in SWEEPS {
        for &value in values {
            let mut job = BatchJob::published(ResonatorDrive { duty, ..ResonatorDrive::plain() }, TIME_S);
            set(&mut job, value);
            batch.add(&group(name, value), STARTS, job);
        }
    }
}

fn group(sweep: &str, value: f64) -> String {
    format!("{sweep} {value}")
}

/// Adds figures and charts.
pub fn report(runs: &Summaries, outcome: &mut ExperimentResult) {
    let rates = |sweep: &str, values: &[f64]| points(values, |value| runs.rate_mm_s(&group(sweep, value)));
    let heights = |sweep: &str, values: &[f64]| points(values, |value| runs.height_um(&group(sweep, value)));
    let speeds = points(&PLACES_UM, |um| mean(runs.of(&group("ridge-distance", um)), |summary| summary.speed_radps));
    let at_ridge = |height_um: f64| runs.rate_mm_s(&group("ridge-height", height_um));
    outcome.figures.extend(figures([
        ("mass with the highest rate", at_peak(&rates("mass", &MASSES_UG))),
        ("spring by the height against the mass", spring_dyn_per_cm(&heights("mass", &MASSES_UG))),
        ("the same on soft rods", spring_dyn_per_cm(&heights("mass, soft", &MASSES_UG))),
        ("ridge distance with the highest angular speed", at_peak(&speeds)),
        ("ridge distance with the highest rate", at_peak(&rates("ridge-distance", &PLACES_UM))),
        ("rate at a ridge of 16 µm over that at 12 µm", at_ridge(16.0) / at_ridge(12.0)),
    ]));
    // Rates of the paper's part under force, compared with Table I and the closed form of single bounces.
    let light = rates("force", &FORCES_DYN);
    let stopped_dyn = line(&light[..4], "", outcome);
    let BatchJob { setup, .. } = BatchJob::published(ResonatorDrive::plain(), TIME_S);
    let stall_dyn = stall_n(&setup.device, &setup.part, 1e-6 * runs.height_um(&group("force", 0.0))) / DYN_N;
    outcome.figures.push(figure("the same beside single bounces", stopped_dyn).with(Some(stall_dyn)));
    outcome.figures.push(figure("rate at -0.05 dyn", light[5][1]));
    let heavy = rates("force-heavy", &TABLE_DYN);
    line(&heavy, ", 207 µg", outcome);
    outcome.figures.extend(heavy.iter().map(|[force, rate]| figure(&format!("rate at {force} dyn, 207 µg"), *rate)));
    for (name, x, values, ..) in SWEEPS.iter().filter(|(_, x, ..)| !x.is_empty()) {
        let lower = heights(name, values).into_iter().map(|[x, y]| [x, 0.1 * y]);
        let axes = [x, "rate (mm/s); height above rest (10 µm)"];
        let chart = Chart::plot(format!("mchip-{name}"), format!("Sweep: {x}"), axes)
            .line("rate", Color::Blue, rates(name, values))
            .dashes("height", Color::Orange, lower);
        outcome.charts.push(chart.with(name.starts_with("force").then(belt_layer)));
    }
}

fn points(values: &[f64], of: impl Fn(f64) -> f64) -> Vec<[f64; 2]> {
    values.iter().map(|&value| [value, of(value)]).collect()
}

/// Adds the slope of the rate, mm/s, over the force, dyn, and the force that stops the part, which it returns.
fn line(points: &[[f64; 2]], which: &str, outcome: &mut ExperimentResult) -> f64 {
    let [intercept, slope] = line_through(points);
    let found =
        [("slope of the rate over force, 36 % duty{}", slope), ("opposing force that stops it{}", intercept / slope)];
    outcome.figures.extend(figures(found).map(|figure| figure.of(which)));
    intercept / slope
}

/// Value at which `curve` is highest.
fn at_peak(curve: &[[f64; 2]]) -> f64 {
    curve.iter().max_by(|a, b| a[1].total_cmp(&b[1])).map_or(f64::NAN, |at| at[0])
}

/// Stiffness of the spring on which the part would sink by its weight as observed, from heights, µm, over masses, µg.
fn spring_dyn_per_cm(heights_um: &[[f64; 2]]) -> f64 {
    let [_, slope] = line_through(heights_um);
    // N/m from µg over µm
    1e3 * (-1e-9 * GRAVITY_MPS2 / (1e-6 * slope))
}

/// Rate of a part on the belt of Fig. 11.
fn belt_layer() -> Layer {
    let points = points(&FORCES_DYN, |force| mm_from_m(belt::rate_mps(force * DYN_N)));
    Layer::new("rate on the belt of Fig. 11", Mark::Dashes, Color::Gray, points)
}
