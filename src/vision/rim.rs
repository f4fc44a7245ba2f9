//! A part's place below a pixel, from its rim.
//!
//! Rays leave a guessed centre; along each the gray level crosses half-way between part and plate. Rays and
//! crossings are kept in plate coordinates, where foot and top of a disc are circles whatever the lens and the tilt:
//! what the camera sees of a disc of radius r and height h is the hull of its foot (c, r) and of its top
//! (c + δ, r (1 + e)), `e = h / (H - h)`, `δ = e (c - camera)`. To first order in δ/r the hull is
//! `max(0, e r + δ·u)` beyond the foot in direction u. That is taken off every crossing, and a circle fitted
//! to the rest is the foot itself.

use nalgebra::{Matrix3, Vector3};

use super::Table;
use super::sampling::{Sampler, biweight, rising_crossing};
use crate::geometry::Vec2;

/// Rays about a centre.
pub(super) const RAYS: usize = 36;
/// Fewest rays that must agree on a circle.
pub(super) const LEAST_AGREEING: usize = 9;
/// Least difference between part and plate, levels.
const LEAST_CONTRAST: f32 = 10.0;
/// How far levels may stray from the ring's own, as a part of the contrast, before a ray counts as disturbed.
const STRAY: f32 = 0.22;
/// Narrowest scatter believed, px: bilinear sampling is no truer.
const LEAST_SD_PX: f64 = 0.02;

/// What to look for where.
#[derive(Clone, Copy, Debug)]
pub(super) struct RimGuess {
    /// Where the part's foot may be, m.
    pub(super) foot_m: Vec2,
    pub(super) radius_m: f64,
    pub(super) thickness_m: f64,
    /// How far from the guessed rim it is looked for, px.
    pub(super) reach_px: f64,
}

/// A circle fitted to a rim.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RimFit {
    /// Middle of the part's foot, m.
    pub(super) foot_m: Vec2,
    /// Its radius, m.
    pub(super) radius_m: f64,
    /// Middle and radius of the outline in the picture, px.
    pub(super) center_px: Vec2,
    pub(super) radius_px: f64,
    /// Standard deviation of the middle along an axis, px.
    pub(super) sd_px: f64,
    /// Rays that agree.
    pub(super) agreeing: usize,
    /// Gray levels just outside and just inside the rim.
    pub(super) plate_level: f32,
    pub(super) part_level: f32,
}

/// Directions of the rays.
pub(super) struct RimFinder {
    rays: [Vec2; RAYS],
    /// 1 for parts darker than the plate, -1 for lighter ones.
    sign: f32,
}

/// The picture around a part to second order: `origin + J d + ½ dᵀ H d`, d in radii.
struct LocalMap {
    origin: Vec2,
    x: Vec2,
    y: Vec2,
    xx: Vec2,
    xy: Vec2,
    yy: Vec2,
}

/// The crossing along one ray.
#[derive(Clone, Copy, Default)]
struct Crossing {
    /// In radii from the guessed centre, the hull's excess taken off; not a number where there is none.
    radius: f64,
    weight: f64,
}

impl RimFinder {
    pub(super) fn new(dark_parts: bool) -> Self {
        let rays = std::array::from_fn(|k| {
            let (sin, cos) = ((k as f64 + 0.5) / RAYS as f64 * std::f64::consts::TAU).sin_cos();
            Vec2::new(cos, sin)
        });
        Self { rays, sign: if dark_parts { 1.0 } else { -1.0 } }
    }

