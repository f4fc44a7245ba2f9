//! Pictures of `upm check`: the coverage of a library, and the predicted paths of a job's parts.

use super::plan::Planned;
use upm_chart::{Chart, Color, Layer, Mark};
use upm_control::DryRun;
use upm_core::geometry::Vec2;
use upm_core::units::mm_from_m;
use upm_runner::run::{Coverage, PartForecast, Place, PlanVerdict};

/// Extent of the picture of a coverage, in half sides of the plate from its middle.
const COVERAGE_REACH: f64 = 1.3;

/// Arrows are drawn at every this many places along each axis.
const ARROWS_EVERY: usize = 4;

/// Chart of the plate from above: reach in the weakest direction, centres of rotation, unreachable places.
pub(super) fn coverage_chart(coverage: &Coverage, rig_name: &str) -> Chart {
    let shown_mm = COVERAGE_REACH * mm_from_m(coverage.half_side_m);
    let title = coverage_title(coverage, rig_name, shown_mm);
    Chart::plate_map(format!("coverage-{rig_name}"), title, Some(shown_mm), coverage_layers(coverage))
}

fn coverage_title(coverage: &Coverage, rig_name: &str, shown_mm: f64) -> String {
    let beyond = coverage.centers_m.iter().filter(|center| mm_from_m(center.amax()) > shown_mm).count();
    let translations = coverage.translations;
    format!("Coverage of {rig_name}; not shown: {beyond} centres farther out, {translations} translations")
}

fn coverage_layers(coverage: &Coverage) -> Vec<Layer> {
    let strongest_m = coverage.strongest_step_m();
    let pitch_mm = 2.0 * mm_from_m(coverage.half_side_m) / coverage.columns as f64;
    let part = |place: &Place| if strongest_m > 0.0 { place.longest_step_m / strongest_m } else { 0.0 };
    let at = |place: &Place| at_mm(place.position_m);
    let cells = Mark::Cells { side: pitch_mm, values: coverage.places.iter().map(part).collect() };
    let centers = coverage.centers_m.iter().map(|&center| at_mm(center));
    let unreached = coverage.places.iter().filter(|place| !place.is_reached());
    let arrows = coarse(coverage).map(|place| {
        let length_mm = 0.42 * ARROWS_EVERY as f64 * pitch_mm * part(place);
        (at(place), (place.weakest_direction * length_mm).into())
    });
    let reach = format!("longest step in the weakest direction, 0 to {:.2} mm", mm_from_m(strongest_m));
    let least = format!("out of reach: below {:.2} mm", mm_from_m(Place::LEAST_SHARE * coverage.best_step_m));
    let mut layers = vec![
        Layer::new(&reach, cells, Color::Orange, coverage.places.iter().map(at)),
        Layer::plate(mm_from_m(coverage.half_side_m)),
        Layer::new("centre of rotation", Mark::Dots, Color::Blue, centers),
        weakest_directions(arrows),
    ];
    if unreached.clone().next().is_some() {
        layers.push(Layer::new(&least, Mark::Crosses, Color::Red, unreached.map(at)));
    }
    layers
}

/// Places of a coarser grid about the same middle.
fn coarse(coverage: &Coverage) -> impl Iterator<Item = &Place> {
    let first = coverage.columns / 2 % ARROWS_EVERY;
    let taken = move |k: usize| k % ARROWS_EVERY == first;
    let columns = coverage.columns.max(1);
    coverage.places.iter().enumerate().filter(move |(i, _)| taken(i / columns) && taken(i % columns)).map(|(_, p)| p)
}

/// Extent of the picture of a plan, in half sides of the plate from its middle.
const PLAN_REACH: f64 = 1.08;

/// Half the length of the line in a part's weakest direction, in radii of the part.
const REACH: f64 = 1.7;

/// Offset of a part's name from its middle, right and up, in radii of the part.
const BESIDE: f64 = 0.6;

/// Chart of the plate from above: starts, targets, and paths in the first rehearsal.
pub(super) fn plan_chart(planned: &Planned) -> Chart {
    let half_side_mm = mm_from_m(planned.forecast.half_side_m);
    let mut layers = vec![Layer::plate(half_side_mm)];
    layers.extend(trails(planned));
    layers.extend(planned.forecast.parts.iter().enumerate().flat_map(|(i, part)| marks(i, part)));
    layers.push(weakest_directions(planned.forecast.parts.iter().map(|PartForecast { start, radius_m, .. }| {
        (at_mm(start.place.position_m), at_mm(start.place.weakest_direction * (REACH * radius_m)))
    })));
    Chart::plate_map(format!("plan-{}", planned.job), plan_title(planned), Some(PLAN_REACH * half_side_mm), layers)
}

fn plan_title(planned: &Planned) -> String {
    let Planned { job, rig, forecast } = planned;
    match forecast.range(|rehearsal| rehearsal.plate_time_s) {
        Some([_, median_s, _]) if forecast.verdict() == PlanVerdict::CanBeDone => {
            format!("{job} on {rig}: predicted to take {median_s:.1} s of plate time")
        }
        Some(_) => format!("{job} on {rig}: not every rehearsal reaches the goal"),
        None if forecast.verdict() == PlanVerdict::Undecided => {
            format!("{job} on {rig}: too long to be rehearsed to its end")
        }
        None => format!("{job} on {rig}: predicted that it cannot be done"),
    }
}

fn trails(planned: &Planned) -> impl Iterator<Item = Layer> {
    let trails = planned.forecast.rehearsals.first().map_or(&[][..], |DryRun { trails_m, .. }| trails_m);
    trails.iter().enumerate().map(|(i, trail_m)| {
        let points = trail_m.iter().map(|&p| at_mm(p));
        Layer::new(of_first(i, "predicted way"), Mark::Line, Color::nth(i), points)
    })
}

/// Outline at the start, target and name of part `i`.
fn marks(i: usize, part: &PartForecast) -> Vec<Layer> {
    let (color, start) = (Color::nth(i), at_mm(part.start.place.position_m));
    let rim = Mark::Circles { radius: mm_from_m(part.radius_m) };
    let name = Mark::Labels { texts: vec![part.id.clone()] };
    let beside = start.map(|along| along + mm_from_m(BESIDE * part.radius_m));
    let target = part.target.iter().map(|spot| at_mm(spot.place.position_m));
    vec![
        Layer::new(of_first(i, "start"), rim, color, [start]),
        Layer::new(of_first(i, "target"), Mark::Crosses, color, target),
        Layer::new("", name, color, [beside]),
    ]
}

/// Double-headed arrows at the places, of the given lengths, in the direction in which one pulse moves a part least.
fn weakest_directions(arrows: impl Iterator<Item = ([f64; 2], [f64; 2])>) -> Layer {
    let both_ways = arrows.flat_map(|(from, ahead)| [(from, ahead), (from, ahead.map(|along| -along))]);
    let (from, vectors): (Vec<_>, Vec<_>) = both_ways.unzip();
    Layer::new("weakest direction", Mark::Arrows { vectors }, Color::Gray, from)
}

/// `label` for the first part and an empty one for all others, so that the legend has one entry.
fn of_first(i: usize, label: &'static str) -> &'static str {
    if i == 0 { label } else { "" }
}

fn at_mm(at_m: Vec2) -> [f64; 2] {
    [at_m.x, at_m.y].map(mm_from_m)
}
