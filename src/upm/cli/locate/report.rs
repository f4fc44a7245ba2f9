//! Report of a picture's plane and parts, as JSON and as text.

use std::path::Path;

use serde_json::{Value, json};

use super::naming::{NamedPart, OtherDisc};
use super::scale::{PictureScale, ScaleSource};
use super::search::LocatedPicture;
use super::setup::{LocateSetup, Plane};
use crate::cli::output::Failure;
use upm_core::document::counted;
use upm_core::rig::PartKind;
use upm_core::units::mm_from_m;

/// Relative difference in diameter below which discs are grouped.
const ONE_SIZE: f64 = 0.03;

pub(super) fn as_json(located: &LocatedPicture, setting: &LocateSetup) -> Value {
    let LocatedPicture { table, scale, time_us, .. } = located;
    let parts: Vec<Value> = located.parts.iter().map(|named| part_json(named, setting)).collect();
    let others: Vec<Value> = located.others.iter().map(|other| other_json(other, setting)).collect();
    json!({
        "table": {
            "corners_px": table.corners_px.map(|corner| [corner.x, corner.y]),
            "side_px": table.side_px,
            "rotation_deg": table.rotation_rad.to_degrees(),
            "tilt_deg": table.tilt_rad().to_degrees(),
            "focal_px": table.lens.focal_px,
        },
        "plate": {
            "side_mm": mm_from_m(table.side_m),
            "height_mm": mm_from_m(table.side_m * table.aspect),
            "source": scale.source,
            "doubt": scale.doubt,
        },
        "parts": parts,
        "others": others,
        "time_us": time_us,
    })
}

fn part_json(part: &NamedPart, setting: &LocateSetup) -> Value {
    json!({
        "kind": setting.known[part.kind].name,
        "center_px": [part.disc.center_px.x, part.disc.center_px.y],
        "radius_px": part.disc.radius_px,
        "position_mm": [mm_from_m(part.foot_m.x), mm_from_m(part.foot_m.y)],
        "diameter_mm": 2.0 * mm_from_m(part.disc.radius_m),
        "score": part.score,
        "doubts": part.doubts,
    })
}

fn other_json(other @ OtherDisc { disc, like }: &OtherDisc, setting: &LocateSetup) -> Value {
    json!({
        "diameter_mm": 2.0 * mm_from_m(disc.radius_m),
        "center_px": [disc.center_px.x, disc.center_px.y],
        "radius_px": disc.radius_px,
        "position_mm": [mm_from_m(disc.at_m.x), mm_from_m(disc.at_m.y)],
        "outline_share": disc.outline_share,
        "reason": match like {
            None => "unknown_size",
            Some(kind) if setting.wanted[*kind] => "unclear",
            Some(_) => "not_looked_for",
        },
        "like": like.map(|kind| &setting.known[kind].name),
        "option": option_for(other, setting),
    })
}

/// Prints `value`, an object, on one line with the picture's name.
pub(super) fn print_line(image: &Path, mut value: Value) -> Result<(), Failure> {
    value["image"] = image.display().to_string().into();
    outln!("{value}")
}

