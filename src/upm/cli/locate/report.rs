//! Report of a picture's table and parts, as JSON and as text.

use std::path::Path;

use serde::Serialize;
use serde_json::{Value, json};

use super::doubts::{about_others, about_side, no_parts_message, suggestion};
use super::naming::{NamedPart, OtherDisc, RejectionReason};
use super::scale::PlateSide;
use super::setup::LocateSetup;
use crate::cli::output::Failure;
use upm_core::signal::Frame;
use upm_core::units::mm_from_m;
use upm_perception::vision::{DebugImages, Detection, Survey, Table};

/// Table and parts found in a picture.
pub(super) struct Localised {
    pub frame: Frame,
    pub table: Table,
    pub detections: Vec<Detection>,
    /// The intermediate stages of the search.
    pub stages: DebugImages,
}

/// Result of the search of one picture.
pub(super) struct LocatedPicture {
    pub found: Localised,
    pub time_us: TimeUs,
    /// The parts of `found`, with the doubts about each.
    pub parts: Vec<NamedPart>,
    /// Discs that are not parts.
    pub others: Vec<OtherDisc>,
    pub survey: Survey,
    pub side: PlateSide,
}

/// Wall times of one picture, µs.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct TimeUs {
    /// Time to read and decode the file.
    pub decode: f64,
    pub table: f64,
    /// Time to find the parts, all preparation included.
    pub parts: f64,
    /// Time to find discs of any size, measure outlines and name them.
    pub survey: f64,
}

pub(super) fn as_json(located: &LocatedPicture, setting: &LocateSetup) -> Value {
    let LocatedPicture { found: Localised { table, .. }, time_us, side, survey, .. } = located;
    let parts: Vec<Value> = located.parts.iter().map(|named| part_json(named, setting)).collect();
    let others: Vec<Value> = located.others.iter().map(|other| other_json(other, setting)).collect();
    let candidates = side.candidates.iter().map(
        |candidate| json!({ "side_mm": mm_from_m(candidate.side_m), "kinds": setting.known_names(&candidate.kinds) }),
    );
    json!({
        "table": {
            "corners_px": table.corners_px.map(|corner| [corner.x, corner.y]),
            "side_px": table.side_px,
            "rotation_deg": table.rotation_rad.to_degrees(),
        },
        "plate": {
            "side_mm": mm_from_m(side.side_m),
            "source": side.source,
            "candidates": candidates.collect::<Vec<_>>(),
        },
        "parts": parts,
        "others": others,
        "contrast": { "darkest": survey.darkest, "lightest": survey.lightest },
        "time_us": time_us,
    })
}

fn part_json(NamedPart { part, diameter_m, doubts }: &NamedPart, setting: &LocateSetup) -> Value {
    let [[xx, xy], [_, yy]] = part.covariance_px2.into();
    json!({
        "kind": setting.kind_name(part.kind),
        "center_px": [part.center_px.x, part.center_px.y],
        "radius_px": part.radius_px,
        "position_mm": [mm_from_m(part.position_m.x), mm_from_m(part.position_m.y)],
        "diameter_mm": mm_from_m(*diameter_m),
        "score": part.score,
        "doubts": doubts,
        "covariance_px2": [[xx, xy], [xy, yy]],
    })
}

fn other_json(OtherDisc { disc, why }: &OtherDisc, setting: &LocateSetup) -> Value {
    let (why_code, kind) = match why {
        RejectionReason::NotLookedFor { kind } => ("not_looked_for", Some(kind)),
        RejectionReason::OtherPolarity { kind } => ("other_polarity", kind.as_ref()),
        RejectionReason::Unclear { kind } => ("unclear", Some(kind)),
        RejectionReason::UnknownSize => ("unknown_size", None),
    };
    json!({
        "diameter_mm": 2.0 * mm_from_m(disc.radius_m),
        "center_px": [disc.center_px.x, disc.center_px.y],
        "radius_px": disc.radius_px,
        "position_mm": [mm_from_m(disc.at_m.x), mm_from_m(disc.at_m.y)],
        "level": disc.level,
        "outline_share": disc.outline_share,
        "reason": why_code,
        "like": kind,
        "option": suggestion(why, setting),
    })
}

/// Prints `value` on one line that begins with the picture's name.
pub(super) fn print_line(image: &Path, value: Value) -> Result<(), Failure> {
    let mut line = serde_json::Map::from_iter([("image".to_owned(), json!(image.display().to_string()))]);
    if let Value::Object(found) = value {
        line.extend(found);
    }
    outln!("{}", Value::Object(line))
}

pub(super) fn print_located(located: &LocatedPicture, setting: &LocateSetup) -> Result<(), Failure> {
    let LocatedPicture { found: Localised { table, .. }, time_us, parts, .. } = located;
    outln!("table: side {:.1} px, turned {:.2} deg", table.side_px, table.rotation_rad.to_degrees())?;
    for (name, corner) in ["top left", "top right", "bottom right", "bottom left"].iter().zip(table.corners_px) {
        outln!("  {name:12} ({:8.2}, {:8.2}) px", corner.x, corner.y)?;
    }
    about_side(&located.side).into_iter().try_for_each(|line| outln!("{line}"))?;
    outln!("parts: {}", parts.len())?;
    for NamedPart { part, doubts, .. } in parts {
        let (name, at) = (setting.kind_name(part.kind), part.position_m * 1e3);
        let (radius, score) = (part.radius_px, part.score);
        let doubts = if doubts.is_empty() { String::new() } else { format!(": {}", doubts.join(", ")) };
        outln!("  {name:12} ({:8.2}, {:8.2}) mm   radius {radius:.2} px   score {score:.3}{doubts}", at.x, at.y)?;
    }
    if parts.is_empty() {
        outln!("{}", no_parts_message(&located.others, &located.survey))?;
    }
    about_others(&located.others, setting).into_iter().try_for_each(|line| outln!("{line}"))?;
    let TimeUs { decode, table, parts, survey } = time_us;
    let [decode, table, parts, survey] = [decode, table, parts, survey].map(|us| us / 1e3);
    outln!(
        "found: {} in {:.1} ms (table {table:.1}, parts {parts:.1}, survey {survey:.1}); decoded in {decode:.1} ms",
        counted(located, setting),
        table + parts + survey
    )
}

/// Summary with every kind that was looked for: `a table, 3 penny, 1 dime`.
fn counted(located: &LocatedPicture, setting: &LocateSetup) -> String {
    let count = |i| located.found.detections.iter().filter(|part| part.kind == i).count();
    let counts = setting.kinds.iter().enumerate().map(|(i, kind)| format!(", {} {}", count(i), kind.name));
    format!("a table{}", counts.collect::<String>())
}