    /// Fits the rim near `guess` from `N` samples along each ray; `None` when too few rays agree on a circle.
    pub(super) fn fit<const N: usize>(&self, sampler: &Sampler, table: &Table, guess: &RimGuess) -> Option<RimFit> {
        let radius = guess.radius_m;
        let (shift, growth) = table.parallax(guess.foot_m, guess.thickness_m);
        let (offset, swell) = outline(shift / radius, growth);
        let origin_m = guess.foot_m + offset * radius;
        let map = LocalMap::new(table, origin_m, radius);
        let radius_px = (map.x.x * map.y.y - map.x.y * map.y.x).abs().sqrt();
        let reach = guess.reach_px / radius_px;
        if !(radius_px > 1.0 && reach < 0.9 && map.is_finite()) {
            return None;
        }
        let first = 1.0 + swell - reach;
        let step = 2.0 * reach / (N as f64 - 1.0);

        let mut profiles = [[0.0f32; N]; RAYS];
        let near_edge = !table.holds(origin_m, radius * (1.0 + swell + reach));
        let mut usable = [true; RAYS];
        for ((ray, profile), usable) in self.rays.iter().zip(&mut profiles).zip(&mut usable) {
            let farthest = origin_m + ray * (radius * (first + step * (N as f64 - 1.0)));
            if near_edge && !table.holds(farthest, radius * 1.5 / radius_px) {
                *usable = false;
                continue;
            }
            self.look_along(sampler, &map, *ray, [first, first + step * (N as f64 - 1.0)], profile);
        }
        let (inner, outer) = self.ring_levels(&profiles, &mut usable)?;

        let mut crossings = [Crossing { radius: f64::NAN, weight: 0.0 }; RAYS];
        for (k, crossing) in crossings.iter_mut().enumerate().filter(|(k, _)| usable[*k]) {
            let ray = self.rays[k];
            if let Some(at) = rising_crossing(&profiles[k], inner.at(ray), outer.at(ray)) {
                let excess = (growth + shift.dot(&ray) / radius).max(0.0);
                *crossing = Crossing { radius: first + step * at - excess, weight: 1.0 };
            }
        }
        let circle = self.circle(&mut crossings, -offset, LEAST_SD_PX / radius_px)?;
        let foot_m = origin_m + circle.center * radius;
        let radius_m = radius * circle.radius;
        let (shift, growth) = table.parallax(foot_m, guess.thickness_m);
        let (offset, swell) = outline(shift / radius, growth);
        Some(RimFit {
            foot_m,
            radius_m,
            center_px: map.middle_of_circle(circle.center + offset, circle.radius + swell),
            radius_px: radius_px * (circle.radius + swell),
            sd_px: circle.sd * radius_px,
            agreeing: circle.agreeing,
            plate_level: self.sign * outer.constant,
            part_level: self.sign * inner.constant,
        })
    }

    /// Levels along a ray between two distances in radii; the little it bends is left out.
    fn look_along<const N: usize>(
        &self,
        sampler: &Sampler,
        map: &LocalMap,
        ray: Vec2,
        ends: [f64; 2],
        out: &mut [f32; N],
    ) {
        let (linear, square) = map.along(ray);
        let [from, to] = ends.map(|s| map.origin + (linear + square * s) * s);
        *out = sampler.along::<N>(from, to).unwrap_or_else(|| {
            std::array::from_fn(|k| {
                let p = from + (to - from) * (k as f64 / (N as f64 - 1.0));
                sampler.at(p.x, p.y)
            })
        });
        out.iter_mut().for_each(|level| *level *= self.sign);
    }

    /// Levels just inside and just outside the rim, each a constant and a slope; marks rays unusable whose ends
    /// do not fit: a neighbour, a speck, the plate's edge.
    fn ring_levels<const N: usize>(
        &self,
        profiles: &[[f32; N]; RAYS],
        usable: &mut [bool; RAYS],
    ) -> Option<(RingLevel, RingLevel)> {
        let inside: [f32; RAYS] = std::array::from_fn(|k| (profiles[k][0] + profiles[k][1]) / 2.0);
        let outside: [f32; RAYS] = std::array::from_fn(|k| (profiles[k][N - 1] + profiles[k][N - 2]) / 2.0);
        let inner = ring_quantile(&inside, usable, 0.5)?;
        let outer = ring_quantile(&outside, usable, 0.75)?;
        let contrast = outer - inner;
        if contrast < LEAST_CONTRAST {
            return None;
        }
        for (k, usable) in usable.iter_mut().enumerate() {
            *usable &= (inside[k] - inner).abs() < 1.5 * STRAY * contrast
                && (outside[k] - outer).abs() < 1.5 * STRAY * contrast;
        }
        let (inner, outer) = (self.level(&inside, usable)?, self.level(&outside, usable)?);
        for (k, usable) in usable.iter_mut().enumerate() {
            let ray = self.rays[k];
            *usable &= (inside[k] - inner.at(ray)).abs() < STRAY * contrast
                && (outside[k] - outer.at(ray)).abs() < STRAY * contrast;
        }
        Some((inner, outer))
    }

