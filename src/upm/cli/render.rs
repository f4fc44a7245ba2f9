use std::fs;

use image::GrayImage;
use serde_json::{Value, json};

use super::args::{Common, RenderArgs};
use super::output::{Failure, check_ending, print_json};
use upm_core::units::mm_from_m;
use upm_runner::config::JobSpec;
use upm_runner::run::{FirstFrame, TruePart, first_frame};

/// Supported file name extensions of pictures.
const PICTURES: [&str; 6] = ["png", "jpg", "jpeg", "pgm", "tif", "tiff"];

pub(super) fn render(args: &RenderArgs, common: Common) -> Result<u8, Failure> {
    check_ending("--out", &args.out, &PICTURES)?;
    let mut job = JobSpec::load(&args.job).map_err(Failure::of_files)?;
    if let Some(seed) = args.seed {
        job = job.with_seed(seed);
    }
    let first = first_frame(&job)?;
    let (truth, frame) = (truth(&first), first.frame);
    GrayImage::from_raw(frame.width as u32, frame.height as u32, frame.pixels)
        .ok_or_else(|| Failure::failed("the camera's frame has no picture"))?
        .save(&args.out)
        .map_err(|error| Failure::write_picture(&args.out, error))?;
    if let Some(path) = &args.truth {
        fs::write(path, format!("{truth:#}\n")).map_err(|error| Failure::write(path, error))?;
    }
    if common.json {
        print_json(&truth)?;
    }
    Ok(0)
}

fn truth(first: &FirstFrame) -> Value {
    let part = |TruePart { id, kind, position_m, foot_px }: &TruePart| {
        let position_mm = position_m.map(mm_from_m);
        json!({ "id": id, "kind": kind, "position_mm": position_mm.as_slice(), "foot_px": foot_px.as_slice() })
    };
    let corners_px = first.corners_px.map(|corner| [corner.x, corner.y]);
    json!({ "table": { "corners_px": corners_px }, "parts": first.parts.iter().map(part).collect::<Vec<_>>() })
}
