//! A small renderer for tests alone: plate and discs by area sampling, then light, blur and noise.
//! It shares nothing with the simulator's camera but the lens and homography types.

use nalgebra::{Matrix3, Rotation3, Vector3};
use rand_distr::{Distribution, Normal};

use crate::geometry::{Homography, Lens, Vec2};
use crate::random::Streams;
use crate::signal::Frame;

pub(super) const SIDE_M: f64 = 0.2032;
pub(super) const PENNY_M: f64 = 0.009525;

pub(super) struct Disc {
    pub(super) at_m: Vec2,
    pub(super) radius_m: f64,
    pub(super) thickness_m: f64,
}

#[derive(Clone)]
pub(super) struct Scene {
    pub(super) size: [usize; 2],
    pub(super) lens: Lens,
    /// Camera centre in the table frame, m.
    pub(super) camera_m: Vector3<f64>,
    /// Tilts about the image's axes and turn about the optical axis, rad.
    pub(super) tilt_rad: [f64; 3],
    /// Ground, plate, parts.
    pub(super) levels: [f64; 3],
    pub(super) shading: f64,
    pub(super) blur_px: f64,
    pub(super) noise: f64,
    pub(super) seed: u64,
}

pub(super) fn penny(x_m: f64, y_m: f64) -> Disc {
    Disc { at_m: Vec2::new(x_m, y_m), radius_m: PENNY_M, thickness_m: 1.52e-3 }
}

impl Scene {
    /// 1280 × 1024 px, 4.2 px/mm, looking straight down, sharp and clean.
    pub(super) fn plain(seed: u64) -> Self {
        Self {
            size: [1280, 1024],
            lens: Lens::ideal(2520.0, Vec2::new(639.5, 511.5)),
            camera_m: Vector3::new(0.0, 0.0, 0.6),
            tilt_rad: [0.0; 3],
            levels: [18.0, 215.0, 30.0],
            shading: 0.0,
            blur_px: 0.8,
            noise: 0.0,
            seed,
        }
    }

    /// Rotation, off-centre camera, tilt and lens distortion drawn from the seed.
    pub(super) fn general(seed: u64) -> Self {
        let u = |k: u64| ((seed * 7919 + k * 104_729 + 13) % 1000) as f64 / 500.0 - 1.0;
        let mut scene = Self::plain(seed);
        scene.tilt_rad = [0.05 * u(4), 0.05 * u(5), 0.1 * u(6)];
        let plate_in_camera_m = Vector3::new(0.003 * u(1), 0.003 * u(2), 0.6 + 0.02 * u(3));
        scene.camera_m = -scene.camera_from_table().transpose() * plate_in_camera_m;
        scene.lens.radial = [-0.12 + 0.05 * u(7), 0.03];
        scene.lens.tangential = [4e-4, -3e-4];
        scene
    }

    pub(super) fn rough(self) -> Self {
        Self { shading: 0.4, blur_px: 1.5, noise: 8.0, ..self }
    }

