//! Reference picture by brute force: rays against solid cylinders and the square, 16 × 16 per pixel, convolved with the
//! Gaussian and the pixel's square; and the camera's deviation from it.

use super::scenes::{self, PLATE_M};
use super::*;
use upm_core::random::Streams;

const RAYS: usize = 16;
/// Pixels of blur on either side.
const MARGIN: usize = 7;

/// Gray levels without noise.
pub(super) struct ReferencePicture {
    width: usize,
    pub(super) levels: Vec<f64>,
}

pub(super) fn camera(params: &CameraParams, discs: &[PartParams]) -> Renderer {
    Renderer::new(*params, PLATE_M, discs, Streams::new(1).stream("camera"))
}

pub(super) fn pose(x_m: f64, y_m: f64, heading_rad: f64) -> Pose {
    Pose { position_m: Vec2::new(x_m, y_m), heading_rad }
}

impl Renderer {
    fn clean_picture(&self) -> ReferencePicture {
        let [width, height] = self.params.size_px;
        let rows = self.clean.chunks_exact(self.grid.stride()).take(height);
        let levels = rows.flat_map(|row| &row[..width]).map(|&units| f64::from(units - noise::HALF) / 128.0).collect();
        ReferencePicture { width, levels }
    }

    pub(super) fn shown(&mut self, exposure: &[Snapshot]) -> ReferencePicture {
        self.mark_changes(exposure);
        self.redraw_dirty();
        self.clean_picture()
    }
}

/// Gray level of the surface that the ray through an image point hits. The ray passes over the plate's plane from `low`
/// to the point where it is `thickness` high; it hits a cylinder when that section comes within a radius of the axis.
fn level_hit(camera: &Renderer, discs: &[PartParams], snapshot: &Snapshot, px: Vec2) -> f64 {
    let [ground, plate, part] = camera.params.levels;
    let Some(low) = camera.view.table_from_image(px) else { return ground };
    let eye = camera.params.position_m;
    let mut parts = discs.iter().zip(&snapshot.parts_in_table).filter_map(|(disc, pose)| Some((disc, (*pose)?)));
    let hit = parts.any(|(disc, pose)| {
        let high = low + (eye.xy() - low) * disc.thickness_m / eye.z;
        let (stretch, to_axis) = (high - low, pose.position_m - low);
        let along = (to_axis.dot(&stretch) / stretch.norm_squared()).clamp(0.0, 1.0);
        (to_axis - along * stretch).norm() <= disc.radius_m
    });
    let on_plate = snapshot.plate_in_table.apply_inverse(low);
    let background = if on_plate.amax() <= PLATE_M / 2.0 { plate } else { ground };
    if hit { part } else { background }
}

/// Weights of the samples of a row or column for the pixel in their middle.
fn footprint(blur_px: f64) -> Vec<f64> {
    let count = (2 * MARGIN + 1) * RAYS;
    let offset = |k: usize, part: f64| ((k as f64 + part) / count as f64 - 0.5) * (2 * MARGIN + 1) as f64;
    let weight = |k: usize| {
        let inside = |j: u32| {
            let shift = (f64::from(j) + 0.5) / 64.0 - 0.5;
            libm::exp(-0.5 * ((offset(k, 0.5) - shift) / blur_px).powi(2))
        };
        (0..64).map(inside).sum::<f64>()
    };
    let sum = (0..count).map(weight).sum::<f64>();
    (0..count).map(|k| weight(k) / sum).collect()
}

fn reference(camera: &Renderer, discs: &[PartParams], snapshot: &Snapshot) -> ReferencePicture {
    let [width, height] = camera.params.size_px;
    let (columns, rows) = (width + 2 * MARGIN, height + 2 * MARGIN);
    let weights = footprint(camera.params.blur_px);
    let place = |k: usize| (k as f64 + 0.5) / RAYS as f64 - 0.5 - MARGIN as f64;
    let mut across = vec![0.0; rows * RAYS * width];
    for (v, out) in across.chunks_exact_mut(width).enumerate() {
        let hits: Vec<f64> =
            (0..columns * RAYS).map(|u| level_hit(camera, discs, snapshot, Vec2::new(place(u), place(v)))).collect();
        for (x, out) in out.iter_mut().enumerate() {
            *out = hits[x * RAYS..].iter().zip(&weights).map(|(hit, weight)| hit * weight).sum();
        }
    }
    let light = |x: usize, y: usize| camera.light.at_origin + camera.light.slope.dot(&Vec2::new(x as f64, y as f64));
    let level = |x: usize, y: usize| -> f64 {
        let column = (0..weights.len()).map(|k| across[(y * RAYS + k) * width + x] * weights[k]);
        light(x, y) * column.sum::<f64>()
    };
    ReferencePicture { width, levels: (0..width * height).map(|k| level(k % width, k / width)).collect() }
}

