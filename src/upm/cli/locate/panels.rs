//! Five pictures of the stages of the search for table and parts.

use std::path::{Path, PathBuf};

use image::imageops::{FilterType, resize};
use image::{DynamicImage, GrayImage, Rgb, RgbImage};
use imageproc::drawing::{draw_antialiased_line_segment_mut, draw_hollow_circle_mut};
use imageproc::pixelops::interpolate;

use super::maps::{edge_map, response_map, vote_map};
use super::report::Localised;
use crate::cli::output::Failure;
use upm_chart::{Ground, Palette};
use upm_core::geometry::Vec2;
use upm_core::signal::Frame;
use upm_perception::vision::{DebugImages, HoughArray};
use upm_recording::outline_px;

/// Largest size of the vote map, to which it is scaled down, px.
const VOTES_PX: [usize; 2] = [720, 720];
/// Width to which a smaller vote map is scaled up approximately, px.
const VOTES_WIDE_PX: u32 = 1080;
/// Colour of results other than parts.
const FOUND: [u8; 3] = [90, 225, 120];
/// Colour of peaks, visible on yellow.
const PEAK: [u8; 3] = [30, 130, 255];

/// Writes the panels into `folder`; `kinds` are those of the parts. Returns the paths.
pub(super) fn write(folder: &Path, found: &Localised, kinds: &[&str]) -> Result<Vec<PathBuf>, Failure> {
    let size = [found.frame.width, found.frame.height];
    let overlay = overlay(found, kinds, DynamicImage::from(picture(&found.frame)).into_rgb8());
    let response = response(found, response_map(&found.stages.disk_response, size));
    let mut panels = begun(&found.frame, &found.stages);
    panels.push(("4-disk-response.png", response.into()));
    panels.push(("5-overlay.png", overlay.into()));
    save(folder, panels)
}

/// Writes the panels of a picture without a table: the first three, or two if no edge was found.
pub(super) fn write_begun(folder: &Path, frame: &Frame, stages: &DebugImages) -> Result<Vec<PathBuf>, Failure> {
    save(folder, begun(frame, stages))
}

type Panel = (&'static str, DynamicImage);

fn begun(frame: &Frame, stages: &DebugImages) -> Vec<Panel> {
    let edges = edge_map(&stages.edges, [frame.width, frame.height]);
    let mut panels: Vec<Panel> = vec![("1-picture.png", picture(frame).into()), ("2-edges.png", edges.into())];
    if !stages.hough.votes.is_empty() {
        panels.push(("3-hough.png", hough(&stages.hough).into()));
    }
    panels
}

fn save(folder: &Path, panels: Vec<Panel>) -> Result<Vec<PathBuf>, Failure> {
    std::fs::create_dir_all(folder).map_err(|error| Failure::write(folder, error))?;
    let write = |(name, panel): Panel| {
        let path = folder.join(name);
        panel.save(&path).map_err(|error| Failure::write_picture(&path, error)).map(|()| path)
    };
    panels.into_iter().map(write).collect()
}

fn picture(frame: &Frame) -> GrayImage {
    GrayImage::from_raw(frame.width as u32, frame.height as u32, frame.pixels.clone()).unwrap_or_default()
}

fn hough(votes: &HoughArray) -> RgbImage {
    let map = vote_map(votes, VOTES_PX);
    let (width, height) = map.picture.dimensions();
    let larger = (VOTES_WIDE_PX / width.max(1)).max(1);
    let mut picture = resize(&map.picture, larger * width, larger * height, FilterType::Nearest);
    for [x, y] in map.peaks {
        circle(&mut picture, Vec2::new(f64::from(x), f64::from(y)) * f64::from(larger), 9.0 * f64::from(larger), FOUND);
    }
    picture
}

fn response(found: &Localised, mut map: RgbImage) -> RgbImage {
    for part in &found.detections {
        circle(&mut map, part.center_px, 8.0, PEAK);
    }
    map
}

/// Overlay of the table's outline and corners, and of each part's outline and centre in its kind's colour.
fn overlay(found: &Localised, kinds: &[&str], mut picture: RgbImage) -> RgbImage {
    let palette = Palette::of(kinds, Ground::Dark);
    for (a, b) in outline_px(&found.table).zip(outline_px(&found.table).skip(1)) {
        let [a, b] = [a, b].map(|at| (at.x.round() as i32, at.y.round() as i32));
        draw_antialiased_line_segment_mut(&mut picture, a, b, Rgb(FOUND), interpolate);
    }
    for corner in found.table.corners_px {
        circle(&mut picture, corner, 8.0, FOUND);
    }
    for (part, kind) in found.detections.iter().zip(kinds) {
        let color = palette.kind(kind).unwrap_or(FOUND);
        circle(&mut picture, part.center_px, part.radius_px, color);
        circle(&mut picture, part.center_px, 1.0, color);
    }
    picture
}

/// Draws a circle, two pixels wide.
fn circle(picture: &mut RgbImage, center: Vec2, radius: f64, color: [u8; 3]) {
    let (center, radius) = ((center.x.round() as i32, center.y.round() as i32), radius.round() as i32);
    draw_hollow_circle_mut(picture, center, radius, Rgb(color));
    draw_hollow_circle_mut(picture, center, radius + 1, Rgb(color));
}
