//! Sweeps of the Impulse paper: mass of the part, position and height of the ridge, external force.

use std::ops::Range;

use super::DYN_N;
use super::batch::{Batch, Summary, mean};
use super::belt::Belt;
use super::bounce::ride;
use super::device::Device;
use super::drive::ResonatorDrive;
use super::run::Setup;
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

/// Ranges of the sweeps' runs among the summaries.
pub struct Sweeps {
    masses: Vec<Range<usize>>,
    soft: Vec<Range<usize>>,
    places: Vec<Range<usize>>,
    heights: Vec<Range<usize>>,
    forces: Vec<Range<usize>>,
    heavy: Vec<Range<usize>>,
}

impl Sweeps {
    pub fn new(batch: &mut Batch) -> Self {
        let setup = |duty| Setup::published(ResonatorDrive { duty, ..ResonatorDrive::plain() });
        let mut sweep = |values: &[f64], setup: &Setup, set: fn(&mut Setup, f64)| {
            let at = |value: &f64| {
                let mut setup = setup.clone();
                set(&mut setup, *value);
                batch.add(&setup, STARTS, TIME_S)
            };
            values.iter().map(at).collect::<Vec<_>>()
        };
        let mass = |setup: &mut Setup, value: f64| setup.part.mass_kg = 1e-9 * value;
        let soft = Setup { device: Device::soft(), ..setup(DUTY) };
        let (masses, soft) = (sweep(&MASSES_UG, &setup(DUTY), mass), sweep(&MASSES_UG, &soft, mass));
        let place = |setup: &mut Setup, value: f64| setup.device.ridge_place_m = 1e-6 * value;
        let height = |setup: &mut Setup, value: f64| setup.device.ridge_height_m = 1e-6 * value;
        let places = sweep(&PLACES_UM, &setup(DUTY), place);
        let heights = sweep(&HEIGHTS_UM, &setup(SHORT_DUTY), height);
        let mut heavy = setup(SHORT_DUTY);
        heavy.part.mass_kg = HEAVY_KG;
        let mut pushed = |setup: &Setup, force: f64| batch.add_pushed(setup, STARTS, TIME_S, force * DYN_N);
        let forces = FORCES_DYN.map(|force| pushed(&setup(SHORT_DUTY), force)).to_vec();
        let heavy = TABLE.map(|[force, _]| pushed(&heavy, force)).to_vec();
        Self { masses, soft, places, heights, forces, heavy }
    }

