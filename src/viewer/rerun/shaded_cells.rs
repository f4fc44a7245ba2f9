/// Pixels along a cell's side.
const FINE: f64 = 8.0;

/// Largest number of pixels along a side of the picture.
const MOST_PX: f64 = 2048.0;

/// Opacity of a cell of value 0 and of one of value 1, out of 255.
const OPACITY: [f64; 2] = [30.0, 255.0];

/// A picture of shaded squares at arbitrary places.
#[derive(Debug)]
pub(super) struct Raster {
    /// Its top left corner, in the squares' unit, y up.
    pub(super) top_left: [f64; 2],
    /// Side of a pixel in that unit.
    pub(super) pixel: f64,
    /// Columns and rows.
    pub(super) size_px: [u32; 2],
    /// Red, green, blue, opacity, row by row from the top.
    pub(super) rgba: Vec<u8>,
}

impl Raster {
    /// Squares of this side around points, each shaded by its value from 0 to 1; `None` where nothing is visible.
    pub(super) fn of(cells: &[([f64; 2], f64)], side: f64, rgb: [u8; 3]) -> Option<Self> {
        let seen = || cells.iter().filter(|([x, y], value)| x.is_finite() && y.is_finite() && value.is_finite());
        let [x, y] = [0, 1].map(|axis| {
            let along = || seen().map(move |(point, _)| point[axis]);
            [along().fold(f64::INFINITY, f64::min) - 0.5 * side, along().fold(f64::NEG_INFINITY, f64::max) + 0.5 * side]
        });
        let span = (x[1] - x[0]).max(y[1] - y[0]);
        if !(side > 0.0 && span.is_finite()) {
            return None;
        }
        let pixel = (side / FINE).max(span / MOST_PX);
        let size_px = [x, y].map(|[from, to]| ((to - from) / pixel).round().max(1.0) as u32);
        let mut raster = Self { top_left: [x[0], y[1]], pixel, size_px, rgba: vec![0; pixels(size_px) * 4] };
        for &(center, value) in seen() {
            let opacity = OPACITY[0] + (OPACITY[1] - OPACITY[0]) * value.clamp(0.0, 1.0);
            raster.fill(center, side, [rgb[0], rgb[1], rgb[2], opacity.round() as u8]);
        }
        Some(raster)
    }

    fn fill(&mut self, [x, y]: [f64; 2], side: f64, rgba: [u8; 4]) {
        let stretch = |from: f64, most: u32| {
            let ends = [from, from + side].map(|end| (end / self.pixel).round().clamp(0.0, f64::from(most)) as usize);
            ends[0]..ends[1]
        };
        let columns = stretch(x - 0.5 * side - self.top_left[0], self.size_px[0]);
        let rows = stretch(self.top_left[1] - y - 0.5 * side, self.size_px[1]);
        let width = self.size_px[0] as usize;
        for row in self.rgba.chunks_exact_mut(4 * width).skip(rows.start).take(rows.len()) {
            row.chunks_exact_mut(4).skip(columns.start).take(columns.len()).for_each(|px| px.copy_from_slice(&rgba));
        }
    }
}

fn pixels([columns, rows]: [u32; 2]) -> usize {
    columns as usize * rows as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_of_a_grid_fill_their_squares_exactly() {
        let raster = Raster::of(&[([0.0, 0.0], 0.0), ([20.0, 20.0], 1.0)], 20.0, [1, 2, 3]).unwrap();
        assert_eq!((raster.top_left, raster.pixel, raster.size_px), ([-10.0, 30.0], 2.5, [16, 16]));
        let at = |column: usize, row: usize| &raster.rgba[4 * (16 * row + column)..][..4];
        for (column, row, expected) in [
            (0, 0, [0, 0, 0, 0]),
            (7, 7, [0, 0, 0, 0]),
            (8, 7, [1, 2, 3, 255]),
            (15, 0, [1, 2, 3, 255]),
            (7, 8, [1, 2, 3, 30]),
            (0, 15, [1, 2, 3, 30]),
        ] {
            assert_eq!(at(column, row), expected, "({column}, {row})");
        }
    }

    #[test]
    fn invisible_cells_give_no_picture_and_far_cells_a_coarse_one() {
        for cells in [&[][..], &[([f64::NAN, 0.0], 1.0)], &[([0.0, 0.0], f64::NAN)]] {
            assert!(Raster::of(cells, 1.0, [0; 3]).is_none());
        }
        assert!(Raster::of(&[([0.0, 0.0], 1.0)], 0.0, [0; 3]).is_none());
        let far = Raster::of(&[([0.0, 0.0], 1.0), ([1e6, 3.0], 1.0)], 1.0, [0; 3]).unwrap();
        assert!(far.size_px.iter().all(|&px| px <= MOST_PX as u32), "{:?}", far.size_px);
    }
}
