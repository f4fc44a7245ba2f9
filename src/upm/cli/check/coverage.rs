//! Coverage of a library, as text, as JSON and as a picture.

use serde_json::{Value, json};

use upm_chart::{Chart, Color, Layer, Mark};
use upm_core::geometry::Vec2;
use upm_core::units::mm_from_m;
use upm_recording::rounded;
use upm_runner::run::{Coverage, PlaceReach};

/// Text output; the picture has the places one by one.
pub(super) fn lines(coverage: &Coverage) -> Vec<String> {
    figures(coverage).into_iter().map(|(label, text)| format!("{label:16} {text}")).collect()
}

/// JSON output; lengths in millimetres.
pub(super) fn json(coverage: &Coverage) -> Value {
    let weakest = coverage.weakest().map(place_json);
    let gap = coverage.gap.map(
        |gap| json!({ "position_mm": position(gap.position_m), "distance_mm": rounded(mm_from_m(gap.distance_m)) }),
    );
    let row = |places: &[PlaceReach]| -> Vec<f64> {
        places.iter().map(|p| rounded(mm_from_m(p.reach.longest_step_m))).collect()
    };
    json!({
        "side_mm": rounded(mm_from_m(2.0 * coverage.half_side_m)),
        "centres": {
            "inside": coverage.inside,
            "outside": coverage.outside,
            "translations": coverage.translations,
        },
        "largest_gap": gap,
        "weakest": weakest,
        "best_step_mm": rounded(mm_from_m(coverage.best_step_m)),
        "out_of_reach_share": rounded(coverage.unreached_share()),
        "out_of_reach_below_share": PlaceReach::LEAST_SHARE,
        "never_strongest": coverage.never_strongest,
        "longest_step_mm": coverage.places.chunks(coverage.columns).map(row).collect::<Vec<_>>(),
    })
}

fn figures(coverage: &Coverage) -> Vec<(&'static str, String)> {
    let Coverage { inside, outside, translations, .. } = coverage;
    let mut figures = vec![
        ("plate", format!("{:.1} mm", mm_from_m(2.0 * coverage.half_side_m))),
        ("centres", format!("{inside} inside, {outside} outside, {translations} translations")),
    ];
    if let Some(gap) = coverage.gap {
        let text =
            format!("{:.1} mm to the nearest centre, from {} mm", mm_from_m(gap.distance_m), shown(gap.position_m));
        figures.push(("largest gap", text));
    }
    if let Some(place) = coverage.weakest() {
        figures.push((
            "weakest place",
            format!("{} mm along {:.0} deg", shown(place.position_m), degrees(place.reach.weakest_direction)),
        ));
        figures.push(("one pulse there", steps(place)));
    }
    figures.push(("longest step", format!("{} in the weakest direction (--picture draws it)", scale(coverage))));
    let unreached = 100.0 * coverage.unreached_share();
    let least = mm_from_m(PlaceReach::LEAST_SHARE * coverage.best_step_m);
    figures.push((
        "out of reach",
        format!("{unreached:.1} % of places (a direction with less than {least:.2} mm a pulse)"),
    ));
    let (idle, all) = (coverage.never_strongest.len(), inside + outside + translations);
    figures.push(("never strongest", format!("{idle} of {all} motions, wherever and whichever way")));
    figures
}

/// Effect of one pulse at a place, as JSON.
pub(super) fn place_json(place: &PlaceReach) -> Value {
    json!({
        "position_mm": position(place.position_m),
        "direction_deg": degrees(place.reach.weakest_direction),
        "share": rounded(place.reach.weakest_projection),
        "longest_step_mm": rounded(mm_from_m(place.reach.longest_step_m)),
        "longest_step_sd_mm": rounded(mm_from_m(place.reach.longest_sd_m)),
        "shortest_step_mm": place.reach.shortest_step_m.map(|step_m| rounded(mm_from_m(step_m))),
    })
}

/// Effect of one pulse at a place in the weakest direction, as text.
pub(super) fn steps(place: &PlaceReach) -> String {
    let (longest, sd) = (mm_from_m(place.reach.longest_step_m), mm_from_m(place.reach.longest_sd_m));
    match place.reach.shortest_step_m {
        Some(shortest_m) => format!("{:.2} to {longest:.2} mm, the longest ± {sd:.2} mm", mm_from_m(shortest_m)),
        None => format!("{longest:.2} ± {sd:.2} mm at most"),
    }
}

/// Range of the longest steps in the weakest direction: `26.15 to 26.88 mm`.
fn scale(coverage: &Coverage) -> String {
    match coverage.steps_m().map(|steps_m| steps_m.map(|step_m| format!("{:.2}", mm_from_m(step_m)))) {
        Some([_, most]) if coverage.is_even() => format!("{most} mm everywhere"),
        Some([least, most]) => format!("{least} to {most} mm"),
        None => "none".into(),
    }
}