pub(super) fn print_located(located: &LocatedPicture, setting: &LocateSetup) -> Result<(), Failure> {
    let LocatedPicture { table, scale, time_us, parts, others, .. } = located;
    let tilt_deg = table.tilt_rad().to_degrees();
    if matches!(setting.plane, Plane::Whole) {
        outln!("camera: tilted by {tilt_deg:.1} deg")?;
    } else {
        outln!("table: side {:.1} px, turned {:.2} deg", table.side_px, table.rotation_rad.to_degrees())?;
        for (name, corner) in ["top left", "top right", "bottom right", "bottom left"].iter().zip(table.corners_px) {
            outln!("  {name:12} ({:8.2}, {:8.2}) px", corner.x, corner.y)?;
        }
    }
    let [side_mm, height_mm] = [1.0, table.aspect].map(|share| mm_from_m(share * table.side_m));
    about_scale(scale, [side_mm, height_mm]).into_iter().try_for_each(|line| outln!("{line}"))?;
    outln!("parts: {}", parts.len())?;
    for NamedPart { disc, kind, foot_m, score, doubts } in parts {
        let (name, at, radius) = (&setting.known[*kind].name, foot_m * 1e3, disc.radius_px);
        let doubts = if doubts.is_empty() { String::new() } else { format!(": {}", doubts.join(", ")) };
        outln!("  {name:12} ({:8.2}, {:8.2}) mm   radius {radius:.2} px   score {score:.3}{doubts}", at.x, at.y)?;
    }
    if parts.is_empty() {
        outln!("no parts: {} found", counted(others.len(), "disc"))?;
    }
    about_others(others, setting).into_iter().try_for_each(|line| outln!("{line}"))?;
    let [decode, table, parts] = [time_us.decode, time_us.table, time_us.parts].map(|us| us / 1e3);
    outln!("time: decoding {decode:.1} ms, table {table:.1} ms, parts {parts:.1} ms")
}

/// Basis of the scale where neither the command line nor a rig gives it.
fn about_scale(scale: &PictureScale, [side_mm, height_mm]: [f64; 2]) -> Option<String> {
    let basis = match scale.source {
        ScaleSource::Given | ScaleSource::Rig => return None,
        ScaleSource::Part => ", from the part named",
        ScaleSource::Parts | ScaleSource::TwoKinds => ", from the ratio of the parts' sizes",
        ScaleSource::Assumed => " assumed; --plate-side-mm, --scale or --scale-from gives it",
    };
    let doubt = scale.doubt.as_ref().map_or(String::new(), |doubt| format!("; {doubt}"));
    Some(format!("plate: {side_mm:.1} x {height_mm:.1} mm{basis}{doubt}"))
}

/// One line for each group of similar discs that are not parts.
fn about_others(others: &[OtherDisc], setting: &LocateSetup) -> Vec<String> {
    let mut sorted: Vec<&OtherDisc> = others.iter().collect();
    sorted.sort_by(|a, b| a.disc.radius_m.total_cmp(&b.disc.radius_m));
    let alike = |a: &&OtherDisc, b: &&OtherDisc| a.like == b.like && b.disc.radius_m / a.disc.radius_m - 1.0 < ONE_SIZE;
    sorted.chunk_by(alike).filter_map(|group| about(group, setting)).collect()
}

fn about(group: &[&OtherDisc], setting: &LocateSetup) -> Option<String> {
    let middle = group.get(group.len() / 2)?;
    let size = format!("{} of {:.1} mm", counted(group.len(), "disc"), 2.0 * mm_from_m(middle.disc.radius_m));
    let name = |kind: usize| &setting.known[kind].name;
    Some(match (middle.like, option_for(middle, setting)) {
        (Some(kind), Some(option)) => format!("{size}: {}? use {option}", name(kind)),
        (Some(kind), None) => format!("{size}: {}? size or rim do not fit well enough to say", name(kind)),
        (None, _) => {
            let known = |kind: &PartKind| format!("{} {:.2}", kind.name, 2.0 * mm_from_m(kind.radius_m));
            let known: Vec<String> = setting.known.iter().map(known).collect();
            format!("{size}: no known kind ({})", known.join(", "))
        }
    })
}

/// Command line option with which such a disc would be named.
fn option_for(other: &OtherDisc, setting: &LocateSetup) -> Option<String> {
    let like = other.like.filter(|kind| !setting.wanted[*kind])?;
    let named = (0..setting.known.len()).filter(|kind| setting.wanted[*kind]).chain([like]);
    let names: Vec<&str> = named.map(|kind| setting.known[kind].name.as_str()).collect();
    Some(format!("--kinds {}", names.join(",")))
}