    /// Adds figures and charts.
    pub fn report<'a>(&self, of: &impl Fn(&Range<usize>) -> &'a [Summary], outcome: &mut ExperimentResult) {
        let curve = |ranges: &[Range<usize>], value: fn(&Summary) -> f64| -> Vec<f64> {
            ranges.iter().map(|range| mean(of(range), value)).collect()
        };
        let rate = |ranges: &[Range<usize>]| curve(ranges, |summary| mm_from_m(summary.rate_mps));
        let height = |ranges: &[Range<usize>]| curve(ranges, |summary| 1e6 * summary.height_m.mean);
        let speed = |ranges: &[Range<usize>]| curve(ranges, |summary| summary.speed_radps);
        let (rates, heights) = (rate(&self.masses), height(&self.masses));
        let fastest_um = at_peak(&PLACES_UM, &speed(&self.places));
        let feeding_um = at_peak(&PLACES_UM, &rate(&self.places));
        let nearer = "Impulse paper: nearer the axis";
        let mass_ug = at_peak(&MASSES_UG, &rates);
        outcome.figures.extend([
            Figure::against("mass with the highest rate", "µg", mass_ug, 55.0, "Impulse paper").judged([40.0, 70.0]),
            spring("spring by the height against the mass", &heights),
            spring("the same on soft rods", &height(&self.soft)),
            Figure::against("ridge distance with the highest angular speed", "µm", fastest_um, -125.0, "Impulse paper")
                .judged([-130.0, -120.0]),
            Figure::alone("ridge distance with the highest rate", "µm", feeding_um, nearer).judged([-125.0, -110.0]),
            collapse(&rate(&self.heights)),
        ]);
        outcome.figures.extend(self.force(&rate(&self.forces), of));
        outcome.figures.extend(heavy(&rate(&self.heavy)));
        for (name, x, values, ranges) in [
            ("mass", "mass (µg)", &MASSES_UG[..], &self.masses),
            ("ridge-distance", "place of the ridge (µm)", &PLACES_UM[..], &self.places),
            ("ridge-height", "height of the ridge (µm)", &HEIGHTS_UM[..], &self.heights),
            ("force", "force along the feed (dyn)", &FORCES_DYN[..], &self.forces),
            ("force-heavy", "force along the feed, 207 µg (dyn)", &TABLE.map(|[force, _]| force)[..], &self.heavy),
        ] {
            let mut chart = chart(name, x, values, &rate(ranges), &height(ranges));
            if name.starts_with("force") {
                chart.layers.push(belt());
            }
            outcome.charts.push(chart);
        }
    }

    /// Rates of the paper's part under force, compared with Table I and the closed form of single bounces.
    fn force<'a>(&self, rates: &[f64], of: &impl Fn(&Range<usize>) -> &'a [Summary]) -> Vec<Figure> {
        let setup = Setup::published(ResonatorDrive { duty: SHORT_DUTY, ..ResonatorDrive::plain() });
        let height_m = self.forces.first().map_or(f64::NAN, |range| mean(of(range), |summary| summary.height_m.mean));
        // the number of ridges under the part does not enter the force
        let stall_dyn = ride(&setup.device, &setup.part, 1.0, height_m).stall_n / DYN_N;
        let points: Vec<[f64; 2]> = FORCES_DYN.iter().zip(rates).map(|(&force, &rate)| [force, rate]).collect();
        let mut figures = line_figures("", &points[..4]);
        let (stall_source, at) = ("μ M g (1 - q)/(1 + q), closed form", points[5]);
        figures.push(Figure::against(
            "the same beside single bounces",
            "dyn",
            figures[1].measured,
            stall_dyn,
            stall_source,
        ));
        figures.push(Figure::against("rate at -0.05 dyn", "mm/s", at[1], 0.06, TABLE_SOURCE).judged([-0.16, 0.28]));
        figures
    }
}

const TABLE_SOURCE: &str = "Impulse paper, Table I";

/// Slope of the rate, mm/s, over the force, dyn, and the force that stops the part.
fn line_figures(which: &str, points: &[[f64; 2]]) -> Vec<Figure> {
    let [intercept, slope] = line_through(points);
    vec![
        Figure::against(
            format!("slope of the rate over force, 36 % duty{which}"),
            "mm/s/dyn",
            slope,
            19.6,
            TABLE_SOURCE,
        )
        .judged([14.7, 24.5]),
        Figure::against(format!("opposing force that stops it{which}"), "dyn", intercept / slope, 0.056, TABLE_SOURCE)
            .judged([0.042, 0.07]),
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
fn belt() -> Layer {
    let points = FORCES_DYN.iter().map(|&force| [force, mm_from_m(Belt::published().rate_mps(force * DYN_N))]);
    Layer::new("rate on the belt of Fig. 11", Mark::Dashes, Color::Gray, points)
}

fn chart(name: &str, x: &str, values: &[f64], rates: &[f64], heights: &[f64]) -> Chart {
    let points = |curve: &[f64]| values.iter().zip(curve).map(|(&x, &y)| [x, y]).collect::<Vec<_>>();
    Chart::plot(
        format!("mchip-{name}"),
        format!("Sweep: {x}"),
        [x, "rate (mm/s); height above rest (10 µm)"],
        vec![
            Layer::new("rate", Mark::Line, Color::Blue, points(rates)),
            Layer::new("height", Mark::Dashes, Color::Orange, points(heights).into_iter().map(|[x, y]| [x, 0.1 * y])),
        ],
    )
}
