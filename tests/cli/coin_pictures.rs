//! Pictures of coins on a plate, ray traced with supersampling. They share no code with the program and have a separate
//! pinhole camera, coins with a face, a raised rim and a side wall, an area light with soft shadows, uneven light, blur
//! and noise. Tests are hardly optimised: what is done for every ray has few calls.

use std::f64::consts::TAU;

use image::{Rgb, RgbImage};

/// Rays along each side of a pixel.
const RAYS: u32 = 4;
/// Distance from a coin beyond which its shadow vanishes, and distance from an outline beyond which one ray per pixel
/// is enough, mm.
const NEAR_MM: f64 = 16.0;
const OUTLINE_MM: f64 = 2.0;
/// Colours of the white plate and the dark ground.
const PLATE: [f64; 3] = [232.0, 229.0, 223.0];
const GROUND: [f64; 3] = [46.0, 48.0, 52.0];

/// Metal of a surface, with its colour under full light.
#[derive(Clone, Copy)]
pub(super) enum Metal {
    Silver,
    Copper,
    /// Copper that has turned brown.
    Brown,
    Brass,
}

impl Metal {
    fn color(self) -> [f64; 3] {
        match self {
            Self::Silver => [158.0, 158.0, 154.0],
            Self::Copper => [158.0, 104.0, 74.0],
            Self::Brown => [104.0, 72.0, 54.0],
            Self::Brass => [176.0, 150.0, 88.0],
        }
    }
}

/// A disc on the plate; lengths in mm, x to the right and y up from the plate's middle.
#[derive(Clone, Copy)]
pub(super) struct Coin {
    /// Name of its kind; `None` for a kind that the program does not know.
    pub name: Option<&'static str>,
    pub diameter_mm: f64,
    pub height_mm: f64,
    pub metal: Metal,
    pub at_mm: [f64; 2],
}

impl Coin {
    /// Distance of a place from the outline, negative inside it, mm.
    fn off_mm(&self, [x, y]: [f64; 2]) -> f64 {
        (x - self.at_mm[0]).hypot(y - self.at_mm[1]) - self.diameter_mm / 2.0
    }
}

/// Ground that the coins lie on.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Surface {
    /// A white plate on dark ground.
    Plate,
    Cloth,
    Wood,
    Paper,
}

impl Surface {
    /// Colour at a place of the surface.
    fn color(self, [x, y]: [f64; 2]) -> [f64; 3] {
        match self {
            Self::Plate => PLATE,
            Self::Cloth => [52.0, 66.0, 96.0].map(|c| c * (1.0 + 0.25 * (8.0 * x).sin() * (8.0 * y).sin())),
            Self::Wood => {
                let ring = (0.9 * y + 1.5 * (0.05 * x).sin() + 0.4 * (0.31 * x + 0.7 * y).sin()).sin();
                [196.0, 150.0, 104.0].map(|c| c * (1.0 + 0.12 * ring + 0.04 * (5.0 * y).sin()))
            }
            Self::Paper => [226.0, 224.0, 216.0].map(|c| if y.rem_euclid(8.0) < 0.3 { 0.75 * c } else { c }),
        }
    }
}

/// A picture to be rendered.
#[derive(Clone)]
pub(super) struct CoinPicture {
    pub seed: u64,
    pub size_px: [u32; 2],
    pub side_mm: f64,
    pub surface: Surface,
    /// Focal length in picture widths, and the plate's side as a share of the picture's height.
    pub focal_widths: f64,
    pub side_share: f64,
    /// Tilt about the picture's x and y axes and turn in its plane, degrees.
    pub tilt_deg: [f64; 3],
    pub coins: Vec<Coin>,
    /// Darkness of a shadow's core, its offset from the coin and the softness of its edge, mm.
    pub shadow: f64,
    pub shadow_at_mm: [f64; 2],
    pub softness_mm: f64,
    /// Decrease of the light from one end of the plate to the other, and from its middle to its corners.
    pub fall: f64,
    pub fall_direction: f64,
    pub vignette: f64,
    pub blur_px: f64,
    pub noise_sd: f64,
    pub gray: bool,
}

impl CoinPicture {
    /// The rendered picture.
    pub fn drawn(&self) -> RgbImage {
        let [width, height] = self.size_px;
        let camera = Camera::of(self);
        let pixel = |i: u32| self.pixel(&camera, f64::from(i % width), f64::from(i / width));
        let levels: Vec<[f64; 3]> = (0..width * height).map(pixel).collect();
        let levels = blurred(levels, width as usize, self.blur_px);
        let mut rng = Rng(self.seed);
        RgbImage::from_fn(width, height, |x, y| {
            let [r, g, b] = levels[(y * width + x) as usize];
            let colour = if self.gray { [0.299 * r + 0.587 * g + 0.114 * b; 3] } else { [r, g, b] };
            let common = rng.normal();
            let noise = [(); 3].map(|()| if self.gray { common } else { rng.normal() });
            let level = |c: usize| (colour[c] + self.noise_sd * noise[c]).round().clamp(0.0, 255.0) as u8;
            Rgb([level(0), level(1), level(2)])
        })
    }

