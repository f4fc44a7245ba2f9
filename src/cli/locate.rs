use std::io::Cursor;
use std::path::Path;

use image::{ImageReader, Limits};
use serde_json::{Value, json};

use super::args::{Common, LocateArgs};
use super::failure::Failure;
use super::print_json;
use crate::config::RigSpec;
use crate::geometry::{Lens, Vec2};
use crate::rig::PartKind;
use crate::signal::Frame;
use crate::units::{INCH_M, mm_from_m};
use crate::vision::{CoinFinder, Detection, Table, locate_table};

/// Longest side of a picture, px.
const LONGEST_SIDE_PX: u32 = 20_000;
/// Memory a picture may take while it is decoded.
const DECODE_BYTES: u64 = 1 << 30;

/// What the picture is looked at with.
struct Setting {
    lens: Lens,
    plate_side_m: f64,
    kinds: Vec<PartKind>,
    dark_parts: bool,
}

pub(super) fn locate(args: &LocateArgs, common: Common) -> Result<u8, Failure> {
    let frame = read_picture(&args.image)?;
    let setting = match &args.rig {
        Some(path) => from_rig(&RigSpec::load(path).map_err(Failure::faults)?, &frame, &args.image)?,
        None => papers_table(&frame),
    };
    let (table, _) = locate_table(&frame, &setting.lens, setting.plate_side_m)
        .map_err(|fault| Failure::failed(format!("{}: {fault}", args.image.display())))?;
    let size = [frame.width, frame.height];
    let parts = CoinFinder::new(&table, size, &setting.kinds, setting.dark_parts).find(&frame);
    if common.json {
        print_json(&as_json(&table, &parts, &setting.kinds))?;
    } else {
        print_table(&table, &parts, &setting.kinds)?;
    }
    Ok(0)
}

fn read_picture(path: &Path) -> Result<Frame, Failure> {
    let bytes = std::fs::read(path)
        .map_err(|e| Failure::bad_input(format!("{}: found {e}, allowed: a picture", path.display())))?;
    let no_picture = |e: &dyn std::fmt::Display| {
        Failure::bad_input(format!("{}: found no picture ({e}), allowed: PNG, JPEG, PNM or TIFF", path.display()))
    };
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|e| no_picture(&e))?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(LONGEST_SIDE_PX);
    limits.max_image_height = Some(LONGEST_SIDE_PX);
    limits.max_alloc = Some(DECODE_BYTES);
    reader.limits(limits);
    let gray = reader.decode().map_err(|e| no_picture(&e))?.into_luma8();
    let mut frame = Frame::new(0, 0);
    (frame.width, frame.height) = (gray.width() as usize, gray.height() as usize);
    frame.pixels = gray.into_raw();
    Ok(frame)
}

fn from_rig(rig: &RigSpec, frame: &Frame, image: &Path) -> Result<Setting, Failure> {
    let [width, height] = rig.model.frame_size_px;
    if [frame.width, frame.height] != [width, height] {
        return Err(Failure::bad_input(format!(
            "{}: found {}x{} px, allowed: {width}x{height} px, what the camera of rig {} gives",
            image.display(),
            frame.width,
            frame.height,
            rig.model.name
        )));
    }
    Ok(Setting {
        lens: rig.model.lens,
        plate_side_m: rig.model.plate_side_m,
        kinds: rig.kinds.iter().filter(|spec| spec.can_be_seen()).map(|spec| spec.kind.clone()).collect(),
        dark_parts: rig.model.dark_parts,
    })
}

/// The papers' 8x8 in table with pennies, seen through a lens without distortion.
fn papers_table(frame: &Frame) -> Setting {
    let (width, height) = (frame.width as f64, frame.height as f64);
    let center = Vec2::new(0.5 * (width - 1.0), 0.5 * (height - 1.0));
    Setting {
        lens: Lens::ideal(4.0 * width.max(height), center),
        plate_side_m: 8.0 * INCH_M,
        kinds: vec![PartKind { name: "penny".into(), radius_m: 9.525e-3, thickness_m: 1.52e-3 }],
        dark_parts: true,
    }
}

fn as_json(table: &Table, parts: &[Detection], kinds: &[PartKind]) -> Value {
    let parts = parts.iter().map(|part| {
        json!({
            "kind": kinds.get(part.kind).map(|kind| &kind.name),
            "center_px": [part.center_px.x, part.center_px.y],
            "radius_px": part.radius_px,
            "position_mm": [mm_from_m(part.position_m.x), mm_from_m(part.position_m.y)],
            "score": part.score,
        })
    });
    json!({
        "table": {
            "corners_px": table.corners_px.map(|corner| [corner.x, corner.y]),
            "side_px": table.side_px,
            "rotation_deg": table.rotation_rad.to_degrees(),
        },
        "parts": parts.collect::<Vec<_>>(),
    })
}

fn print_table(table: &Table, parts: &[Detection], kinds: &[PartKind]) -> Result<(), Failure> {
    say!("table: side {:.1} px, turned {:.2} deg", table.side_px, table.rotation_rad.to_degrees())?;
    for (name, corner) in ["top left", "top right", "bottom right", "bottom left"].iter().zip(table.corners_px) {
        say!("  {name:12} ({:8.2}, {:8.2}) px", corner.x, corner.y)?;
    }
    say!("parts: {}", parts.len())?;
    for part in parts {
        let (name, at) = (kinds.get(part.kind).map_or("?", |kind| kind.name.as_str()), part.position_m * 1e3);
        let (radius, score) = (part.radius_px, part.score);
        say!("  {name:12} ({:8.2}, {:8.2}) mm   radius {radius:.2} px   score {score:.3}", at.x, at.y)?;
    }
    Ok(())
}
