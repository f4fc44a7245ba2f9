use upm_chart::{Chart, Color, Layer, Mark};
use upm_core::units::mm_from_m;
use upm_runner::run::{Coverage, Place};

/// Extent of the picture, in half sides of the plate from its middle.
const SHOWN: f64 = 1.3;

/// Every so many places have arrows.
const ARROWS_EVERY: usize = 4;

/// The plate from above: reach in the weakest direction, centres, what is out of reach.
pub(super) fn chart(coverage: &Coverage, rig_name: &str) -> Chart {
    let shown_mm = SHOWN * mm_from_m(coverage.half_side_m);
    let title = title(coverage, rig_name, shown_mm);
    Chart::plate_map(format!("coverage-{rig_name}"), title, Some(shown_mm), layers(coverage))
}

fn title(coverage: &Coverage, rig_name: &str, shown_mm: f64) -> String {
    let beyond = coverage.centers_m.iter().filter(|center| mm_from_m(center.amax()) > shown_mm).count();
    let translations = coverage.translations;
    format!("Coverage of {rig_name}; not shown: {beyond} centres farther out, {translations} translations")
}

fn layers(coverage: &Coverage) -> Vec<Layer> {
    let strongest_m = coverage.strongest_step_m();
    let pitch_mm = 2.0 * mm_from_m(coverage.half_side_m) / coverage.columns as f64;
    let part = |place: &Place| if strongest_m > 0.0 { place.longest_step_m / strongest_m } else { 0.0 };
    let at = |place: &Place| at_mm([place.position_m.x, place.position_m.y]);
    let cells = Mark::Cells { side: pitch_mm, values: coverage.places.iter().map(part).collect() };
    let centers = coverage.centers_m.iter().map(|center| at_mm([center.x, center.y]));
    let unreached = coverage.places.iter().filter(|place| !place.is_reached());
    let (mut from, mut vectors) = (Vec::new(), Vec::new());
    for place in coarse(coverage) {
        let length_mm = 0.42 * ARROWS_EVERY as f64 * pitch_mm * part(place);
        let ahead = place.weakest_direction * length_mm;
        for vector in [ahead, -ahead] {
            from.push(at(place));
            vectors.push([vector.x, vector.y]);
        }
    }
    let reach = format!("longest step in the weakest direction, 0 to {:.2} mm", mm_from_m(strongest_m));
    let least = format!("out of reach: below {:.2} mm", mm_from_m(Place::LEAST_SHARE * coverage.best_step_m));
    let mut layers = vec![
        Layer::new(&reach, cells, Color::Orange, coverage.places.iter().map(at)),
        Layer::plate(mm_from_m(coverage.half_side_m)),
        Layer::new("centre of rotation", Mark::Dots, Color::Blue, centers),
        Layer::new("weakest direction", Mark::Arrows { vectors }, Color::Gray, from),
    ];
    if unreached.clone().next().is_some() {
        layers.push(Layer::new(&least, Mark::Crosses, Color::Red, unreached.map(at)));
    }
    layers
}

/// Places on a coarser grid about the same middle.
fn coarse(coverage: &Coverage) -> impl Iterator<Item = &Place> {
    let first = coverage.columns / 2 % ARROWS_EVERY;
    let taken = move |k: usize| k % ARROWS_EVERY == first;
    let columns = coverage.columns.max(1);
    coverage.places.iter().enumerate().filter(move |(i, _)| taken(i / columns) && taken(i % columns)).map(|(_, p)| p)
}

fn at_mm(at_m: [f64; 2]) -> [f64; 2] {
    at_m.map(mm_from_m)
}
