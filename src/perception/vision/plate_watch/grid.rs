use super::super::Table;
use upm_core::geometry::Vec2;

/// Samples along each side of the grid.
const MOST_ALONG: f64 = 128.0;
const LEAST_ALONG: f64 = 3.0;
/// Distance of the outermost samples from the plate's edge, px: blur and half a sample.
const EDGE_PX: f64 = 5.0;
/// Adjacent pixels averaged to a sample.
const WIDTH: usize = 4;
/// Pixel index of a place without a sample.
const NONE: u32 = u32::MAX;

/// A square grid of places on the plate, with their pixels in the frame. It is surrounded by a ring of places without a
/// sample, so that every sample has eight neighbours.
pub(super) struct CellGrid {
    /// Places along a side, the ring included.
    pub(super) stride: usize,
    /// Distance between neighbours, m.
    pub(super) spacing_m: f64,
    /// The first pixel of each sample.
    pixels: Vec<u32>,
}

impl CellGrid {
    /// A grid over the plate, samples about `spacing_m` apart.
    pub(super) fn new(table: &Table, [width, height]: [usize; 2], spacing_m: f64) -> Self {
        let reach_m = (table.side_m - 2.0 * EDGE_PX / table.mean_px_per_m()).max(table.side_m / 2.0);
        let along = (reach_m / spacing_m).ceil().clamp(LEAST_ALONG, MOST_ALONG);
        let stride = along as usize + 3;
        let mut grid = Self { stride, spacing_m: reach_m / along, pixels: Vec::with_capacity(stride * stride) };
        let pixel = |at: usize| {
            let [column, row] = [at % stride, at / stride];
            let on_ring = [column, row].iter().any(|&i| i == 0 || i == stride - 1);
            let p = table.image_from_table(grid.place_m(Vec2::new(column as f64, row as f64)));
            let (x, y) = ((p.x - (WIDTH as f64 - 1.0) / 2.0).round(), p.y.round());
            let in_frame = x >= 0.0 && y >= 0.0 && x + WIDTH as f64 <= width as f64 && y < height as f64;
            if in_frame && !on_ring { (y as usize * width + x as usize).try_into().unwrap_or(NONE) } else { NONE }
        };
        let pixels = (0..stride * stride).map(pixel).collect();
        grid.pixels = pixels;
        grid
    }

    /// Number of places, those without a sample included.
    pub(super) fn len(&self) -> usize {
        self.pixels.len()
    }

    /// Indices of the places that have a sample.
    pub(super) fn usable(&self) -> impl Iterator<Item = usize> {
        self.pixels.iter().enumerate().filter(|(_, pixel)| **pixel != NONE).map(|(sample, _)| sample)
    }

    /// Index of the first pixel of a sample.
    pub(super) fn pixel(&self, sample: usize) -> usize {
        self.pixels[sample] as usize
    }

    /// Position on the plate, m, of a column and a row of the grid.
    pub(super) fn place_m(&self, place: Vec2) -> Vec2 {
        (place - Vec2::repeat((self.stride - 1) as f64 / 2.0)) * self.spacing_m
    }

    /// Calls `each` with the places within `radius_m` of `center_m`.
    pub(super) fn within(&self, center_m: Vec2, radius_m: f64, mut each: impl FnMut(usize)) {
        let center = center_m / self.spacing_m + Vec2::repeat((self.stride - 1) as f64 / 2.0);
        let radius = radius_m / self.spacing_m;
        let range = |middle: f64| {
            let first = (middle - radius).ceil().max(0.0) as usize;
            first..((middle + radius).floor() + 1.0).clamp(0.0, self.stride as f64) as usize
        };
        for row in range(center.y) {
            for column in range(center.x) {
                if (Vec2::new(column as f64, row as f64) - center).norm_squared() <= radius * radius {
                    each(row * self.stride + column);
                }
            }
        }
    }

    /// Reads the gray level of every sample into `levels`, which has [`CellGrid::len`] elements; NaN where there is
    /// none. `moved` gives the place in the frame of a sample's first pixel.
    pub(super) fn read(&self, pixels: &[u8], levels: &mut [f32], moved: impl Fn(usize) -> Option<usize>) {
        for (level, &first) in levels.iter_mut().zip(&self.pixels) {
            let first = if first == NONE { None } else { moved(first as usize) };
            let sample = first.and_then(|first| pixels.get(first..)?.first_chunk::<WIDTH>());
            let sum = |sample: &[u8; WIDTH]| sample.iter().map(|&pixel| u16::from(pixel)).sum::<u16>();
            *level = sample.map_or(f32::NAN, |sample| f32::from(sum(sample)) * (1.0 / WIDTH as f32));
        }
    }
}