    /// Image positions of the middles of the coins' tops, px.
    pub fn centers_px(&self) -> Vec<[f64; 2]> {
        let camera = Camera::of(self);
        self.coins.iter().map(|coin| camera.seen_at([coin.at_mm[0], coin.at_mm[1], coin.height_mm])).collect()
    }

    /// Mean colour of a pixel: one ray if its neighbourhood is smooth, else many.
    fn pixel(&self, camera: &Camera, x: f64, y: f64) -> [f64; 3] {
        let foot = camera.plate_point(x, y, 0.0);
        let off = |coin: &&Coin| coin.off_mm(foot);
        let near: Vec<&Coin> = self.coins.iter().filter(|coin| off(coin) < NEAR_MM).collect();
        let to_side = foot.map(|v| (v.abs() - self.side_mm / 2.0).abs());
        let is_smooth = near.iter().all(|coin| off(coin) > OUTLINE_MM) && to_side.iter().all(|&off| off > OUTLINE_MM);
        let rays = if is_smooth && self.surface == Surface::Plate { 1 } else { RAYS };
        let mut sum = [0.0; 3];
        for k in 0..rays * rays {
            let off = |k: u32| (f64::from(k) + 0.5) / f64::from(rays) - 0.5;
            let color = self.seen(camera, &near, x + off(k % rays), y + off(k / rays));
            (0..3).for_each(|c| sum[c] += color[c] / f64::from(rays * rays));
        }
        sum
    }

    /// Colour on one ray, given the coins that are `near`.
    fn seen(&self, camera: &Camera, near: &[&Coin], x: f64, y: f64) -> [f64; 3] {
        let at_height = |h: f64| camera.plate_point(x, y, h);
        let foot = at_height(0.0);
        for coin in near {
            let top = at_height(coin.height_mm);
            // all heights of the coin are seen between these two places
            let may_meet = coin.off_mm(foot) < (top[0] - foot[0]).hypot(top[1] - foot[1]) + 1e-6;
            if may_meet && coin.off_mm(top) <= 0.0 {
                return self.lit(top, self.face(coin, top), 1.0);
            }
            if may_meet && (0..6).any(|k| coin.off_mm(at_height(coin.height_mm * f64::from(k) / 6.0)) <= 0.0) {
                return self.lit(top, coin.metal.color().map(|c| 0.8 * c), 1.0);
            }
        }
        let half = self.side_mm / 2.0;
        if self.surface == Surface::Plate && (foot[0].abs() > half || foot[1].abs() > half) {
            return self.lit(foot, GROUND, 1.0);
        }
        let light: f64 = near.iter().map(|coin| self.shade(coin, foot)).product();
        self.lit(foot, self.surface.color(foot), light)
    }

    /// Colour of a coin's face: a raised rim, a portrait, letters, a sheen across it.
    fn face(&self, coin: &Coin, at: [f64; 2]) -> [f64; 3] {
        let radius = coin.diameter_mm / 2.0;
        let [u, v] = [0, 1].map(|i| (at[i] - coin.at_mm[i]) / radius);
        let (r, turn) = (u.hypot(v), v.atan2(u));
        let phase = coin.at_mm[0] + 2.0 * coin.at_mm[1];
        let rim = if r > 0.93 { 0.10 } else { 0.0 };
        let letters = if (0.74..0.86).contains(&r) && (turn * 17.0 + phase).sin() > 0.2 { -0.14 } else { 0.0 };
        let portrait =
            if (u / 0.42).hypot((v - 0.05) / 0.55) < 1.0 { 0.09 + 0.05 * (9.0 * u + phase).sin() } else { 0.0 };
        let sheen = 0.10 * (u * self.fall_direction.cos() + v * self.fall_direction.sin());
        coin.metal.color().map(|c| c * (1.0 + rim + letters + portrait + sheen))
    }

    /// Light on the plate beside a coin: a shadow to one side, and a dim line at the contact of coin and plate.
    fn shade(&self, coin: &Coin, [x, y]: [f64; 2]) -> f64 {
        let off = |[dx, dy]: [f64; 2]| (x - coin.at_mm[0] - dx).hypot(y - coin.at_mm[1] - dy) - coin.diameter_mm / 2.0;
        let soft = |off: f64, width: f64| 1.0 / (1.0 + (4.0 * off / width.max(0.05)).exp());
        let cast = self.shadow * soft(off(self.shadow_at_mm), self.softness_mm);
        let contact = 0.4 * self.shadow * soft(off([0.0, 0.0]), 0.8 * self.softness_mm);
        (1.0 - cast) * (1.0 - contact)
    }

