//! Five pictures of the stages of the search for table and parts.

use std::path::{Path, PathBuf};

use image::imageops::{FilterType, resize};
use image::{DynamicImage, GrayImage, Rgb, RgbImage};
use imageproc::drawing::{draw_antialiased_line_segment_mut, draw_hollow_circle_mut};
use imageproc::pixelops::interpolate;

use super::report::Localised;
use crate::cli::output::Failure;
use upm_chart::{Ground, Palette};
use upm_core::geometry::Vec2;
use upm_core::signal::Frame;
use upm_perception::vision::{DebugImages, FloatImage, HoughArray};
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

/// Edges in gray over a frame of `frame_size` (columns, rows). A tenth of the edges, the strongest, are white.
fn edge_map(edges: &FloatImage, frame_size: [usize; 2]) -> GrayImage {
    let map = laid_over(edges, frame_size);
    let strong = quantile(&map.values, 0.9);
    let pixels = map.values.iter().map(|&value| (255.0 * share(value, strong)) as u8).collect();
    GrayImage::from_raw(map.width as u32, map.height as u32, pixels).unwrap_or_default()
}

/// The disk kernel's response in heat colours, from 0 to 1, over a frame as in [`edge_map`].
fn response_map(response: &FloatImage, frame_size: [usize; 2]) -> RgbImage {
    heat_map(&laid_over(response, frame_size), 1.0)
}

/// Hough votes in heat colours, angles to the right and distances down.
struct VoteMap {
    /// The votes; rows beyond the farthest line are omitted.
    picture: RgbImage,
    /// Centres of the peaks' cells, px; the first pixel covers 0 to 1.
    peaks: Vec<[f32; 2]>,
}

/// Hough votes, shrunk to at most `most` px. The first column is an eighth of a turn before angle 0, so that the four
/// lines of an upright table are well inside.
fn vote_map(hough: &HoughArray, most: [usize; 2]) -> VoteMap {
    let last = hough.votes.iter().rposition(|&votes| votes > 0.0).unwrap_or(0);
    let rows = (last / hough.angles.max(1) + 1).min(hough.distances);
    let eighth = hough.angles / 8;
    let mut votes = FloatImage { width: hough.angles, height: rows, values: hough.votes.clone() };
    votes.values.chunks_exact_mut(hough.angles.max(1)).for_each(|row| row.rotate_right(eighth));
    // logarithmic, so that four strong lines do not hide the rest
    votes.values.iter_mut().for_each(|votes| *votes = votes.max(0.0).ln_1p());
    let shrink = [votes.width.div_ceil(most[0].max(1)).max(1), votes.height.div_ceil(most[1].max(1)).max(1)];
    let map = pooled(&votes, shrink);
    let top = map.values.iter().copied().fold(0.0, f32::max);
    let middle = |cell: usize, shrink: usize| (cell as f32 + 0.5) / shrink as f32;
    let shown = |&(column, row): &(usize, usize)| {
        [middle((column + eighth) % hough.angles.max(1), shrink[0]), middle(row, shrink[1])]
    };
    VoteMap { picture: heat_map(&map, top), peaks: hough.peaks.iter().map(shown).collect() }
}

/// `plane` over a frame of that size: one value of it may cover a square of the frame's pixels.
fn laid_over(plane: &FloatImage, [width, height]: [usize; 2]) -> FloatImage {
    if plane.values.is_empty() {
        return FloatImage::default();
    }
    let square = (width / plane.width).max(1);
    let value = |x: usize, y: usize| {
        let [column, row] = [(x, plane.width), (y, plane.height)].map(|(at, size)| (at / square).min(size - 1));
        plane.values.get(row * plane.width + column).copied().unwrap_or_default()
    };
    let values = (0..width * height).map(|i| value(i % width, i / width)).collect();
    FloatImage { width, height, values }
}

