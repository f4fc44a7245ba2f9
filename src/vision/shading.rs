//! Brightness of the bare plate over the picture: a robust quadratic surface through quantiles of a coarse grid.

use nalgebra::{SMatrix, SVector};

use super::Table;
use super::sampling::{biweight, quantile};
use crate::geometry::Vec2;
use crate::signal::Frame;

/// Cells along each side of the plate, and samples along each side of a cell.
const CELLS: usize = 14;
const SAMPLES: usize = 7;
/// Dimmest plate, levels: keeps quotients finite in the dark.
const DIMMEST: f64 = 4.0;

/// Gray level of the bare plate as a quadratic of place in the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Shading {
    /// Of 1, u, v, u², uv, v².
    coefficients: [f64; 6],
    center_px: Vec2,
    scale_px: f64,
}

/// Where the plate is sampled: per cell the indices of its pixels, and its middle.
pub(super) struct ShadingGrid {
    cells: Vec<(Vec2, Vec<usize>)>,
    center_px: Vec2,
    scale_px: f64,
    frame_size: [usize; 2],
}

impl ShadingGrid {
    pub(super) fn new(table: &Table, frame_size: [usize; 2]) -> Self {
        let inner = 0.96 * table.side_m;
        let place = |i: f64| (i / CELLS as f64 - 0.5) * inner;
        let inside = |p: Vec2| p.x >= 0.0 && p.y >= 0.0 && p.x < frame_size[0] as f64 && p.y < frame_size[1] as f64;
        let mut cells = Vec::with_capacity(CELLS * CELLS);
        for cell in 0..CELLS * CELLS {
            let (column, row) = ((cell % CELLS) as f64, (cell / CELLS) as f64);
            let at = |u: f64, v: f64| table.image_from_table(Vec2::new(place(column + u), place(row + v)));
            let mut indices = Vec::with_capacity(SAMPLES * SAMPLES);
            for k in 0..SAMPLES * SAMPLES {
                let [u, v] = [k % SAMPLES, k / SAMPLES].map(|i| (i as f64 + 0.5) / SAMPLES as f64);
                let p = at(u, v);
                if inside(p) {
                    indices.push(p.y as usize * frame_size[0] + p.x as usize);
                }
            }
            if !indices.is_empty() {
                cells.push((at(0.5, 0.5), indices));
            }
        }
        Self { cells, center_px: table.image_from_table(Vec2::zeros()), scale_px: table.side_px.max(1.0), frame_size }
    }

    /// The plate's brightness in `frame`, of the size told to [`ShadingGrid::new`]. Parts darker than the plate
    /// are passed over by a high quantile of each cell, lighter ones by a low one; cells full of parts by biweights.
    pub(super) fn fit(&self, frame: &Frame, dark_parts: bool) -> Shading {
        let share = if dark_parts { 0.7 } else { 0.3 };
        let flat = |level: f64| Shading {
            coefficients: [level.max(DIMMEST), 0.0, 0.0, 0.0, 0.0, 0.0],
            center_px: self.center_px,
            scale_px: self.scale_px,
        };
        if [frame.width, frame.height] != self.frame_size || self.cells.is_empty() {
            return flat(255.0);
        }
        let mut levels = Vec::new();
        let samples: Vec<(SVector<f64, 6>, f64)> = self
            .cells
            .iter()
            .map(|(middle, indices)| {
                levels.clear();
                levels.extend(indices.iter().map(|&i| f64::from(frame.pixels[i])));
                (terms((middle - self.center_px) / self.scale_px), quantile(&mut levels, share))
            })
            .collect();
        levels.clear();
        levels.extend(samples.iter().map(|sample| sample.1));
        let mut shading = flat(quantile(&mut levels, share));
        for _ in 0..10 {
            let surface = SVector::from(shading.coefficients);
            levels.clear();
            levels.extend(samples.iter().map(|(at, level)| (level - at.dot(&surface)).abs()));
            let sd = (1.4826 * quantile(&mut levels, 0.5)).max(1.0);
            let mut normal = SMatrix::<f64, 6, 6>::identity() * 1e-6;
            let mut right = SVector::<f64, 6>::zeros();
            for (at, level) in &samples {
                let weight = biweight((level - at.dot(&surface)) / sd);
                normal += at * at.transpose() * weight;
                right += at * (weight * level);
            }
            let Some(solution) = normal.cholesky().map(|c| c.solve(&right)) else { break };
            shading.coefficients = solution.into();
        }
        shading
    }
}

fn terms(p: Vec2) -> SVector<f64, 6> {
    SVector::from([1.0, p.x, p.y, p.x * p.x, p.x * p.y, p.y * p.y])
}

impl Shading {
    /// One over the plate's level along a row of the picture: `out[i]` at `x = first + i * step`.
    pub(super) fn inverse_row(&self, y: f64, first: f64, step: f64, out: &mut [f32]) {
        let [c0, c1, c2, c3, c4, c5] = self.coefficients;
        let v = (y - self.center_px.y) / self.scale_px;
        let (constant, linear, square) = ((c0 + v * (c2 + v * c5)) as f32, (c1 + v * c4) as f32, c3 as f32);
        let (start, du) = (((first - self.center_px.x) / self.scale_px) as f32, (step / self.scale_px) as f32);
        for (i, value) in out.iter_mut().enumerate() {
            let u = start + i as f32 * du;
            *value = 1.0 / (constant + u * (linear + u * square)).max(DIMMEST as f32);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::locate_table;
    use super::*;
    use crate::scene::Scene;
    use crate::scene::testing::{SIDE_M, penny};

    #[test]
    fn light_is_followed_under_noise_and_parts() {
        let scene = Scene::general(5).rough();
        let discs: Vec<_> =
            (0..16).map(|i| penny(-0.075 + 0.03 * f64::from(i % 4), -0.075 + 0.03 * f64::from(i / 4))).collect();
        let frame = scene.frame_with(&discs);
        let table = locate_table(&frame, &scene.lens, SIDE_M).unwrap().0;
        let shading = ShadingGrid::new(&table, scene.size_px).fit(&frame, true);
        let mut inverse = [0.0f32; 70];
        for y in [200.0, 500.0, 800.0] {
            shading.inverse_row(y, 300.0, 10.0, &mut inverse);
            for (i, inverse) in inverse.iter().enumerate() {
                let x = 300.0 + 10.0 * i as f64;
                let truth = 215.0 * (1.0 - 0.4 * (0.7 * x / 1280.0 + 0.3 * y / 1024.0));
                // The quantile lies half a standard deviation of the noise above the mean.
                let off = 1.0 / f64::from(*inverse) - truth - 4.2;
                assert!(off.abs() < 4.0, "{off} at {x}, {y}");
            }
        }
    }

    #[test]
    fn darkness_and_foreign_frames_give_a_finite_surface() {
        let scene = Scene::plain(1);
        let table = locate_table(&scene.frame(), &scene.lens, SIDE_M).unwrap().0;
        let grid = ShadingGrid::new(&table, scene.size_px);
        let mut inverse = [0.0f32; 9];
        for frame in [Frame::new(1280, 1024), Frame::new(3, 2)] {
            grid.fit(&frame, true).inverse_row(10.0, 0.0, 100.0, &mut inverse);
            assert!(inverse.iter().all(|v| v.is_finite() && *v > 0.0));
        }
    }
}
