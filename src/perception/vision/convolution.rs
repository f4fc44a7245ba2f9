//! A solid disk convolved over a rectangle, by real FFT: one forward transform a picture, one back a kernel. Equation
//! sheet, section 7.

use std::sync::Arc;

use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use rustfft::num_complex::Complex;
use rustfft::{Fft, FftPlanner};

use super::disk::DiskKernel;

type Complex32 = Complex<f32>;

/// Plans, spectra and scratch for rectangles of one size.
pub(super) struct DiskConvolver {
    width: usize,
    height: usize,
    padded: [usize; 2],
    rows_forward: Arc<dyn RealToComplex<f32>>,
    rows_back: Arc<dyn ComplexToReal<f32>>,
    columns_forward: Arc<dyn Fft<f32>>,
    columns_back: Arc<dyn Fft<f32>>,
    /// Spectrum of each kernel, column by column; real, since a disk about the origin is even.
    kernels: Vec<Vec<f32>>,
    /// Spectrum of the picture loaded, column by column.
    picture: Vec<Complex32>,
    product: Vec<Complex32>,
    half_rows: Vec<Complex32>,
    row: Vec<f32>,
    scratch: Vec<Complex32>,
}

impl DiskConvolver {
    /// For rectangles of `width` by `height` cells and these kernels. Beyond the rectangle values are 0.
    pub(super) fn new(width: usize, height: usize, disks: &[DiskKernel]) -> Self {
        let reach = disks.iter().map(DiskKernel::reach).max().unwrap_or(0);
        let padded = [even_smooth(width + reach), even_smooth(height + reach)];
        let (mut real, mut complex) = (RealFftPlanner::new(), FftPlanner::new());
        let rows_forward = real.plan_fft_forward(padded[0]);
        let rows_back = real.plan_fft_inverse(padded[0]);
        let columns_forward = complex.plan_fft_forward(padded[1]);
        let columns_back = complex.plan_fft_inverse(padded[1]);
        let columns = padded[0] / 2 + 1;
        let zero = Complex32::new(0.0, 0.0);
        let scratch = [
            rows_forward.get_scratch_len(),
            rows_back.get_scratch_len(),
            columns_forward.get_inplace_scratch_len(),
            columns_back.get_inplace_scratch_len(),
        ];
        let mut convolver = Self {
            width,
            height,
            padded,
            rows_forward,
            rows_back,
            columns_forward,
            columns_back,
            kernels: Vec::new(),
            picture: vec![zero; columns * padded[1]],
            product: vec![zero; columns * padded[1]],
            half_rows: vec![zero; columns * padded[1]],
            row: vec![0.0; padded[0]],
            scratch: vec![zero; scratch.into_iter().max().unwrap_or(0)],
        };
        convolver.kernels = disks.iter().map(|disk| convolver.kernel(disk)).collect();
        convolver
    }

    /// Loads rows of `width` values, each written by `fill`.
    pub(super) fn load(&mut self, mut fill: impl FnMut(usize, &mut [f32])) {
        let width = self.width;
        self.transform(self.height, |y, row| {
            fill(y, &mut row[..width]);
            row[width..].fill(0.0);
        });
    }

    /// Mean of the loaded values under the disk of kernel `index`, for every cell of the rectangle.
    pub(super) fn respond(&mut self, index: usize, out: &mut [f32]) {
        for ((product, value), kernel) in self.product.iter_mut().zip(&self.picture).zip(&self.kernels[index]) {
            *product = value * kernel;
        }
        let columns = self.padded[0] / 2 + 1;
        self.columns_back.process_with_scratch(&mut self.product, &mut self.scratch);
        transpose(&self.product, &mut self.half_rows, columns, self.padded[1], self.height);
        for (target, half) in out.chunks_exact_mut(self.width).zip(self.half_rows.chunks_exact_mut(columns)) {
            // The first and last coefficient of a real row are real; the imaginary rounding error is dropped.
            half[0].im = 0.0;
            half[columns - 1].im = 0.0;
            let done = self.rows_back.process_with_scratch(half, &mut self.row, &mut self.scratch);
            debug_assert!(done.is_ok());
            target.copy_from_slice(&self.row[..self.width]);
        }
    }

    fn kernel(&mut self, disk: &DiskKernel) -> Vec<f32> {
        let [width, height] = self.padded;
        self.transform(height, |y, row| {
            row.fill(0.0);
            let dy = if y > height / 2 { y as i64 - height as i64 } else { y as i64 };
            if let Some(half) = disk.half_chord(dy) {
                row[..=half].fill(1.0);
                row[width - half..].fill(1.0);
            }
        });
        let scale = 1.0 / (disk.area() as f32 * (width * height) as f32);
        self.picture.iter().map(|value| value.re * scale).collect()
    }

    /// Spectrum of a picture whose first `rows` rows `fill` writes; the rest is 0.
    fn transform(&mut self, rows: usize, mut fill: impl FnMut(usize, &mut [f32])) {
        let columns = self.padded[0] / 2 + 1;
        for (y, half) in self.half_rows.chunks_exact_mut(columns).enumerate() {
            if y < rows {
                fill(y, &mut self.row);
                let done = self.rows_forward.process_with_scratch(&mut self.row, half, &mut self.scratch);
                debug_assert!(done.is_ok());
            } else {
                half.fill(Complex32::new(0.0, 0.0));
            }
        }
        transpose(&self.half_rows, &mut self.picture, self.padded[1], columns, columns);
        self.columns_forward.process_with_scratch(&mut self.picture, &mut self.scratch);
    }
}

/// Writes `to[c][r] = from[r][c]` for a matrix of `rows` by `columns`, columns below `wanted` only, block by block.
fn transpose(from: &[Complex32], to: &mut [Complex32], rows: usize, columns: usize, wanted: usize) {
    const BLOCK: usize = 16;
    for first_column in (0..wanted).step_by(BLOCK) {
        for first_row in (0..rows).step_by(BLOCK) {
            let last_row = (first_row + BLOCK).min(rows);
            for column in first_column..(first_column + BLOCK).min(wanted) {
                for row in first_row..last_row {
                    to[column * rows + row] = from[row * columns + column];
                }
            }
        }
    }
}

/// The least even number from `n` up with no prime factor above 5.
fn even_smooth(n: usize) -> usize {
    (n.max(2)..)
        .find(|&candidate| {
            let mut rest = candidate;
            for prime in [2, 3, 5] {
                while rest % prime == 0 {
                    rest /= prime;
                }
            }
            rest == 1 && candidate % 2 == 0
        })
        .unwrap_or(n)
}