/// The largest value of every cell of this many columns and rows, so that thin lines and sharp peaks survive shrinking.
fn pooled(plane: &FloatImage, [columns, rows]: [usize; 2]) -> FloatImage {
    let (columns, rows) = (columns.max(1), rows.max(1));
    let (width, height) = (plane.width.div_ceil(columns), plane.height.div_ceil(rows));
    let mut values = vec![0.0_f32; width * height];
    for (y, row) in plane.values.chunks_exact(plane.width.max(1)).take(plane.height).enumerate() {
        let out = &mut values[y / rows * width..][..width];
        for (cell, inside) in out.iter_mut().zip(row.chunks(columns)) {
            *cell = inside.iter().copied().fold(*cell, f32::max);
        }
    }
    FloatImage { width, height, values }
}

/// Values from 0 to `top` in colours from black over purple, red and orange to pale yellow.
fn heat_map(map: &FloatImage, top: f32) -> RgbImage {
    let pixels = map.values.iter().flat_map(|&value| heat(share(value, top))).collect();
    RgbImage::from_raw(map.width as u32, map.height as u32, pixels).unwrap_or_default()
}

fn share(value: f32, top: f32) -> f32 {
    if top > 0.0 { (value / top).clamp(0.0, 1.0) } else { 0.0 }
}

/// Linear interpolation between five colours of matplotlib's `inferno`.
fn heat(share: f32) -> [u8; 3] {
    const STOPS: [[f32; 3]; 5] =
        [[0.0, 0.0, 4.0], [87.0, 16.0, 110.0], [188.0, 55.0, 84.0], [249.0, 142.0, 9.0], [252.0, 255.0, 164.0]];
    let place = share * 4.0;
    let stop = (place as usize).min(3);
    let t = place - stop as f32;
    std::array::from_fn(|c| (STOPS[stop][c] * (1.0 - t) + STOPS[stop + 1][c] * t) as u8)
}

/// The `q` quantile of all positive values; 0 when there are none.
fn quantile(values: &[f32], q: f64) -> f32 {
    let mut positive: Vec<f32> = values.iter().copied().filter(|&value| value > 0.0).collect();
    let rank = (positive.len() as f64 * q) as usize;
    if rank >= positive.len() {
        return 0.0;
    }
    *positive.select_nth_unstable_by(rank, f32::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(width: usize, height: usize) -> FloatImage {
        FloatImage { width, height, values: (0..width * height).map(|i| i as f32).collect() }
    }

    #[test]
    fn a_coarse_plane_covers_its_frame() {
        // 2 x 2 pixels per value; the last column and row of the frame are beyond them
        let over = laid_over(&plane(2, 1), [5, 3]);
        assert_eq!((over.width, over.height), (5, 3));
        assert_eq!(over.values, [0.0, 0.0, 1.0, 1.0, 1.0].repeat(3));
        assert_eq!(laid_over(&plane(5, 3), [5, 3]), plane(5, 3));
        assert_eq!(laid_over(&FloatImage::default(), [5, 3]), FloatImage::default());
    }

    #[test]
    fn peaks_are_at_the_pixels_of_their_cells() {
        let mut hough =
            HoughArray { angles: 8, distances: 9, px_per_row: 1.0, votes: vec![0.0; 72], peaks: vec![(5, 2), (7, 3)] };
        hough.votes[2 * 8 + 5] = 99.0;
        hough.votes[3 * 8 + 7] = 9.0;
        let map = vote_map(&hough, [4, 9]);
        assert_eq!(map.picture.dimensions(), (4, 4));
        assert_eq!(map.peaks, [[3.25, 2.5], [0.25, 3.5]]);
        assert_eq!(map.picture.get_pixel(3, 2).0, heat(1.0));
        let half = map.picture.get_pixel(0, 3).0;
        assert!((0..3).all(|c| half[c].abs_diff(heat(0.5)[c]) <= 1), "{half:?}");
        assert_eq!(map.picture.get_pixel(1, 1).0, heat(0.0));
        assert_eq!(vote_map(&HoughArray::default(), [4, 4]).picture.dimensions(), (0, 0));
    }
}
