//! Coverage of a library, as text and as JSON.

use serde_json::{Value, json};

use upm_cor_library::Library;
use upm_core::geometry::Vec2;
use upm_core::units::mm_from_m;
use upm_runner::run::{Coverage, WorstDirection};

/// Coverage of a library and the plate it was measured on.
pub(super) struct CoverageReport {
    /// Name of the rig the library was measured on.
    pub rig_name: String,
    pub coverage: Coverage,
}

impl CoverageReport {
    /// Coverage of the plate that `library` was measured on.
    pub fn by(library: &Library) -> Self {
        Self { rig_name: library.rig.clone(), coverage: Coverage::of(library) }
    }

    /// Text output: figures, then a map.
    pub fn lines(&self) -> Vec<String> {
        let coverage = &self.coverage;
        let mut lines: Vec<String> =
            figures(coverage).into_iter().map(|(label, text)| format!("{label:16} {text}")).collect();
        let unreached = coverage.unreached_share();
        match coverage.steps_m() {
            // one number says as much as a map of equal ones
            Some([least_m, most_m]) if step_text(least_m) == step_text(most_m) && unreached == 0.0 => {
                lines.push(format!("longest step in the weakest direction: {} mm everywhere", step_text(most_m)));
            }
            _ => {
                let out = if unreached > 0.0 { ", ! out of reach" } else { "" };
                lines.push(format!("longest step in the weakest direction, {}{out}:", digits(coverage)));
                lines.extend(map(coverage));
            }
        }
        lines
    }

    /// JSON output; lengths in millimetres.
    pub fn json(&self) -> Value {
        let coverage = &self.coverage;
        let weakest = coverage.weakest().map(place_json);
        let gap = coverage
            .gap
            .map(|gap| json!({ "position_mm": position(gap.position_m), "distance_mm": rounded(mm(gap.distance_m)) }));
        let row =
            |places: &[WorstDirection]| -> Vec<f64> { places.iter().map(|p| rounded(mm(p.longest_step_m))).collect() };
        json!({
            "side_mm": rounded(mm(2.0 * coverage.half_side_m)),
            "centres": {
                "inside": coverage.inside,
                "outside": coverage.outside,
                "translations": coverage.translations,
            },
            "largest_gap": gap,
            "weakest": weakest,
            "best_step_mm": rounded(mm(coverage.best_step_m)),
            "out_of_reach_share": rounded(coverage.unreached_share()),
            "out_of_reach_below_share": WorstDirection::LEAST_SHARE,
            "never_strongest": coverage.never_strongest,
            "longest_step_mm": coverage.places.chunks(coverage.columns).map(row).collect::<Vec<_>>(),
        })
    }
}

fn figures(coverage: &Coverage) -> Vec<(&'static str, String)> {
    let Coverage { inside, outside, translations, .. } = coverage;
    let mut figures = vec![
        ("plate", format!("{:.1} mm", mm(2.0 * coverage.half_side_m))),
        ("centres", format!("{inside} inside, {outside} outside, {translations} translations")),
    ];
    if let Some(gap) = coverage.gap {
        let text = format!("{:.1} mm to the nearest centre, from {} mm", mm(gap.distance_m), shown(gap.position_m));
        figures.push(("largest gap", text));
    }
    if let Some(place) = coverage.weakest() {
        figures.push((
            "weakest place",
            format!("{} mm along {:.0} deg", shown(place.position_m), degrees(place.weakest_direction)),
        ));
        figures.push(("one pulse there", steps(place)));
    }
    let unreached = 100.0 * coverage.unreached_share();
    let least = mm(WorstDirection::LEAST_SHARE * coverage.best_step_m);
    figures.push((
        "out of reach",
        format!("{unreached:.1} % of places (a direction with less than {least:.2} mm a pulse)"),
    ));
    let (idle, all) = (coverage.never_strongest.len(), inside + outside + translations);
    figures.push(("never strongest", format!("{idle} of {all} motions, wherever and whichever way")));
    figures
}

/// Effect of one pulse at a place, as JSON.
pub(super) fn place_json(place: &WorstDirection) -> Value {
    json!({
        "position_mm": position(place.position_m),
        "direction_deg": degrees(place.weakest_direction),
        "share": rounded(place.share),
        "longest_step_mm": rounded(mm(place.longest_step_m)),
        "longest_step_sd_mm": rounded(mm(place.longest_sd_m)),
        "shortest_step_mm": place.shortest_step_m.map(|step_m| rounded(mm(step_m))),
    })
}

/// Effect of one pulse at a place in the weakest direction, as text.
pub(super) fn steps(place: &WorstDirection) -> String {
    let (longest, sd) = (mm(place.longest_step_m), mm(place.longest_sd_m));
    match place.shortest_step_m {
        Some(shortest_m) => format!("{:.2} to {longest:.2} mm, the longest ± {sd:.2} mm", mm(shortest_m)),
        None => format!("{longest:.2} ± {sd:.2} mm at most"),
    }
}

/// A step of one pulse as text, mm.
fn step_text(step_m: f64) -> String {
    format!("{:.2}", mm(step_m))
}

/// Range of the longest steps in the weakest direction: `26.15 to 26.88 mm`.
pub(super) fn scale(coverage: &Coverage) -> String {
    match coverage.steps_m().map(|steps_m| steps_m.map(step_text)) {
        Some([least, most]) if least == most => format!("{most} mm everywhere"),
        Some([least, most]) => format!("{least} to {most} mm"),
        None => "none".into(),
    }
}

/// Meaning of the digits of the map.
fn digits(coverage: &Coverage) -> String {
    match coverage.steps_m().map(|steps_m| steps_m.map(step_text)) {
        Some([least, most]) if least == most => format!("5 for {most} mm"),
        Some([least, most]) => format!("from 0 for {least} mm to 9 for {most} mm"),
        None => "nowhere every direction".into(),
    }
}

/// Map of the plate from above, one character per place.
fn map(coverage: &Coverage) -> impl Iterator<Item = String> {
    let character = move |place: &WorstDirection| {
        let digit = ((10.0 * coverage.shade(place)) as u32).min(9);
        if place.is_reached() { char::from_digit(digit, 10).unwrap_or('?') } else { '!' }
    };
    coverage.places.chunks(coverage.columns).map(move |row| {
        let row: Vec<String> = row.iter().map(|place| character(place).to_string()).collect();
        format!("  {}", row.join(" "))
    })
}

pub(super) fn mm(length_m: f64) -> f64 {
    mm_from_m(length_m)
}

/// `value` rounded to 1e-4, finer than the measurement.
pub(super) fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}

fn position(position_m: Vec2) -> [f64; 2] {
    [position_m.x, position_m.y].map(|along_m| rounded(mm(along_m)))
}

pub(super) fn shown(position_m: Vec2) -> String {
    let [x, y] = position(position_m);
    format!("({x:.1}, {y:.1})")
}

/// Direction modulo its opposite, whole degrees, 0 to 179.
pub(super) fn degrees(direction: Vec2) -> f64 {
    direction.y.atan2(direction.x).to_degrees().round().rem_euclid(180.0)
}