impl ReferencePicture {
    pub(super) fn farthest_from(&self, other: &Self) -> f64 {
        self.levels.iter().zip(&other.levels).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    /// Positions where rows cross `level` with a slope of at least `step` per pixel, by cubic interpolation: row and
    /// column.
    fn crossings(&self, level: f64, step: f64) -> Vec<(usize, f64)> {
        let mut found = Vec::new();
        for (y, row) in self.levels.chunks_exact(self.width).enumerate() {
            for (x, w) in row.windows(4).enumerate() {
                let [a, b, c, d] = [w[0] - level, w[1] - level, w[2] - level, w[3] - level];
                if b * c < 0.0 && (b - c).abs() > step {
                    let at = |t: f64| {
                        let outer = -a * t * (t - 1.0) * (t - 2.0) / 6.0 + d * t * (t * t - 1.0) / 6.0;
                        outer + b * (t * t - 1.0) * (t - 2.0) / 2.0 - c * t * (t + 1.0) * (t - 2.0) / 2.0
                    };
                    let (mut low, mut high) = (0.0, 1.0);
                    for _ in 0..30 {
                        let middle = (low + high) / 2.0;
                        if at(middle) * b > 0.0 { low = middle } else { high = middle }
                    }
                    found.push((y, x as f64 + 1.0 + low));
                }
            }
        }
        found
    }
}

fn scene(parts: &[[f64; 2]]) -> Snapshot {
    Snapshot {
        plate_in_table: pose(0.0, 0.0, 0.0),
        parts_in_table: parts.iter().map(|&[x, y]| Some(pose(x, y, 0.0))).collect(),
    }
}

#[test]
fn pictures_agree_with_rays() {
    let tall = PartParams { radius_m: 6e-3, thickness_m: 12e-3, ..PartParams::PENNY };
    let discs = [PartParams::PENNY, tall, PartParams::PENNY];
    for (blur_px, tolerance) in [(0.5, 1.3), (1.3, 2.0)] {
        let mut params = scenes::small();
        params.blur_px = blur_px;
        let mut camera = camera(&params, &discs);
        let mut snapshot = scene(&[[0.0700, 0.0800], [0.0880, 0.0660], [0.0885, 0.0890]]);
        snapshot.plate_in_table = pose(1.3e-3, -0.8e-3, 0.012);
        let off = camera.shown(std::slice::from_ref(&snapshot)).farthest_from(&reference(&camera, &discs, &snapshot));
        assert!(off < tolerance, "blur {blur_px}: off by {off} levels");
    }
}

#[test]
fn coins_and_edges_are_where_rays_put_them() {
    for levels in [[12.0, 220.0, 35.0], [0.0, 120.0, 240.0]] {
        let mut params = scenes::small();
        (params.shading, params.levels) = (0.0, levels);
        let mut camera = camera(&params, &[PartParams::PENNY]);
        let snapshot = scene(&[[0.0722, 0.0781]]);
        let (ours, exact) =
            (camera.shown(std::slice::from_ref(&snapshot)), reference(&camera, &[PartParams::PENNY], &snapshot));
        for [dark, bright] in [[levels[0], levels[1]], [levels[1], levels[2]]] {
            let (level, step) = ((dark + bright) / 2.0, (dark - bright).abs() / 4.0);
            let (ours, exact) = (ours.crossings(level, step), exact.crossings(level, step / 2.0));
            assert!(ours.len() > 40);
            for (y, x) in ours {
                let off = exact.iter().filter(|at| at.0 == y).map(|at| (at.1 - x).abs()).fold(f64::MAX, f64::min);
                assert!(off < 0.02, "row {y}: edge at {x} is off by {off}");
            }
        }
    }
}
