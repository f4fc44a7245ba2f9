//! The picture averaged over squares of pixels; most of the search without prior knowledge runs on it.

use upm_core::geometry::Vec2;
use upm_core::signal::Frame;

/// Units of one gray level in an averaged picture.
pub(super) const UNITS: i16 = 4;
/// Largest square: the sum over one of its columns has to fit 16 bits.
const LARGEST_BIN: usize = 256;

/// A part of a frame, averaged over squares of `bin` by `bin` pixels.
pub(super) struct BinnedImage {
    pub(super) bin: usize,
    /// Column and row of the first cell, counted in cells from the frame's corner.
    pub(super) corner: [usize; 2],
    pub(super) width: usize,
    pub(super) height: usize,
    /// Row by row, 1/[`UNITS`] gray level.
    pub(super) levels: Vec<i16>,
}

impl BinnedImage {
    /// Averages the whole frame; a remainder narrower than a square at its right and lower side is left out.
    pub(super) fn of(frame: &Frame, bin: usize) -> Self {
        let bin = bin.clamp(1, LARGEST_BIN);
        Self::part_of(frame, bin, [0, 0], [frame.width / bin, frame.height / bin])
    }

    /// `size` cells of the frame (columns, rows) from cell `corner` on; cells that the frame does not hold are left
    /// out.
    pub(super) fn part_of(frame: &Frame, bin: usize, corner: [usize; 2], size: [usize; 2]) -> Self {
        let bin = bin.clamp(1, LARGEST_BIN);
        let width = size[0].min((frame.width / bin).saturating_sub(corner[0]));
        let height = size[1].min((frame.height / bin).saturating_sub(corner[1]));
        let mut coarse = Self { bin, corner, width, height, levels: vec![0; width * height] };
        if width > 0 {
            match bin {
                1 => coarse.average::<1>(frame),
                2 => coarse.average::<2>(frame),
                3 => coarse.average::<3>(frame),
                4 => coarse.average::<4>(frame),
                5 => coarse.average::<5>(frame),
                6 => coarse.average::<6>(frame),
                _ => coarse.average_any(frame),
            }
        }
        coarse
    }

    /// Frame coordinates, px, of a place given in cells from the first one.
    pub(super) fn frame_from_cell(&self, cell: Vec2) -> Vec2 {
        let bin = self.bin as f64;
        let corner = Vec2::new(self.corner[0] as f64, self.corner[1] as f64);
        (cell + corner) * bin + Vec2::repeat((bin - 1.0) / 2.0)
    }

    /// Levels of row `y` of cells.
    pub(super) fn row(&self, y: usize) -> &[i16] {
        &self.levels[y * self.width..][..self.width]
    }

    /// Averages over squares of a side known at compile time: columns are summed over all rows of a cell at once.
    fn average<const BIN: usize>(&mut self, frame: &Frame) {
        // 20 bits: the sum over a white square is just below 2³⁰.
        let scale = (i32::from(UNITS) << 20) / (BIN * BIN) as i32;
        let (x, y, columns) = (self.corner[0] * BIN, self.corner[1], self.width * BIN);
        let mut sums = vec![0u16; columns];
        for (row, cells) in self.levels.chunks_exact_mut(self.width).enumerate() {
            let lines: [&[u8]; BIN] = std::array::from_fn(|k| &frame.row((y + row) * BIN + k)[x..][..columns]);
            for (i, sum) in sums.iter_mut().enumerate() {
                *sum = lines.iter().map(|line| u16::from(line[i])).sum();
            }
            for (cell, square) in cells.iter_mut().zip(sums.as_chunks::<BIN>().0) {
                let sum: i32 = square.iter().map(|&column| i32::from(column)).sum();
                *cell = ((sum * scale + (1 << 19)) >> 20) as i16;
            }
        }
    }

    fn average_any(&mut self, frame: &Frame) {
        let (bin, [x, y]) = (self.bin, self.corner);
        let scale = f32::from(UNITS) / (bin * bin) as f32;
        let mut sums = vec![0u16; self.width * bin];
        for (row, cells) in self.levels.chunks_exact_mut(self.width).enumerate() {
            sums.fill(0);
            for line in (y + row) * bin..(y + row + 1) * bin {
                let pixels = &frame.row(line)[x * bin..][..self.width * bin];
                sums.iter_mut().zip(pixels).for_each(|(sum, &pixel)| *sum += u16::from(pixel));
            }
            for (cell, square) in cells.iter_mut().zip(sums.chunks_exact(bin)) {
                let sum: u32 = square.iter().map(|&column| u32::from(column)).sum();
                *cell = (sum as f32 * scale).round() as i16;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_cell_is_the_mean_of_its_square(
            size in proptest::array::uniform2(1usize..40), bin in 1usize..9, corner in proptest::array::uniform2(0usize..3),
            seed in 0usize..99,
        ) {
            let mut frame = Frame::new(size[0], size[1]);
            frame.pixels.iter_mut().enumerate().for_each(|(i, p)| *p = ((i + seed).wrapping_mul(2_654_435_761) >> 11) as u8);
            let coarse = BinnedImage::part_of(&frame, bin, corner, [7, 5]);
            prop_assert!(coarse.width <= 7 && coarse.height <= 5 && coarse.levels.len() == coarse.width * coarse.height);
            for y in 0..coarse.height {
                for x in 0..coarse.width {
                    let (left, top) = ((x + corner[0]) * bin, (y + corner[1]) * bin);
                    let square = (0..bin * bin).map(|k| f64::from(frame.row(top + k / bin)[left + k % bin]));
                    let mean = square.sum::<f64>() / (bin * bin) as f64;
                    let got = f64::from(coarse.row(y)[x]) / f64::from(UNITS);
                    prop_assert!((got - mean).abs() < 0.126, "{got} {mean}");
                }
            }
        }
    }
}
