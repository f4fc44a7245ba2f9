//! Picture of the coverage of a library.

use super::coverage_report::scale;
use upm_chart::{Chart, Color, Layer, Mark};
use upm_core::geometry::Vec2;
use upm_core::units::mm_from_m;
use upm_runner::run::{Coverage, PlaceReach};

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
    let strongest_m = coverage.steps_m().map_or(0.0, |[_, most_m]| most_m);
    let pitch_mm = 2.0 * mm_from_m(coverage.half_side_m) / coverage.columns as f64;
    let part = |place: &PlaceReach| if strongest_m > 0.0 { place.reach.longest_step_m / strongest_m } else { 0.0 };
    let at = |place: &PlaceReach| at_mm(place.position_m);
    let cells = Mark::Cells { side: pitch_mm, values: coverage.shades() };
    let centers = coverage.centers_m.iter().map(|&center| at_mm(center));
    let unreached = coverage.places.iter().filter(|place| !place.is_reached());
    let arrows = coarse(coverage).map(|place| {
        let length_mm = 0.42 * ARROWS_EVERY as f64 * pitch_mm * part(place);
        (at(place), (place.reach.weakest_direction * length_mm).into())
    });
    let reach = format!("longest step in the weakest direction, {}", scale(coverage));
    let least = format!("out of reach: below {:.2} mm", mm_from_m(PlaceReach::LEAST_SHARE * coverage.best_step_m));
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
fn coarse(coverage: &Coverage) -> impl Iterator<Item = &PlaceReach> {
    let first = coverage.columns / 2 % ARROWS_EVERY;
    let taken = move |k: usize| k % ARROWS_EVERY == first;
    let columns = coverage.columns.max(1);
    coverage.places.iter().enumerate().filter(move |(i, _)| taken(i / columns) && taken(i % columns)).map(|(_, p)| p)
}

/// Double-headed arrows at the places, of the given lengths, in the direction in which one pulse moves a part least.
fn weakest_directions(arrows: impl Iterator<Item = ([f64; 2], [f64; 2])>) -> Layer {
    let both_ways = arrows.flat_map(|(from, ahead)| [(from, ahead), (from, ahead.map(|along| -along))]);
    let (from, vectors): (Vec<_>, Vec<_>) = both_ways.unzip();
    Layer::new("weakest direction", Mark::Arrows { vectors }, Color::Gray, from)
}

pub(super) fn at_mm(at_m: Vec2) -> [f64; 2] {
    [at_m.x, at_m.y].map(mm_from_m)
}
