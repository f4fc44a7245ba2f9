//! Figures and charts of the experiment with two parts.

use super::super::pulses::mm;
use super::super::texts::{chart, figure, figures};
use super::super::{ExperimentResult, Figure};
use super::calibrated_pulses::{CalibratedPulses, STRONG_SPIN_RADPS};
use super::plan::{CENTERS, condition, field_matrix, mean_miss};
use super::task::{OBSERVATIONS, StepSeries, TwoPartProblem};
use upm_chart::{Chart, Color, Layer, Mark};
use upm_core::document::counted;

/// Radius of the circle about a start, in half sides of the plate.
const START: f64 = 0.02;

/// Outcome from the runs in the ideal field, on the strong plate and on the rig's; `plates` are those of the last two.
pub fn outcome(task: &TwoPartProblem, runs: [&StepSeries; 3], plates: [&CalibratedPulses<'_>; 2]) -> ExperimentResult {
    let mut figures = of_one_observation(task, runs[0]);
    figures.extend(runs[1..].iter().zip(plates).flat_map(|(run, plate)| of_plate(run, plate)));
    let spin = plates[1].spin_radps.into_iter().fold(f64::INFINITY, f64::min);
    figures.extend([figure("spin, strong plate", STRONG_SPIN_RADPS), figure("spin, rig's plate", spin)]);
    let maps = ["two-parts-ideal", "two-parts-strong", "two-parts-plate"].into_iter().zip(runs);
    let charts = maps.filter_map(|(name, run)| map(name, task, run)).chain([misses(runs)]).collect();
    ExperimentResult { figures, charts, ..ExperimentResult::default() }
}

fn of_one_observation(task: &TwoPartProblem, ideal: &StepSeries) -> Vec<Figure> {
    let step_mm = 1e3 * mean_miss(&task.starts_m, &task.goals_m);
    let condition = condition(&field_matrix(&task.centers_m, &task.starts_m));
    let mut figures = vec![figure("mean step of the parts", step_mm), figure("condition number of Φ", condition)];
    // each observation corrects the error of the previous ones; the second-order error of its own step remains
    let measured = |observations: usize| ideal.miss_m(observations).unwrap_or(f64::NAN);
    let [.., coarse, fine] = OBSERVATIONS;
    let order = (measured(coarse) / measured(fine)).ln() / (fine as f64 / coarse as f64).ln();
    figures.extend(misses_of(ideal, "UPM paper, Eq. 3; it prints no figure"));
    figures.push(figure("order at which E falls with observations, ideal field", order));
    figures
}

fn misses_of<'a>(run: &'a StepSeries, source: &'a str) -> impl Iterator<Item = Figure> + 'a {
    run.ways.iter().map(move |(observations, way)| {
        let name = format!("E of {}, {}", counted(*observations, "observation"), run.name);
        Figure::alone(name, "mm", 1e3 * way.miss_m, source)
    })
}

fn of_plate(run: &StepSeries, plate: &CalibratedPulses<'_>) -> Vec<Figure> {
    let name = run.name;
    let found = [("shortest pulse, {}", 1e3 * plate.shortest_m()), ("saturation, {}", plate.saturation())];
    let mut figures: Vec<Figure> = figures(found).map(|figure| figure.of(name)).into();
    figures.extend(misses_of(run, "beside the ideal field's E"));
    for (observations, fault) in &run.failed {
        let (name, count) = (format!("failed try, {name}"), *observations as f64);
        figures.push(Figure::alone(name, "observations", count, &fault.to_string()));
    }
    figures
}

/// The paper's Fig. 3 (d): starts, goals and the polygonal line through the positions after each rotation.
fn map(name: &str, task: &TwoPartProblem, run: &StepSeries) -> Option<Chart> {
    let (observations, way) = run.ways.first()?;
    let corners = &way.corners;
    let centers = task.centers_m.map(mm);
    let names = Mark::Labels { texts: (1..=CENTERS).map(|center| format!("C{center}")).collect() };
    let mut layers = vec![
        Layer::plate(1e3 * task.half_side_m),
        Layer::new("centres of rotation", Mark::Crosses, Color::Gray, centers),
        Layer::new("", names, Color::Gray, centers),
    ];
    for i in 0..task.starts_m.len() {
        let (part, color) = (i + 1, Color::nth(i));
        let way: Vec<_> = corners.iter().map(|places| mm(places[i])).collect();
        let (start, goal) = (mm(task.starts_m[i]), mm(task.goals_m[i]));
        let radius = START * 1e3 * task.half_side_m;
        let names = [format!("S{part}")].into_iter().chain((1..way.len()).map(|rotation| rotation.to_string()));
        layers.extend([
            Layer::new(&format!("part {part}, from S{part} by rotations 1, 2, ..."), Mark::Line, color, way.clone()),
            Layer::new("", Mark::Dots, color, way.iter().skip(1).copied()),
            Layer::new("", Mark::Circles { radius }, color, [start]),
            Layer::new("", Mark::Labels { texts: names.collect() }, color, way),
            Layer::new(&format!("goal F{part}"), Mark::Crosses, color, [goal]),
            Layer::new("", Mark::Labels { texts: vec![format!("F{part}")] }, color, [goal]),
        ]);
    }
    let (how, observations) = ("two parts, four centres of rotation", counted(*observations, "observation"));
    let title = format!("{}: {how}, a large step in {observations}", run.name);
    Some(Chart::plate_map(name, title, None, layers))
}

fn misses(runs: [&StepSeries; 3]) -> Chart {
    let mut chart = chart("two-parts-observations");
    for (i, run) in runs.iter().enumerate() {
        let points = run.ways.iter().map(|(observations, way)| [*observations as f64, 1e3 * way.miss_m]);
        let failed: Vec<String> = run.failed.iter().map(|(observations, _)| observations.to_string()).collect();
        let label = match failed.as_slice() {
            [] => run.name.to_owned(),
            failed => format!("{} (failed with {} observations)", run.name, failed.join(", ")),
        };
        chart = chart.line(&label, Color::nth(i), points.clone()).dots("", Color::nth(i), points);
    }
    chart
}
