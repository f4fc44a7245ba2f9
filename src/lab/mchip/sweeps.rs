//! Sweeps of the Impulse paper: mass of the part, position and height of the ridge, external force.

use super::batch::{Batch, Summaries, Summary, mean};
use super::bounce::ride;
use super::device::Device;
use super::drive::ResonatorDrive;
use super::run::Setup;
use super::{DYN_N, belt};
use crate::numerics::line_through;
use crate::{ExperimentResult, Figure};
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
/// Forces, dyn, and rates, mm/s, of Table I of the Impulse paper.
const TABLE: [[f64; 2]; 6] = [[0.0, 1.1], [-0.025, 0.6], [-0.05, 0.06], [-0.06, 0.0], [-0.075, -0.36], [-0.1, -0.88]];
/// Mass that the closed form of single bounces stops at the table's 0.056 dyn, kg: `F (1 + q)/(μ g (1 - q))`.
const HEAVY_KG: f64 = 207e-9;
/// Duties of the sweeps: that of mass and position, that of height and force.
const DUTY: f64 = 0.5;
const SHORT_DUTY: f64 = 0.36;

/// Adds the runs of every sweep, a group for each value.
pub fn add_runs(batch: &mut Batch) {
    let setup = |duty| Setup::published(ResonatorDrive { duty, ..ResonatorDrive::plain() });
    let mut sweep = |name: &str, values: &[f64], setup: &Setup, set: fn(&mut Setup, f64)| {
        for &value in values {
            let mut setup = setup.clone();
            set(&mut setup, value);
            batch.add(&group(name, value), &setup, STARTS, TIME_S);
        }
    };
    let mass = |setup: &mut Setup, value: f64| setup.part.mass_kg = 1e-9 * value;
    let place = |setup: &mut Setup, value: f64| setup.device.ridge_place_m = 1e-6 * value;
    let height = |setup: &mut Setup, value: f64| setup.device.ridge_height_m = 1e-6 * value;
    sweep("mass", &MASSES_UG, &setup(DUTY), mass);
    sweep("mass, soft", &MASSES_UG, &Setup { device: Device::soft(), ..setup(DUTY) }, mass);
    sweep("ridge-distance", &PLACES_UM, &setup(DUTY), place);
    sweep("ridge-height", &HEIGHTS_UM, &setup(SHORT_DUTY), height);
    let mut heavy = setup(SHORT_DUTY);
    heavy.part.mass_kg = HEAVY_KG;
    let mut pushed = |name: &str, setup: &Setup, force: f64| {
        batch.add_pushed(&group(name, force), setup, STARTS, TIME_S, force * DYN_N);
    };
    FORCES_DYN.iter().for_each(|force| pushed("force", &setup(SHORT_DUTY), *force));
    TABLE.iter().for_each(|[force, _]| pushed("force-heavy", &heavy, *force));
}

fn group(sweep: &str, value: f64) -> String {
    format!("{sweep} {value}")
}

/// Adds figures and charts.
pub fn report(runs: &Summaries, outcome: &mut ExperimentResult) {
    let curve = |sweep: &str, values: &[f64], of: fn(&Summary) -> f64| -> Vec<f64> {
        values.iter().map(|&value| mean(runs.of(&group(sweep, value)), of)).collect()
    };
    let rate = |sweep: &str, values: &[f64]| curve(sweep, values, |summary| mm_from_m(summary.rate_mps));
    let height = |sweep: &str, values: &[f64]| curve(sweep, values, |summary| 1e6 * summary.height_m.mean);
    let speeds = curve("ridge-distance", &PLACES_UM, |summary| summary.speed_radps);
    let fastest_um = at_peak(&PLACES_UM, &speeds);
    let feeding_um = at_peak(&PLACES_UM, &rate("ridge-distance", &PLACES_UM));
    let nearer = "Impulse paper: nearer the axis";
    let mass_ug = at_peak(&MASSES_UG, &rate("mass", &MASSES_UG));
    outcome.figures.extend([
        Figure::against("mass with the highest rate", "µg", mass_ug, 55.0, "Impulse paper").judged([40.0, 70.0]),
        spring("spring by the height against the mass", &height("mass", &MASSES_UG)),
        spring("the same on soft rods", &height("mass, soft", &MASSES_UG)),
        Figure::against("ridge distance with the highest angular speed", "µm", fastest_um, -125.0, "Impulse paper")
            .judged([-130.0, -120.0]),
        Figure::alone("ridge distance with the highest rate", "µm", feeding_um, nearer).judged([-125.0, -110.0]),
        collapse(&rate("ridge-height", &HEIGHTS_UM)),
    ]);
    let table_dyn = TABLE.map(|[force, _]| force);
    let undisturbed = runs.of(&group("force", FORCES_DYN[0]));
    outcome.figures.extend(force(&rate("force", &FORCES_DYN), mean(undisturbed, |summary| summary.height_m.mean)));
    outcome.figures.extend(heavy(&rate("force-heavy", &table_dyn)));
    for (name, x, values) in [
        ("mass", "mass (µg)", &MASSES_UG[..]),
        ("ridge-distance", "place of the ridge (µm)", &PLACES_UM),
        ("ridge-height", "height of the ridge (µm)", &HEIGHTS_UM),
        ("force", "force along the feed (dyn)", &FORCES_DYN),
        ("force-heavy", "force along the feed, 207 µg (dyn)", &table_dyn),
    ] {
        let chart = chart(name, x, values, &rate(name, values), &height(name, values));
        outcome.charts.push(chart.with(name.starts_with("force").then(belt_layer)));
    }
}

