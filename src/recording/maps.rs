//! The stages of localisation as pictures, shared by recordings and files.

use std::ops::RangeInclusive;

use image::{GrayImage, RgbImage};

use upm_core::geometry::Vec2;
use upm_perception::vision::{FloatImage, HoughArray, Table};

/// Edges in gray over a frame of `frame_size` (columns, rows), the frame shrunk by a whole factor. A tenth of the
/// edges, the strongest, are white.
pub fn edge_map(edges: &FloatImage, frame_size: [usize; 2], shrink: usize) -> GrayImage {
    let map = laid_over(edges, frame_size, shrink);
    let strong = quantile(&map.values, 0.9);
    let pixels = map.values.iter().map(|&value| (255.0 * share(value, strong)) as u8).collect();
    GrayImage::from_raw(map.width as u32, map.height as u32, pixels).unwrap_or_default()
}

/// The disk kernel's response in heat colours, from 0 to 1, over a frame as in [`edge_map`].
pub fn response_map(response: &FloatImage, frame_size: [usize; 2], shrink: usize) -> RgbImage {
    heat_map(&laid_over(response, frame_size, shrink), 1.0)
}

/// Hough votes in heat colours, angles to the right and distances down.
#[derive(Clone, Debug)]
pub struct VoteMap {
    /// The votes; rows beyond the farthest line are omitted.
    pub picture: RgbImage,
    /// Centres of the peaks' cells, px; the first pixel covers 0 to 1.
    pub peaks: Vec<[f32; 2]>,
}

/// Hough votes, shrunk to at most `most` px. The first column is an eighth of a turn before angle 0, so that the four
/// lines of an upright table are well inside.
pub fn vote_map(hough: &HoughArray, most: [usize; 2]) -> VoteMap {
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

/// The table's rim in the picture as a closed line, px. Its sides are curved where the lens bends them.
pub fn outline_px(table: &Table) -> impl Iterator<Item = Vec2> {
    const STEPS: usize = 16;
    let h = table.side_m / 2.0;
    let corners = [(-h, h), (h, h), (h, -h), (-h, -h)].map(|(x, y)| Vec2::new(x, y));
    (0..=4 * STEPS).map(move |i| {
        let (from, to) = (corners[i / STEPS % 4], corners[(i / STEPS + 1) % 4]);
        let p_m = from.lerp(&to, (i % STEPS) as f64 / STEPS as f64);
        table.lens.image_from_ideal(table.ideal_from_table.apply(p_m))
    })
}

/// `plane` over a frame of that size, shrunk to the largest value of every cell. One value of it may cover a square of
/// the frame's pixels.
fn laid_over(plane: &FloatImage, [width, height]: [usize; 2], shrink: usize) -> FloatImage {
    if plane.width == 0 || plane.height == 0 {
        return FloatImage { width: 0, height: 0, values: Vec::new() };
    }
    let (square, shrink) = ((width / plane.width).max(1), shrink.max(1));
    // range of values that are visible in each cell of `shrink` pixels along a side
    let cells = |pixels: usize, values: usize| -> Vec<RangeInclusive<usize>> {
        let value = |pixel: usize| (pixel.min(pixels - 1) / square).min(values - 1);
        (0..pixels).step_by(shrink).map(|first| value(first)..=value(first + shrink - 1)).collect()
    };
    let (across, down) = (cells(width, plane.width), cells(height, plane.height));
    let largest = |rows: &RangeInclusive<usize>, columns: &RangeInclusive<usize>| {
        let row = |y: usize| plane.values.get(y * plane.width..).and_then(|row| row.get(columns.clone()));
        rows.clone().filter_map(row).flatten().copied().fold(0.0, f32::max)
    };
    let values = down.iter().flat_map(|rows| across.iter().map(|columns| largest(rows, columns))).collect();
    FloatImage { width: across.len(), height: down.len(), values }
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
        let over = laid_over(&plane(2, 1), [5, 3], 1);
        assert_eq!((over.width, over.height), (5, 3));
        assert_eq!(over.values, [0.0, 0.0, 1.0, 1.0, 1.0].repeat(3));
        assert_eq!(laid_over(&plane(2, 1), [5, 3], 2).values, [0.0, 1.0, 1.0, 0.0, 1.0, 1.0]);
        assert_eq!(laid_over(&plane(5, 3), [5, 3], 1), plane(5, 3));
        assert_eq!(laid_over(&plane(5, 3), [5, 3], 2), pooled(&plane(5, 3), [2, 2]));
        assert_eq!(laid_over(&FloatImage::default(), [5, 3], 1), FloatImage::default());
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
