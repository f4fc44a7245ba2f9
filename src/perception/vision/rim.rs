//! Subpixel position of a part from its rim.
//!
//! Rays start at an estimated centre; along each the gray level crosses half-way between part and plate. Rays and
//! crossings are kept in plate coordinates, where foot and top of a disc are circles whatever the lens and the tilt:
//! the outline of a disc of radius r and height h in the picture is the hull of its foot (c, r) and of its top (c + δ,
//! r (1 + e)), `e = h / (H - h)`, `δ = e (c - camera)`. To first order in δ/r the hull is `max(0, e r + δ·u)` beyond
//! the foot in direction u. That is subtracted from every crossing, and the circle fitted to the result is the foot
//! itself.

pub(super) mod map;
pub(super) mod ring;

use nalgebra::Matrix2;

use self::map::{LocalMap, outline};
pub(super) use self::ring::RAYS;
use self::ring::{PerRay, Rays, ring_quantile, sum};
use super::Table;
use super::sampling::{Sampler, rise_nearest_middle, share_of_rise};
use upm_core::geometry::Vec2;
use upm_core::rig::PartKind;

/// Least contrast between part and plate, levels.
const LEAST_CONTRAST: f32 = 10.0;
/// Largest deviation of levels from the ring's own, as a fraction of the contrast, before a ray counts as disturbed.
const STRAY: f32 = 0.22;
/// A ray is also disturbed when it deviates by more than this many times the ring's median deviation, and by more than
/// this many levels.
const FAR: f32 = 5.0;
const LEAST_FAR: f32 = 4.0;
/// Lower bound of the scatter, px: the accuracy of bilinear sampling.
const LEAST_SD_PX: f64 = 0.02;
/// Error of the centre from pixels and their sampling in a noiseless picture, px.
const SAMPLING_SD_PX: f64 = 0.003;

/// A circle fitted to a rim.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RimFit {
    /// Middle of the part's foot, m.
    pub(super) foot_m: Vec2,
    /// Radius of the foot, m.
    pub(super) radius_m: f64,
    /// Middle and radius of the outline in the picture, px.
    pub(super) center_px: Vec2,
    pub(super) radius_px: f64,
    /// Covariance of the middle along the image's axes.
    pub(super) covariance_px2: Matrix2<f64>,
    /// Rays that agree with the circle.
    pub(super) agreeing: usize,
    /// Bit mask of the rays, set where the crossing is near the circle.
    pub(super) near: u64,
    /// Gray levels just outside and just inside the rim.
    pub(super) plate_level: f32,
    pub(super) part_level: f32,
}

impl RimFit {
    /// Directions, from the foot, of the longest run of adjacent rays without a crossing near the circle.
    pub(super) fn gap(&self) -> impl Iterator<Item = Vec2> + use<> {
        let (mut widest, mut run) = ((0, 0), 0);
        for k in 0..2 * RAYS {
            run = if self.near >> (k % RAYS) & 1 == 1 { 0 } else { (run + 1).min(RAYS) };
            if run > widest.1 {
                widest = (k + 1 - run, run);
            }
        }
        (widest.0..widest.0 + widest.1).map(|k| ring::direction(k % RAYS))
    }
}

/// Fits rims of parts darker than the plate, or of lighter ones.
pub(super) struct RimFinder {
    rays: Rays,
    /// 1 for parts darker than the plate, -1 for lighter ones.
    sign: f32,
}

/// Levels around the ring just inside and just outside the rim.
struct RingLevels {
    inner: PerRay,
    outer: PerRay,
    /// Mean level inside the rim; `plate` outside.
    part: f32,
    plate: f32,
    /// 1 for rays whose ends fit these levels, else 0.
    usable: PerRay,
    /// Variance of the half-way level at one ray.
    variance: f64,
}

/// Crossings of the rays with the rim.
struct Crossings {
    /// In samples from the first; 0 without a crossing.
    samples: PerRay,
    /// 1 where there is a crossing, else 0.
    present: PerRay,
    /// Mean rise from one sample to the next, levels.
    slope: f64,
}

impl RimFinder {
    pub(super) fn new(dark_parts: bool) -> Self {
        Self { rays: Rays::new(), sign: if dark_parts { 1.0 } else { -1.0 } }
    }