    fn camera_from_table(&self) -> Matrix3<f64> {
        let [a, b, c] = self.tilt_rad;
        let down = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), c)
            * Rotation3::from_axis_angle(&Vector3::y_axis(), b)
            * Rotation3::from_axis_angle(&Vector3::x_axis(), a);
        turn.matrix() * down
    }

    /// Ideal image coordinates from plate coordinates.
    fn ideal_from_table(&self) -> Homography {
        let r = self.camera_from_table();
        let t = -r * self.camera_m;
        let (f, p) = (self.lens.focal_px, self.lens.principal_px);
        let k = Matrix3::new(f, 0.0, p.x, 0.0, f, p.y, 0.0, 0.0, 1.0);
        Homography::new(k * Matrix3::from_columns(&[r.column(0).into(), r.column(1).into(), t]))
    }

    pub(super) fn image_from_table(&self, p_m: Vec2) -> Vec2 {
        self.lens.image_from_ideal(self.ideal_from_table().apply(p_m))
    }

    /// True corners, clockwise from top left, px.
    pub(super) fn corners_px(&self) -> [Vec2; 4] {
        [(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)]
            .map(|(x, y)| self.image_from_table(Vec2::new(x, y) * (SIDE_M / 2.0)))
    }

    pub(super) fn frame(&self, discs: &[Disc]) -> Frame {
        let [width, height] = self.size;
        let mut levels = self.areas(discs);
        for (i, level) in levels.iter_mut().enumerate() {
            let (x, y) = ((i % width) as f64 / width as f64, (i / width) as f64 / height as f64);
            *level *= 1.0 - self.shading * (0.7 * x + 0.3 * y);
        }
        blur(&mut levels, width, height, self.blur_px);
        let mut rng = Streams::new(self.seed).stream("test camera");
        let noise = Normal::new(0.0, self.noise).unwrap();
        let mut frame = Frame::new(width, height);
        for (pixel, level) in frame.pixels.iter_mut().zip(&levels) {
            let noise = if self.noise > 0.0 { noise.sample(&mut rng) } else { 0.0 };
            *pixel = (level + noise).round().clamp(0.0, 255.0) as u8;
        }
        frame
    }

    /// Gray level by the area of each pixel that ground, plate and discs cover: 12 × 12 points where they meet.
    fn areas(&self, discs: &[Disc]) -> Vec<f64> {
        let [width, height] = self.size;
        let table_from_ideal = self.ideal_from_table().inverse().unwrap();
        let seen = |x: f64, y: f64| {
            let p = Vec2::new(x, y);
            table_from_ideal.apply(if self.lens.is_ideal() { p } else { self.lens.ideal_from_image(p) })
        };
        let shadows: Vec<_> = discs.iter().map(|disc| Shadow::new(disc, self.camera_m)).collect();
        // Exact every 4 px, bilinear between: off by less than 0.001 px for the lenses used here.
        let (columns, rows) = (width / 4 + 2, height / 4 + 2);
        let exact: Vec<Vec2> = (0..columns * rows)
            .map(|i| seen((i % columns) as f64 * 4.0 - 0.5, (i / columns) as f64 * 4.0 - 0.5))
            .collect();
        let at = |x: usize, y: usize| {
            let (i, u, v) = (y / 4 * columns + x / 4, (x % 4) as f64 / 4.0, (y % 4) as f64 / 4.0);
            (exact[i] * (1.0 - u) + exact[i + 1] * u) * (1.0 - v)
                + (exact[i + columns] * (1.0 - u) + exact[i + columns + 1] * u) * v
        };
        let mut levels = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                levels.push(self.pixel([at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)], &shadows));
            }
        }
        levels
    }

    fn pixel(&self, corners: [Vec2; 4], shadows: &[Shadow]) -> f64 {
        let middle = (corners[0] + corners[3]) / 2.0;
        let reach = (corners[0] - corners[3]).norm();
        let plate = SIDE_M / 2.0 - middle.amax();
        let near = shadows.iter().find(|s| s.depth(middle).abs() < reach);
        let level = |p: Vec2| {
            if shadows.iter().any(|s| s.depth(p) > 0.0) {
                self.levels[2]
            } else {
                self.levels[usize::from(p.amax() < SIDE_M / 2.0)]
            }
        };
        if plate.abs() > reach && near.is_none() {
            return level(middle);
        }
        let n = 12;
        let mut sum = 0.0;
        for i in 0..n * n {
            // Sheared both ways: 144 different columns and rows, so that edges along the pixels are seen as finely.
            let (column, row) = (f64::from(i % n) + 0.5 / f64::from(n), f64::from(i / n) + 0.5 / f64::from(n));
            let (u, v) = ((column + f64::from(i / n) / f64::from(n)), (row + f64::from(i % n) / f64::from(n)));
            let (u, v) = (u / f64::from(n), v / f64::from(n));
            let top = corners[0] + (corners[1] - corners[0]) * u;
            let bottom = corners[2] + (corners[3] - corners[2]) * u;
            sum += level(top + (bottom - top) * v);
        }
        sum / f64::from(n * n)
    }
}

/// What a disc hides of the plate's plane: the hull of its foot and of its top as the camera projects it.
struct Shadow {
    foot: Vec2,
    radius: f64,
    top: Vec2,
    top_radius: f64,
}

impl Shadow {
    fn new(disc: &Disc, camera_m: Vector3<f64>) -> Self {
        let scale = camera_m.z / (camera_m.z - disc.thickness_m);
        let top = camera_m.xy() + (disc.at_m - camera_m.xy()) * scale;
        Self { foot: disc.at_m, radius: disc.radius_m, top, top_radius: disc.radius_m * scale }
    }

    /// How deep inside the hull `p` is, m: over the discs between foot and top, the nearest one's.
    fn depth(&self, p: Vec2) -> f64 {
        let far = (p - self.foot).amax() - 1.2 * self.radius;
        if far > 0.0 {
            return -far - 0.1 * self.radius;
        }
        let axis = self.top - self.foot;
        let t = if axis.norm() > 0.0 { (p - self.foot).dot(&axis) / axis.norm_squared() } else { 1.0 };
        [0.0, 1.0, t.clamp(0.0, 1.0)]
            .map(|t| self.radius + t * (self.top_radius - self.radius) - (p - self.foot - axis * t).norm())
            .into_iter()
            .fold(f64::NEG_INFINITY, f64::max)
    }
}

fn blur(levels: &mut [f64], width: usize, height: usize, sd: f64) {
    if sd <= 0.0 {
        return;
    }
    let reach = (4.0 * sd).ceil() as i64;
    let taps: Vec<f64> = (-reach..=reach).map(|k| (-0.5 * (k as f64 / sd).powi(2)).exp()).collect();
    let sum: f64 = taps.iter().sum();
    let mut across = vec![0.0; levels.len()];
    for (to, from) in across.chunks_exact_mut(width).zip(levels.chunks_exact(width)) {
        for (x, value) in to.iter_mut().enumerate() {
            let at = |k: i64| from[(x as i64 + k).clamp(0, width as i64 - 1) as usize];
            *value = (-reach..=reach).zip(&taps).map(|(k, tap)| at(k) * tap / sum).sum();
        }
    }
    levels.fill(0.0);
    for (y, to) in levels.chunks_exact_mut(width).enumerate() {
        for (k, tap) in (-reach..=reach).zip(&taps) {
            let row = (y as i64 + k).clamp(0, height as i64 - 1) as usize;
            to.iter_mut().zip(&across[row * width..][..width]).for_each(|(to, from)| *to += from * tap / sum);
        }
    }
}