    fn level(&self, values: &[f32; RAYS], usable: &[bool; RAYS]) -> Option<RingLevel> {
        let mut sums = Normal::default();
        for k in (0..RAYS).filter(|&k| usable[k]) {
            sums.add(self.rays[k], f64::from(values[k]), 1.0);
        }
        let (x, _) = sums.solve(LEAST_AGREEING as f64)?;
        Some(RingLevel { constant: x[0] as f32, slope_x: x[1] as f32, slope_y: x[2] as f32 })
    }

    /// Robust circle through the crossings: `ρ_k + (c × u_k)² / 2 = R + c·u_k`, by least squares with biweights.
    fn circle(&self, crossings: &mut [Crossing; RAYS], start: Vec2, least_sd: f64) -> Option<Circle> {
        const ROUNDS: usize = 3;
        let mut scratch = [0.0f64; RAYS];
        let (mut center, mut found) = (start, None);
        for _ in 0..ROUNDS {
            let bend = |ray: Vec2| 0.5 * (center.x * ray.y - center.y * ray.x).powi(2);
            let mut sums = Normal::default();
            for (c, &ray) in crossings.iter().zip(&self.rays).filter(|(c, _)| c.weight > 0.0) {
                sums.add(ray, c.radius + bend(ray), c.weight);
            }
            let (x, covariance) = sums.solve(LEAST_AGREEING as f64 / 3.0)?;
            let residual = |ray: Vec2, c: &Crossing| c.radius + bend(ray) - x[0] - x[1] * ray.x - x[2] * ray.y;
            let rays = &self.rays;
            let scatter = masked_median(&mut scratch, crossings, |k, c| residual(rays[k], c).abs())?;
            let sd = (1.4826 * scatter).max(least_sd);
            let mut agreeing = 0;
            for (c, &ray) in crossings.iter_mut().zip(&self.rays).filter(|(c, _)| !c.radius.is_nan()) {
                c.weight = biweight(residual(ray, c) / sd);
                agreeing += usize::from(c.weight > 0.0);
            }
            center = Vec2::new(x[1], x[2]);
            let spread = ((covariance[(1, 1)] + covariance[(2, 2)]) / 2.0).sqrt();
            found = Some(Circle { center, radius: x[0], sd: sd * spread, agreeing });
        }
        found.filter(|c| c.agreeing >= LEAST_AGREEING && c.radius > 0.0 && c.sd.is_finite() && c.center.norm() < 1.0)
    }
}

/// In radii of the guess.
struct Circle {
    center: Vec2,
    radius: f64,
    sd: f64,
    agreeing: usize,
}

/// A level around a ring: constant and first harmonic.
struct RingLevel {
    constant: f32,
    slope_x: f32,
    slope_y: f32,
}

impl RingLevel {
    fn at(&self, ray: Vec2) -> f32 {
        self.constant + self.slope_x * ray.x as f32 + self.slope_y * ray.y as f32
    }
}

/// Normal equations of `value = a + b·u`.
#[derive(Default)]
struct Normal {
    n: f64,
    x: f64,
    y: f64,
    xx: f64,
    xy: f64,
    yy: f64,
    right: [f64; 3],
}

impl Normal {
    fn add(&mut self, u: Vec2, value: f64, weight: f64) {
        let (wx, wy) = (weight * u.x, weight * u.y);
        self.n += weight;
        self.x += wx;
        self.y += wy;
        self.xx += wx * u.x;
        self.xy += wx * u.y;
        self.yy += wy * u.y;
        self.right[0] += weight * value;
        self.right[1] += wx * value;
        self.right[2] += wy * value;
    }

    /// Solution and inverse of the matrix; `None` below `least` weight or where the rays tell too little.
    fn solve(&self, least: f64) -> Option<(Vector3<f64>, Matrix3<f64>)> {
        let matrix = Matrix3::new(self.n, self.x, self.y, self.x, self.xx, self.xy, self.y, self.xy, self.yy);
        if !(self.n >= least && matrix.determinant() > 1e-4 * self.n.powi(3)) {
            return None;
        }
        let inverse = matrix.try_inverse()?;
        Some((inverse * Vector3::from(self.right), inverse))
    }
}

