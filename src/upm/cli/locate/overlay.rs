//! Plate, parts and other discs, drawn over a picture.

use std::path::{Path, PathBuf};

use image::{DynamicImage, GrayImage, Rgb, RgbImage};
use imageproc::drawing::{draw_antialiased_line_segment_mut, draw_hollow_circle_mut};
use imageproc::pixelops::interpolate;

use super::search::LocatedPicture;
use super::setup::LocateSetup;
use crate::cli::output::Failure;
use upm_chart::{Ground, Palette};
use upm_core::geometry::Vec2;
use upm_recording::outline_px;

/// Colours of the plate and of discs that are not parts.
const PLATE: [u8; 3] = [90, 225, 120];
const OTHER: [u8; 3] = [150, 150, 150];

/// Draws what was found in `image` into a PNG file of its name in `folder`; returns its path.
pub(super) fn write(
    folder: &Path,
    image: &Path,
    located: &LocatedPicture,
    setting: &LocateSetup,
) -> Result<PathBuf, Failure> {
    let LocatedPicture { frame, table, parts, others, .. } = located;
    let gray = GrayImage::from_raw(frame.width as u32, frame.height as u32, frame.pixels.clone()).unwrap_or_default();
    let mut picture = DynamicImage::from(gray).into_rgb8();
    for (a, b) in outline_px(table).zip(outline_px(table).skip(1)) {
        let [a, b] = [a, b].map(|at| (at.x.round() as i32, at.y.round() as i32));
        draw_antialiased_line_segment_mut(&mut picture, a, b, Rgb(PLATE), interpolate);
    }
    let kinds: Vec<&str> = parts.iter().map(|part| setting.known[part.kind].name.as_str()).collect();
    let palette = Palette::of(&kinds, Ground::Dark);
    for (part, kind) in parts.iter().zip(&kinds) {
        circle(&mut picture, part.disc.center_px, part.disc.radius_px, palette.kind(kind).unwrap_or(PLATE));
    }
    others.iter().for_each(|other| circle(&mut picture, other.disc.center_px, other.disc.radius_px, OTHER));
    std::fs::create_dir_all(folder).map_err(|error| Failure::write(folder, error))?;
    let path = folder.join(image.file_stem().unwrap_or_default()).with_added_extension("png");
    picture.save(&path).map_err(|error| Failure::write_picture(&path, error))?;
    Ok(path)
}

/// Draws a circle, two pixels wide.
fn circle(picture: &mut RgbImage, center: Vec2, radius: f64, color: [u8; 3]) {
    let (center, radius) = ((center.x.round() as i32, center.y.round() as i32), radius.round() as i32);
    draw_hollow_circle_mut(picture, center, radius, Rgb(color));
    draw_hollow_circle_mut(picture, center, radius + 1, Rgb(color));
}