    fn lit(&self, [x, y]: [f64; 2], [r, g, b]: [f64; 3], light: f64) -> [f64; 3] {
        let (x, y) = (2.0 * x / self.side_mm, 2.0 * y / self.side_mm);
        let along = x * self.fall_direction.cos() + y * self.fall_direction.sin();
        let here = (1.0 - self.fall * (0.5 + 0.35 * along) - self.vignette * 0.5 * (x * x + y * y)).max(0.05);
        [r * light * here, g * light * here, b * light * here]
    }
}

/// A pinhole above the plate.
struct Camera {
    focal_px: f64,
    middle_px: [f64; 2],
    /// Rows: the camera's axes (right, down, forward) in the plate's frame.
    axes: [[f64; 3]; 3],
    at_mm: [f64; 3],
}

impl Camera {
    fn of(picture: &CoinPicture) -> Self {
        let [width, height] = picture.size_px.map(f64::from);
        let focal_px = picture.focal_widths * width;
        let [a, b, c] = picture.tilt_deg.map(f64::to_radians);
        let turned = |axis: [f64; 3]| turn(turn(turn(axis, 0, a), 1, b), 2, c);
        let axes = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]].map(turned);
        let distance = focal_px * picture.side_mm / (picture.side_share * height);
        let at_mm = axes[2].map(|forward| -forward * distance);
        Self { focal_px, middle_px: [(width - 1.0) / 2.0, (height - 1.0) / 2.0], axes, at_mm }
    }

    /// Intersection of the ray through a pixel with the plane at height `h` above the plate.
    fn plate_point(&self, x: f64, y: f64, h: f64) -> [f64; 2] {
        let (u, v) = ((x - self.middle_px[0]) / self.focal_px, (y - self.middle_px[1]) / self.focal_px);
        let [right, down, forward] = &self.axes;
        let ray = |i: usize| u * right[i] + v * down[i] + forward[i];
        let far = (h - self.at_mm[2]) / ray(2);
        [self.at_mm[0] + far * ray(0), self.at_mm[1] + far * ray(1)]
    }

    /// Image position of a point of the plate's frame, px.
    fn seen_at(&self, point_mm: [f64; 3]) -> [f64; 2] {
        let off = [0, 1, 2].map(|i| point_mm[i] - self.at_mm[i]);
        let [right, down, ahead] = self.axes.map(|axis| (0..3).map(|i| axis[i] * off[i]).sum::<f64>());
        [self.middle_px[0] + self.focal_px * right / ahead, self.middle_px[1] + self.focal_px * down / ahead]
    }
}

/// A vector rotated about a coordinate axis.
fn turn(v: [f64; 3], axis: usize, angle: f64) -> [f64; 3] {
    let (sin, cos) = angle.sin_cos();
    let (i, k) = ((axis + 1) % 3, (axis + 2) % 3);
    let mut out = v;
    (out[i], out[k]) = (cos * v[i] - sin * v[k], sin * v[i] + cos * v[k]);
    out
}

/// Gaussian blur over rows and columns, with the border extended.
fn blurred(levels: Vec<[f64; 3]>, width: usize, sd_px: f64) -> Vec<[f64; 3]> {
    let reach = (3.0 * sd_px).ceil() as i64;
    let weights: Vec<f64> = (-reach..=reach).map(|k| (-0.5 * (k as f64 / sd_px.max(1e-6)).powi(2)).exp()).collect();
    let total: f64 = weights.iter().sum();
    let height = levels.len() / width;
    let pass = |from: &[[f64; 3]], across: bool| -> Vec<[f64; 3]> {
        let at = |x: i64, y: i64| {
            from[y.clamp(0, height as i64 - 1) as usize * width + x.clamp(0, width as i64 - 1) as usize]
        };
        let place = |i: usize| ((i % width) as i64, (i / width) as i64);
        let mixed = |i: usize| {
            let ((x, y), mut sum) = (place(i), [0.0; 3]);
            for (k, weight) in (-reach..=reach).zip(&weights) {
                let [r, g, b] = if across { at(x + k, y) } else { at(x, y + k) };
                sum = [sum[0] + weight / total * r, sum[1] + weight / total * g, sum[2] + weight / total * b];
            }
            sum
        };
        (0..from.len()).map(mixed).collect()
    };
    pass(&pass(&levels, true), false)
}

/// Random number generator: splitmix64.
pub(super) struct Rng(pub u64);

impl Rng {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    pub fn within(&mut self, least: f64, most: f64) -> f64 {
        least + (most - least) * (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * self.within(1e-12, 1.0).ln()).sqrt() * self.within(0.0, TAU).cos()
    }
}
