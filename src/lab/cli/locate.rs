//! Table and parts of a picture by the reference vision, or by the control loop's for comparison.

use serde_json::json;

use super::args::LocateArgs;
use super::failure::Failure;
use crate::reference::{find_parts, locate_table};
use upm_core::geometry::Lens;
use upm_core::rig::{PartKind, RigModel};
use upm_core::signal::Frame;
use upm_core::time::{Clock, MonotonicClock};
use upm_core::units::mm_from_m;
use upm_perception::vision::{self, CoinFinder, Detection, Table};
use upm_runner::config::{RigSpec, one_of};

/// Focal length of a camera without a rig file, in longer sides of the picture: a distant one.
const FOCAL_SIDES: f64 = 4.0;

/// Finds table and parts; returns them as text, or as JSON like that of `upm locate`.
pub fn locate(args: &LocateArgs, json: bool) -> Result<String, Failure> {
    let rig = args.rig.as_deref().map_or_else(RigSpec::upm_1, RigSpec::load).map_err(Failure::of_files)?;
    let names: Vec<&str> = rig.kinds.iter().map(|spec| spec.kind.name.as_str()).collect();
    if let Some(name) = args.kinds.iter().find(|name| !names.contains(&name.as_str())) {
        return Err(Failure::bad_input(format!("--kinds: expected {}, found {name:?}", one_of(name, &names))));
    }
    let is_wanted = |kind: &&PartKind| args.kinds.is_empty() || args.kinds.contains(&kind.name);
    let kinds: Vec<PartKind> = rig.kinds.iter().map(|spec| &spec.kind).filter(is_wanted).cloned().collect();

    let image = args.image.display();
    let gray = image::open(&args.image).map_err(|error| Failure::bad_input(format!("cannot read {image}: {error}")))?;
    let gray = gray.into_luma8();
    let frame = Frame::of_picture(gray.width() as usize, gray.height() as usize, gray.into_raw());
    let frame = frame.ok_or_else(|| Failure::bad_input(format!("{image}: expected a picture, found no pixels")))?;
    let lens =
        if args.rig.is_some() { rig.model.lens } else { Lens::centered([frame.width, frame.height], FOCAL_SIDES) };

    let looked = match args.fast {
        Some(times) => fast(&frame, &lens, &rig.model, &kinds, times),
        None => reference(&frame, &lens, &rig.model, &kinds),
    };
    let (table, parts, [table_us, parts_us]) = looked.map_err(|fault| Failure::failed(format!("{image}: {fault}")))?;
    let rows = parts.iter().map(|part| {
        json!({
            "kind": kinds[part.kind].name,
            "center_px": [part.center_px.x, part.center_px.y],
            "radius_px": part.radius_px,
            "position_mm": [mm_from_m(part.position_m.x), mm_from_m(part.position_m.y)],
            "score": part.score,
        })
    });
    let found = json!({
        "table": { "corners_px": table.corners_px.map(|corner| [corner.x, corner.y]) },
        "parts": rows.collect::<Vec<_>>(),
        "time_us": { "table": table_us, "parts": parts_us },
    });
    if json {
        return Ok(format!("{found:#}"));
    }
    let corners = table.corners_px.map(|corner| format!("corner ({:8.2}, {:8.2}) px", corner.x, corner.y));
    let parts = parts.iter().map(|part| {
        let (name, at) = (&kinds[part.kind].name, part.position_m.map(mm_from_m));
        format!("{name:12} ({:8.2}, {:8.2}) mm   radius {:.2} px   score {:.3}", at.x, at.y, part.radius_px, part.score)
    });
    Ok(corners.into_iter().chain(parts).collect::<Vec<_>>().join("\n"))
}

/// Table, parts, and the times for both, µs.
type Looked = Result<(Table, Vec<Detection>, [f64; 2]), String>;

fn reference(frame: &Frame, lens: &Lens, rig: &RigModel, kinds: &[PartKind]) -> Looked {
    let clock = MonotonicClock::new();
    let view = locate_table(frame, lens, rig.plate_side_m).map_err(|fault| fault.to_string())?;
    let table_us = 1e6 * clock.elapsed().as_secs_f64();
    let parts = find_parts(&view, kinds, rig.dark_parts);
    Ok((view.table, parts, [table_us, 1e6 * clock.elapsed().as_secs_f64() - table_us]))
}

fn fast(frame: &Frame, lens: &Lens, rig: &RigModel, kinds: &[PartKind], times: u32) -> Looked {
    let look = || {
        let clock = MonotonicClock::new();
        let table = vision::locate_table(frame, lens, rig.plate_side_m).map_err(|fault| fault.to_string())?;
        let table_us = 1e6 * clock.elapsed().as_secs_f64();
        let parts = CoinFinder::new(&table, [frame.width, frame.height], kinds, rig.dark_parts).find(frame);
        Ok((table, parts, [table_us, 1e6 * clock.elapsed().as_secs_f64() - table_us]))
    };
    let mut looks = (0..times).map(|_| look()).collect::<Result<Vec<_>, String>>()?.split_off(1);
    looks.sort_by(|a, b| a.2.iter().sum::<f64>().total_cmp(&b.2.iter().sum()));
    let middle = looks.len() / 2;
    Ok(looks.swap_remove(middle))
}