/// Rates of the paper's part under force, compared with Table I and the closed form of single bounces.
fn force(rates: &[f64], height_m: f64) -> Vec<Figure> {
    let setup = Setup::published(ResonatorDrive { duty: SHORT_DUTY, ..ResonatorDrive::plain() });
    // the number of ridges under the part does not enter the force
    let stall_dyn = ride(&setup.device, &setup.part, 1.0, height_m).stall_n / DYN_N;
    let points: Vec<[f64; 2]> = FORCES_DYN.iter().zip(rates).map(|(&force, &rate)| [force, rate]).collect();
    let mut figures = line_figures("", &points[..4]);
    let (of_stall, at) = ("μ M g (1 - q)/(1 + q), closed form", points[5]);
    let stopped = figures[1].measured;
    figures.push(Figure::against("the same beside single bounces", "dyn", stopped, stall_dyn, of_stall));
    figures.push(Figure::against("rate at -0.05 dyn", "mm/s", at[1], 0.06, TABLE_SOURCE).judged([-0.16, 0.28]));
    figures
}

const TABLE_SOURCE: &str = "Impulse paper, Table I";

/// Slope of the rate, mm/s, over the force, dyn, and the force that stops the part.
fn line_figures(which: &str, points: &[[f64; 2]]) -> Vec<Figure> {
    let [intercept, slope] = line_through(points);
    let (of_slope, of_stop) =
        (format!("slope of the rate over force, 36 % duty{which}"), format!("opposing force that stops it{which}"));
    vec![
        Figure::against(of_slope, "mm/s/dyn", slope, 19.6, TABLE_SOURCE).judged([14.7, 24.5]),
        Figure::against(of_stop, "dyn", intercept / slope, 0.056, TABLE_SOURCE).judged([0.042, 0.07]),
    ]
}

/// Rates of the heavier part under the forces of Table I.
fn heavy(rates: &[f64]) -> Vec<Figure> {
    let points: Vec<[f64; 2]> = TABLE.iter().zip(rates).map(|(&[force, _], &rate)| [force, rate]).collect();
    let mut figures = line_figures(", 207 µg", &points);
    figures.extend(points.iter().zip(&TABLE).map(|([force, rate], [_, paper])| {
        let name = format!("rate at {force} dyn, 207 µg");
        // a fifth of the rate without a force
        let accepted = [paper - 0.22, paper + 0.22].map(|limit| (100.0 * limit).round() / 100.0);
        Figure::against(name, "mm/s", *rate, *paper, TABLE_SOURCE).judged(accepted)
    }));
    figures
}

/// Value at which `curve` is highest.
fn at_peak(values: &[f64], curve: &[f64]) -> f64 {
    values.iter().zip(curve).max_by(|a, b| a.1.total_cmp(b.1)).map_or(f64::NAN, |(value, _)| *value)
}

/// Stiffness of the spring on which the part would sink by its weight as observed.
fn spring(name: &str, heights_um: &[f64]) -> Figure {
    let points: Vec<[f64; 2]> = MASSES_UG.iter().zip(heights_um).map(|(&mass, &height)| [mass, height]).collect();
    let [_, slope] = line_through(&points);
    // N/m from µg over µm
    let stiffness = -1e-9 * GRAVITY_MPS2 / (1e-6 * slope);
    Figure::against(name, "dyn/cm", 1e3 * stiffness, 294.0, "Impulse paper").judged([196.0, 392.0])
}

/// Rate at the ridge height at which the paper's drops, over that one step lower.
fn collapse(rates: &[f64]) -> Figure {
    let at =
        |um: f64| HEIGHTS_UM.iter().zip(rates).find(|(height, _)| **height == um).map_or(f64::NAN, |(_, rate)| *rate);
    Figure::alone("rate at a ridge of 16 µm over that at 12 µm", "1", at(16.0) / at(12.0), "Impulse paper: drops")
        .judged([0.0, 0.8])
}

/// Rate of a part on the belt of Fig. 11.
fn belt_layer() -> Layer {
    let points = FORCES_DYN.iter().map(|&force| [force, mm_from_m(belt::rate_mps(force * DYN_N))]);
    Layer::new("rate on the belt of Fig. 11", Mark::Dashes, Color::Gray, points)
}

fn chart(name: &str, x: &str, values: &[f64], rates: &[f64], heights: &[f64]) -> Chart {
    let points = |curve: &[f64]| values.iter().zip(curve).map(|(&x, &y)| [x, y]).collect::<Vec<_>>();
    let lower = points(heights).into_iter().map(|[x, y]| [x, 0.1 * y]);
    Chart::plot(format!("mchip-{name}"), format!("Sweep: {x}"), [x, "rate (mm/s); height above rest (10 µm)"])
        .line("rate", Color::Blue, points(rates))
        .dashes("height", Color::Orange, lower)
}