    /// Fits the rim of a part of `kind` whose foot is near `foot_m` from `N` samples along each ray, over `reach_px` to
    /// both sides of the expected rim; `None` when too few rays agree on a circle.
    pub(super) fn fit<const N: usize>(
        &self,
        sampler: &Sampler,
        table: &Table,
        kind: &PartKind,
        foot_m: Vec2,
        reach_px: f64,
    ) -> Option<RimFit> {
        let radius = kind.radius_m;
        let (shift, growth) = table.parallax(foot_m, kind.thickness_m);
        let (offset, swell) = outline(shift / radius, growth);
        let origin_m = foot_m + offset * radius;
        let map = LocalMap::new(table, origin_m, radius)?;
        let radius_px = map.radius_px();
        let reach = reach_px / radius_px;
        if !(radius_px > 1.0 && reach < 0.9) {
            return None;
        }
        let first = 1.0 + swell - reach;
        let step = 2.0 * reach / (N as f64 - 1.0);

        let mut profiles = [[0.0f32; N]; RAYS];
        let mut on_plate = [1.0f32; RAYS];
        let near_edge = !table.holds(origin_m, radius * (1.0 + swell + reach));
        for ((ray, profile), on_plate) in self.rays.directions.iter().zip(&mut profiles).zip(&mut on_plate) {
            let last = first + 2.0 * reach;
            if near_edge && !table.holds(origin_m + ray * (radius * last), radius * 1.5 / radius_px) {
                *on_plate = 0.0;
            } else {
                *profile = self.look_along(sampler, &map, *ray, [first, last]);
            }
        }
        let levels = self.ring_levels(&profiles, &on_plate)?;
        let crossings = crossings(&mut profiles, &levels);
        let (x, y) = (shift.x / radius, shift.y / radius);
        let radii: PerRay = std::array::from_fn(|k| {
            let ray = self.rays.directions[k];
            let excess = (growth + x * ray.x + y * ray.y).max(0.0);
            (first + step * f64::from(crossings.samples[k]) - excess) as f32
        });
        let circle = self.rays.circle(&radii, &crossings.present, -offset, (LEAST_SD_PX / radius_px) as f32)?;

        let foot_m = origin_m + circle.center * radius;
        let (shift, growth) = table.parallax(foot_m, kind.thickness_m);
        let (offset, swell) = outline(shift / radius, growth);
        let level_shift = levels.variance * (step / crossings.slope).powi(2);
        let covariance = circle.covariance * (circle.variance + level_shift);
        let covariance_px2 = map.covariance_px2(covariance) + Matrix2::from_diagonal_element(SAMPLING_SD_PX.powi(2));
        covariance_px2.iter().all(|x| x.is_finite()).then_some(RimFit {
            foot_m,
            radius_m: radius * circle.radius,
            center_px: map.middle_of_circle(circle.center + offset, circle.radius + swell),
            radius_px: radius_px * (circle.radius + swell),
            covariance_px2,
            agreeing: circle.agreeing,
            near: circle.near,
            plate_level: self.sign * levels.plate,
            part_level: self.sign * levels.part,
        })
    }

    /// Levels along a ray between two distances in radii; the ray's small curvature in the picture is neglected.
    fn look_along<const N: usize>(&self, sampler: &Sampler, map: &LocalMap, ray: Vec2, ends: [f64; 2]) -> [f32; N] {
        let (linear, square) = map.along(ray);
        let [from, to] = ends.map(|s| map.origin + (linear + square * s) * s);
        sampler.profile::<N>(from, to).map(|level| level * self.sign)
    }

