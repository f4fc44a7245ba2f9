//! Brightness of the bare plate over the picture: a robust quadratic surface through quantiles of a coarse grid.

use nalgebra::{SMatrix, SVector};

use super::binned::{BinnedImage, UNITS};
use super::outline::PlateCells;
use super::sampling::{biweight, quantile};
use upm_core::geometry::Vec2;

/// Blocks along each side of the plate's rectangle, and most samples along each side of a block.
const BLOCKS: usize = 12;
const SAMPLES: usize = 6;
/// Lower bound of the plate's level: keeps quotients finite in the dark.
const DIMMEST: f64 = 4.0;

/// Gray level of the bare plate as a quadratic function of position in the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Shading {
    /// Coefficients of 1, u, v, u², uv, v².
    coefficients: [f64; 6],
    center: Vec2,
    scale: f64,
}

impl Shading {
    /// Fits the plate's brightness in `picture`, the plate's rectangle of cells. A high quantile of each block rejects
    /// parts darker than the plate, a low one lighter parts; biweights reject blocks full of parts.
    pub(super) fn fit(picture: &BinnedImage, plate: &PlateCells, dark_parts: bool) -> Self {
        let share = if dark_parts { 0.7 } else { 0.3 };
        let center = Vec2::new(picture.width as f64, picture.height as f64) / 2.0;
        let mut shading =
            Self { coefficients: [255.0, 0.0, 0.0, 0.0, 0.0, 0.0], center, scale: center.amax().max(1.0) };
        let samples = shading.samples(picture, plate, share);
        let mut scratch: Vec<f64> = samples.iter().map(|sample| sample.1).collect();
        if scratch.is_empty() {
            return shading;
        }
        shading.coefficients[0] = quantile(&mut scratch, share).max(DIMMEST);
        for _ in 0..6 {
            let Some(better) = shading.fitted(&samples, &mut scratch) else { break };
            shading.coefficients = better;
        }
        shading
    }

    /// One step of iteratively reweighted least squares.
    fn fitted(&self, samples: &[(SVector<f64, 6>, f64)], scratch: &mut Vec<f64>) -> Option<[f64; 6]> {
        let surface = SVector::from(self.coefficients);
        scratch.clear();
        scratch.extend(samples.iter().map(|(at, level)| (level - at.dot(&surface)).abs()));
        let sd = (1.4826 * quantile(scratch, 0.5)).max(1.0);
        let mut normal = SMatrix::<f64, 6, 6>::identity() * 1e-6;
        let mut right = SVector::<f64, 6>::zeros();
        for (at, level) in samples {
            let weight = biweight((level - at.dot(&surface)) / sd);
            if weight > 0.0 {
                normal.syger(weight, at, at, 1.0);
                right.axpy(weight * level, at, 1.0);
            }
        }
        normal.cholesky().map(|c| c.solve(&right).into())
    }

    /// Quantiles of blocks that are wholly on the plate.
    fn samples(&self, picture: &BinnedImage, plate: &PlateCells, share: f64) -> Vec<(SVector<f64, 6>, f64)> {
        let (width, height) = (picture.width, picture.height);
        let edge = |i: usize, n: usize| i * n / BLOCKS;
        let mut levels: Vec<i16> = Vec::with_capacity((SAMPLES + 1) * (SAMPLES + 1));
        let mut samples = Vec::with_capacity(BLOCKS * BLOCKS);
        for block in 0..BLOCKS * BLOCKS {
            let (left, right) = (edge(block % BLOCKS, width), edge(block % BLOCKS + 1, width));
            let (top, bottom) = (edge(block / BLOCKS, height), edge(block / BLOCKS + 1, height));
            let inside = |row: usize| plate.spans.get(row).is_some_and(|span| span.0 <= left && right <= span.1);
            if left == right || top == bottom || !(inside(top) && inside(bottom - 1)) {
                continue;
            }
            levels.clear();
            for row in (top..bottom).step_by((bottom - top).div_ceil(SAMPLES)) {
                levels.extend(picture.row(row)[left..right].iter().step_by((right - left).div_ceil(SAMPLES)));
            }
            let nth = ((levels.len() - 1) as f64 * share).round() as usize;
            let level = f64::from(*levels.select_nth_unstable(nth).1) / f64::from(UNITS);
            let middle = Vec2::new((left + right) as f64 - 1.0, (top + bottom) as f64 - 1.0) / 2.0;
            samples.push((terms((middle - self.center) / self.scale), level));
        }
        samples
    }

    /// One over the plate's level along a row of cells.
    pub(super) fn inverse_row(&self, row: usize, out: &mut [f32]) {
        let [c0, c1, c2, c3, c4, c5] = self.coefficients;
        let v = (row as f64 - self.center.y) / self.scale;
        let (constant, linear, square) = ((c0 + v * (c2 + v * c5)) as f32, (c1 + v * c4) as f32, c3 as f32);
        let (start, du) = ((-self.center.x / self.scale) as f32, (1.0 / self.scale) as f32);
        for (i, value) in out.iter_mut().enumerate() {
            let u = start + i as f32 * du;
            *value = 1.0 / (constant + u * (linear + u * square)).max(DIMMEST as f32);
        }
    }
}

fn terms(p: Vec2) -> SVector<f64, 6> {
    SVector::from([1.0, p.x, p.y, p.x * p.x, p.x * p.y, p.y * p.y])
}