fn position(position_m: Vec2) -> [f64; 2] {
    [position_m.x, position_m.y].map(|along_m| rounded(mm_from_m(along_m)))
}

pub(super) fn shown(position_m: Vec2) -> String {
    let [x, y] = position(position_m);
    format!("({x:.1}, {y:.1})")
}

/// Direction modulo its opposite, whole degrees, 0 to 179.
pub(super) fn degrees(direction: Vec2) -> f64 {
    libm::atan2(direction.y, direction.x).to_degrees().round().rem_euclid(180.0)
}

/// Extent of the picture of a coverage, in half sides of the plate from its middle.
const COVERAGE_REACH: f64 = 1.3;

/// Arrows are drawn at every this many places along each axis.
const ARROWS_EVERY: usize = 4;

/// Chart of the plate from above: reach in the weakest direction, centres of rotation, unreachable places.
pub(super) fn coverage_chart(coverage: &Coverage, rig_name: &str) -> Chart {
    let shown_mm = COVERAGE_REACH * mm_from_m(coverage.half_side_m);
    let beyond = coverage.centers_m.iter().filter(|center| mm_from_m(center.amax()) > shown_mm).count();
    let translations = coverage.translations;
    let title = format!("Coverage of {rig_name}; not shown: {beyond} centres farther out, {translations} translations");
    Chart::plate_map(format!("coverage-{rig_name}"), title, Some(shown_mm), coverage_layers(coverage))
}

fn coverage_layers(coverage: &Coverage) -> Vec<Layer> {
    let strongest_m = coverage.steps_m().map_or(0.0, |[_, most_m]| most_m);
    let pitch_mm = 2.0 * mm_from_m(coverage.half_side_m) / coverage.columns as f64;
    let part = |place: &PlaceReach| if strongest_m > 0.0 { place.reach.longest_step_m / strongest_m } else { 0.0 };
    let at = |place: &PlaceReach| at_mm(place.position_m);
    let cells = Mark::Cells { side: pitch_mm, values: coverage.shades() };
    let centers = coverage.centers_m.iter().map(|&center| at_mm(center));
    let unreached = coverage.places.iter().filter(|place| !place.is_reached());
    // with a head at both ends
    let arrows = coarse(coverage).flat_map(|place| {
        let length_mm = 0.42 * ARROWS_EVERY as f64 * pitch_mm * part(place);
        let ahead_mm: [f64; 2] = (place.reach.weakest_direction * length_mm).into();
        [(at(place), ahead_mm), (at(place), ahead_mm.map(|along_mm| -along_mm))]
    });
    let (from, vectors): (Vec<_>, Vec<_>) = arrows.unzip();
    let reach = format!("longest step in the weakest direction, {}", scale(coverage));
    let least = format!("out of reach: below {:.2} mm", mm_from_m(PlaceReach::LEAST_SHARE * coverage.best_step_m));
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

/// Places of a coarser grid about the same middle.
fn coarse(coverage: &Coverage) -> impl Iterator<Item = &PlaceReach> {
    let first = coverage.columns / 2 % ARROWS_EVERY;
    let taken = move |k: usize| k % ARROWS_EVERY == first;
    let columns = coverage.columns.max(1);
    coverage.places.iter().enumerate().filter(move |(i, _)| taken(i / columns) && taken(i % columns)).map(|(_, p)| p)
}

pub(super) fn at_mm(at_m: Vec2) -> [f64; 2] {
    [at_m.x, at_m.y].map(mm_from_m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use upm_runner::run::Reach;

    /// Coverage whose places have these longest steps, m, one row of them.
    fn coverage(steps_m: &[f64]) -> Coverage {
        let place = |&longest_step_m: &f64| PlaceReach {
            position_m: Vec2::zeros(),
            reach: Reach {
                singular_values: [1.0, 1.0],
                weakest_direction: Vec2::x(),
                weakest_projection: longest_step_m / 0.02,
                longest_step_m,
                longest_sd_m: 0.0,
                shortest_step_m: None,
                strongest: Vec::new(),
            },
        };
        Coverage {
            half_side_m: 0.1,
            places: steps_m.iter().map(place).collect(),
            columns: steps_m.len(),
            centers_m: Vec::new(),
            inside: 0,
            outside: 0,
            translations: 2,
            gap: None,
            never_strongest: Vec::new(),
            best_step_m: 0.02,
        }
    }

    #[test]
    fn scale_of_an_even_plate_is_one_number() {
        // the difference is rounding noise, and lies at the edge of two texts
        let even = coverage(&[0.014_145, 0.014_145 + 1e-9, 0.014_145 - 1e-9]);
        assert_eq!(scale(&even), "14.15 mm everywhere");
        assert_eq!(scale(&coverage(&[0.012, 0.014, 0.0135, 0.0001])), "12.00 to 14.00 mm");
    }
}