    /// Levels just inside and just outside the rim, each a constant and a slope. Rays whose ends do not fit are
    /// unusable: a neighbour, a speck, the plate's edge.
    fn ring_levels<const N: usize>(&self, profiles: &[[f32; N]; RAYS], on_plate: &PerRay) -> Option<RingLevels> {
        let inside: PerRay = std::array::from_fn(|k| (profiles[k][0] + profiles[k][1]) / 2.0);
        let outside: PerRay = std::array::from_fn(|k| (profiles[k][N - 1] + profiles[k][N - 2]) / 2.0);
        let within = |usable: &PerRay, inner: &PerRay, outer: &PerRay, most: [f32; 2]| -> PerRay {
            let fits = |k: usize| (inside[k] - inner[k]).abs() < most[0] && (outside[k] - outer[k]).abs() < most[1];
            std::array::from_fn(|k| usable[k] * f32::from(fits(k)))
        };
        let levels = self.levels(&inside, &outside, on_plate)?;
        let stray = |levels: &RingLevels| [STRAY * (levels.plate - levels.part); 2];
        if within(on_plate, &levels.inner, &levels.outer, stray(&levels)) == *on_plate {
            return (levels.plate - levels.part >= LEAST_CONTRAST).then_some(levels);
        }
        let rise: PerRay = std::array::from_fn(|k| outside[k] - inside[k]);
        let least = 0.5 * ring_quantile(&rise, on_plate, 0.75)?;
        let rises: PerRay = std::array::from_fn(|k| on_plate[k] * f32::from(rise[k] > least));
        let (inner, outer) = (ring_quantile(&inside, &rises, 0.5)?, ring_quantile(&outside, &rises, 0.5)?);
        let usable = within(&rises, &[inner; RAYS], &[outer; RAYS], [1.5 * STRAY * (outer - inner); 2]);
        let levels = self.levels(&inside, &outside, &usable)?;
        let usable = within(&usable, &levels.inner, &levels.outer, stray(&levels));
        // A ray that deviates less, but far more than the others, is disturbed too.
        let levels = self.levels(&inside, &outside, &usable)?;
        let far = |values: &PerRay, ring: &PerRay| {
            let off: PerRay = std::array::from_fn(|k| (values[k] - ring[k]).abs());
            Some((FAR * ring_quantile(&off, &usable, 0.5)?).max(LEAST_FAR))
        };
        let most = [far(&inside, &levels.inner)?, far(&outside, &levels.outer)?];
        let levels = self.levels(&inside, &outside, &within(&usable, &levels.inner, &levels.outer, most))?;
        (levels.plate - levels.part >= LEAST_CONTRAST).then_some(levels)
    }

    /// Levels fitted to the ends of the usable rays.
    fn levels(&self, inside: &PerRay, outside: &PerRay, usable: &PerRay) -> Option<RingLevels> {
        let least = ring::LEAST_AGREEING as f64;
        let (part, plate) = (self.rays.fit(inside, usable, least)?, self.rays.fit(outside, usable, least)?);
        let (inner, outer) = (self.rays.values(&part), self.rays.values(&plate));
        let scatter = sum(|k| usable[k] * ((inside[k] - inner[k]).powi(2) + (outside[k] - outer[k]).powi(2)));
        let freedom = (sum(|k| usable[k]) - 3.0).max(1.0);
        let variance = scatter / freedom / 4.0;
        Some(RingLevels { inner, outer, part: part.constant, plate: plate.constant, usable: *usable, variance })
    }
}

/// Crossings of the profiles, smoothed over three samples, with the level half-way between part and plate.
fn crossings<const N: usize>(profiles: &mut [[f32; N]; RAYS], levels: &RingLevels) -> Crossings {
    let (mut before, mut below, mut above) = ([0.0f32; RAYS], [-1.0f32; RAYS], [1.0f32; RAYS]);
    let mut present = [0.0f32; RAYS];
    for (k, profile) in profiles.iter_mut().enumerate().filter(|(k, _)| levels.usable[*k] > 0.0) {
        let level = (levels.inner[k] + levels.outer[k]) / 2.0;
        smooth(profile);
        if let Some(i) = rise_nearest_middle(profile, level) {
            (before[k], below[k], above[k], present[k]) = (i as f32, profile[i] - level, profile[i + 1] - level, 1.0);
        }
    }
    let contrast: PerRay = std::array::from_fn(|k| levels.outer[k] - levels.inner[k]);
    let samples = std::array::from_fn(|k| before[k] + share_of_rise(below[k], above[k], contrast[k]));
    let slope = sum(|k| present[k] * (above[k] - below[k])) / sum(|k| present[k]).max(1.0);
    Crossings { samples, present, slope }
}

/// Smooths by weights of one quarter, a half, one quarter; the ends keep their values.
fn smooth<const N: usize>(profile: &mut [f32; N]) {
    let raw = *profile;
    for i in 1..N - 1 {
        profile[i] = 0.5 * raw[i] + 0.25 * (raw[i - 1] + raw[i + 1]);
    }
}