impl LocalMap {
    fn new(table: &Table, origin_m: Vec2, radius_m: f64) -> Self {
        let at = |x: f64, y: f64| table.image_from_table(origin_m + Vec2::new(x, y) * radius_m);
        let origin = at(0.0, 0.0);
        let (right, left, up, down) = (at(1.0, 0.0), at(-1.0, 0.0), at(0.0, 1.0), at(0.0, -1.0));
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let diagonal = at(half, half) + at(-half, -half);
        let (xx, yy) = ((right + left) / 2.0 - origin, (up + down) / 2.0 - origin);
        let xy = diagonal - origin * 2.0 - xx - yy;
        Self { origin, x: (right - left) / 2.0, y: (up - down) / 2.0, xx, xy, yy }
    }

    fn is_finite(&self) -> bool {
        [self.origin, self.x, self.y, self.xx, self.xy, self.yy].iter().all(|v| v.x.is_finite() && v.y.is_finite())
    }

    /// Linear and quadratic term along a ray.
    fn along(&self, u: Vec2) -> (Vec2, Vec2) {
        (self.x * u.x + self.y * u.y, self.xx * (u.x * u.x) + self.xy * (u.x * u.y) + self.yy * (u.y * u.y))
    }

    /// Middle of the image of a circle, which is not the image of its middle: perspective shifts it.
    fn middle_of_circle(&self, center: Vec2, radius: f64) -> Vec2 {
        let (linear, square) = self.along(center);
        self.origin + linear + square + (self.xx + self.yy) * (0.5 * radius * radius)
    }
}

/// Middle and extra radius of the circle that fits the hull of a unit disc and of its copy moved by `shift` and
/// swollen by `growth`: mean and first harmonic of `max(0, growth + shift cos θ)`.
fn outline(shift: Vec2, growth: f64) -> (Vec2, f64) {
    let size = shift.norm();
    if size <= growth {
        return (shift, growth);
    }
    let angle = (-growth / size).acos();
    let (sin, cos) = angle.sin_cos();
    let first = (2.0 * growth * sin + size * (angle + sin * cos)) / std::f64::consts::PI;
    (shift / size * first, (growth * angle + size * sin) / std::f64::consts::PI)
}

fn ring_quantile(values: &[f32; RAYS], usable: &[bool; RAYS], q: f32) -> Option<f32> {
    let mut kept = [0.0f32; RAYS];
    let mut n = 0;
    for k in (0..RAYS).filter(|&k| usable[k]) {
        kept[n] = values[k];
        n += 1;
    }
    let nth = (n.saturating_sub(1) as f32 * q) as usize;
    (n >= LEAST_AGREEING).then(|| *kept[..n].select_nth_unstable_by(nth, f32::total_cmp).1)
}

fn masked_median(
    scratch: &mut [f64; RAYS],
    crossings: &[Crossing; RAYS],
    value: impl Fn(usize, &Crossing) -> f64,
) -> Option<f64> {
    let mut n = 0;
    for (k, c) in crossings.iter().enumerate().filter(|(_, c)| !c.radius.is_nan()) {
        scratch[n] = value(k, c);
        n += 1;
    }
    (n >= LEAST_AGREEING).then(|| *scratch[..n].select_nth_unstable_by(n / 2, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn outline_is_the_hulls_mean_and_first_harmonic(x in -0.03..0.03f64, y in -0.03..0.03f64, growth in 0.0..0.02f64) {
            let shift = Vec2::new(x, y);
            let n = 20_000;
            let (mut mean, mut first) = (0.0, Vec2::zeros());
            for k in 0..n {
                let (sin, cos) = (f64::from(k) / f64::from(n) * std::f64::consts::TAU).sin_cos();
                let beyond = (growth + x * cos + y * sin).max(0.0);
                mean += beyond / f64::from(n);
                first += Vec2::new(cos, sin) * (2.0 * beyond / f64::from(n));
            }
            let (middle, extra) = outline(shift, growth);
            prop_assert!((middle - first).norm() < 1e-6 && (extra - mean).abs() < 1e-6);
        }
    }
}
