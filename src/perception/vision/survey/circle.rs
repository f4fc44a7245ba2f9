//! Measurement of outlines by their sharp edges: along rays from an estimated middle every crest of the gradient may be
//! the rim, and the circle is the one on which most rays have a crest.

use std::array;

use super::super::rim::RAYS;
use super::super::rim::map::LocalMap;
use super::super::rim::ring::{PerRay, Rays};
use super::super::sampling::{Sampler, quantile};
use super::super::{DetectedDisc, Table};
use upm_core::geometry::Vec2;

/// Radial range of the rays about the estimated radius, radii, and number of samples in it.
const REACH: f64 = 0.3;
const SAMPLES: usize = 61;
const STEP: f64 = 2.0 * REACH / (SAMPLES as f64 - 1.0);
/// Length of the two means whose difference is an edge's steepness, as a fraction of the width of the plate's own
/// edges, and its bounds, px.
const MEAN_SHARE: f64 = 0.6;
const MEAN_PX: [f64; 2] = [1.0, 4.0];
/// Most crests kept of a ray, and their least sharpness against the rays' median sharpest and in levels.
const CRESTS: usize = 4;
const LEAST_CREST: f32 = 0.35;
const FAINTEST: f32 = 3.0;
/// Largest distance of a crest from a circle it is on, radii and px.
const ON_CIRCLE: f64 = 0.02;
const ON_CIRCLE_PX: f64 = 0.8;
/// Largest slope along the outline over that across it where an edge is part of it: an angle of 14°.
const ALONG: f32 = 0.25;
const LEAST_SD: f32 = 1e-3;

/// Measurement of outlines in one picture.
pub(super) struct OutlineGauge<'a> {
    sampler: &'a Sampler<'a>,
    table: &'a Table,
    rays: Rays,
    /// Length of the means whose difference is an edge's steepness.
    mean_px: f64,
}

/// A crest of the gradient on a ray.
struct Crest {
    /// Distance from the middle, radii.
    at: f64,
    /// Against the rays' median sharpest, at most 1, less where it is not crisp.
    sharpness: f64,
    /// Fraction of the steepness that is sharp: 1 for a step, 0 for a ramp.
    crispness: f64,
}

/// Crests along all rays about a place, the sharpest of each ray first.
struct Crests {
    map: LocalMap,
    origin_m: Vec2,
    radius_m: f64,
    of_rays: Vec<Vec<Crest>>,
}

impl<'a> OutlineGauge<'a> {
    pub(super) fn new(sampler: &'a Sampler<'a>, table: &'a Table) -> Self {
        let mean_px = (MEAN_SHARE * side_width_px(sampler, table)).clamp(MEAN_PX[0], MEAN_PX[1]);
        Self { sampler, table, rays: Rays::new(), mean_px }
    }

    /// The disc near `at_m` whose radius is within `window` of `radius_m`, as a fraction of it.
    pub(super) fn measure(&self, at_m: Vec2, radius_m: f64, window: f64) -> Option<DetectedDisc> {
        let (center, radius) = self.consensus(&self.crests(at_m, radius_m)?, window)?;
        let disc = self.fit(&self.crests(at_m + center * radius_m, radius * radius_m)?)?;
        self.table.holds(disc.at_m, 0.5 * disc.radius_m).then_some(disc)
    }

    fn crests(&self, origin_m: Vec2, radius_m: f64) -> Option<Crests> {
        let map = LocalMap::new(self.table, origin_m, radius_m)?;
        let radius_px = map.radius_px();
        if !(radius_px > 3.0 && radius_px.is_finite()) {
            return None;
        }
        let half = (self.mean_px / (STEP * radius_px)).round().clamp(1.0, 8.0) as usize;
        let slopes_of = |ray: Vec2| {
            let (linear, square) = map.along(ray);
            let [from, to] = [1.0 - REACH, 1.0 + REACH].map(|s| map.origin + (linear + square * s) * s);
            sharpness(&self.sampler.profile::<SAMPLES>(from, to), half)
        };
        let slopes = self.rays.directions.map(slopes_of);
        let mut tops: [f32; RAYS] = array::from_fn(|k| slopes[k].iter().fold(0.0, |a: f32, v| a.max(v[0])));
        let full = tops.select_nth_unstable_by(RAYS / 2, f32::total_cmp).1.max(FAINTEST);
        let least = (LEAST_CREST * full).max(FAINTEST);
        let of_ray = |k: usize| {
            let mut found: Vec<Crest> = (1..SAMPLES - 1).filter_map(|i| crest(&slopes[k], i, [least, full])).collect();
            found.retain(|crest| self.runs_along(&map, self.rays.directions[k], crest.at));
            found.sort_by(|a, b| b.sharpness.total_cmp(&a.sharpness));
            found.truncate(CRESTS);
            found
        };
        Some(Crests { of_rays: (0..RAYS).map(of_ray).collect(), map, origin_m, radius_m })
    }

    /// True where the edge at a distance along a ray has the direction of the circle through it: an arc has at all
    /// rays, the sides of a square only near four.
    fn runs_along(&self, map: &LocalMap, ray: Vec2, radius: f64) -> bool {
        let (linear, square) = map.along(ray);
        let at = map.origin + (linear + square * radius) * radius;
        let tangent = map.along(Vec2::new(-ray.y, ray.x)).0.normalize();
        let reach = self.mean_px.max(1.5);
        let slope = |step: Vec2| {
            let [after, before] = [at + step * reach, at - step * reach].map(|p| self.sampler.at(p.x, p.y));
            (after - before).abs()
        };
        slope(tangent) <= ALONG * slope(Vec2::new(tangent.y, -tangent.x))
    }

    /// Middle and radius of the circle with most and sharpest crests, from triples of crests a third of a turn apart.
    fn consensus(&self, crests: &Crests, window: f64) -> Option<(Vec2, f64)> {
        const THIRD: usize = RAYS / 3;
        const LIKELY: usize = 3;
        let near = 1.5 * self.on_circle(crests);
        let mut best: Option<(f64, Vec2, f64)> = None;
        for slots in 0..THIRD * LIKELY.pow(3) {
            let slot =
                |i: u32| crests.of_rays[slots % THIRD + i as usize * THIRD].get(slots / THIRD / LIKELY.pow(i) % LIKELY);
            let [Some(a), Some(b), Some(c)] = [0, 1, 2].map(slot) else { continue };
            let radius = (a.at + b.at + c.at) / 3.0;
            let end = |(i, crest): (usize, &&Crest)| self.rays.directions[slots % THIRD + i * THIRD] * crest.at;
            let center = [a, b, c].iter().enumerate().map(end).sum::<Vec2>() * (2.0 / 3.0);
            if (radius - 1.0).abs() <= window {
                let votes = (0..RAYS)
                    .filter_map(|k| self.on(crests, k, center, radius, near))
                    .map(|crest| crest.sharpness)
                    .sum();
                if best.is_none_or(|(most, ..)| votes > most) {
                    best = Some((votes, center, radius));
                }
            }
        }
        best.map(|(_, center, radius)| (center, radius))
    }

    /// The crest of ray `k` nearest to a circle, within `window` of it.
    fn on<'c>(&self, crests: &'c Crests, k: usize, center: Vec2, radius: f64, window: f64) -> Option<&'c Crest> {
        let wanted = radius + center.dot(&self.rays.directions[k]);
        let off = |crest: &Crest| (crest.at - wanted).abs();
        crests.of_rays[k].iter().filter(|crest| off(crest) <= window).min_by(|a, b| off(a).total_cmp(&off(b)))
    }

    /// Largest distance of a crest from a circle it is on, radii.
    fn on_circle(&self, crests: &Crests) -> f64 {
        ON_CIRCLE.max(ON_CIRCLE_PX.max(0.5 * self.mean_px) / crests.map.radius_px())
    }

    /// The disc about the rays' origin whose circle goes through the crests.
    fn fit(&self, crests: &Crests) -> Option<DetectedDisc> {
        let (mut center, mut radius) = (Vec2::zeros(), 1.0);
        let near = self.on_circle(crests);
        for window in [3.0, 2.0, 1.5] {
            let chosen: [Option<&Crest>; RAYS] = array::from_fn(|k| self.on(crests, k, center, radius, window * near));
            let present: PerRay = chosen.map(|crest| f32::from(u8::from(crest.is_some())));
            let radii = chosen.map(|crest| crest.map_or(0.0, |crest| crest.at as f32));
            let circle = self.rays.circle(&radii, &present, center, LEAST_SD)?;
            (center, radius) = (circle.center, circle.radius);
        }
        let (at_m, radius_m) = (crests.origin_m + center * crests.radius_m, radius * crests.radius_m);
        let edge_m = 1.5 / self.table.px_per_m_at(at_m);
        let on_plate = |k: &usize| self.table.holds(at_m + self.rays.directions[*k] * (1.02 * radius_m), edge_m);
        let seen = (0..RAYS).filter(on_plate).filter_map(|k| self.on(crests, k, center, radius, near));
        let mut crispness: Vec<f64> = seen.map(|crest| crest.crispness).collect();
        let open = (0..RAYS).filter(on_plate).count().max(RAYS / 2);
        Some(DetectedDisc {
            center_px: crests.map.middle_of_circle(center, radius),
            radius_px: crests.map.radius_px() * radius,
            at_m,
            radius_m,
            outline_share: crispness.len() as f64 / open as f64,
            crispness: quantile(&mut crispness, 0.5),
        })
    }
}

/// The crest at sample `i` of a ray if it reaches `least`; a sharpness of `full` counts as 1.
fn crest(slopes: &[[f32; 2]; SAMPLES], i: usize, [least, full]: [f32; 2]) -> Option<Crest> {
    let [before, here, after] = [i - 1, i, i + 1].map(|i| slopes[i][0]);
    let off = f64::from(0.5 * (after - before) / (2.0 * here - after - before));
    let crispness = f64::from(slopes[i][1]);
    (here >= least && here >= before && here > after).then(|| Crest {
        at: 1.0 - REACH + STEP * (i as f64 + off),
        sharpness: f64::from((here / full).min(1.0)) * crispness,
        crispness,
    })
}

/// Width of the plate's own edges, px: their rise over their steepest slope, the median over places all around.
fn side_width_px(sampler: &Sampler, table: &Table) -> f64 {
    const PLACES: usize = 8;
    const ACROSS_PX: f64 = 10.0;
    let width_at = |place: usize| {
        let (from, to) = (table.corners_px[place % 4], table.corners_px[(place + 1) % 4]);
        let across = Vec2::new(to.y - from.y, from.x - to.x).normalize() * ACROSS_PX;
        let at = from + (to - from) * ((place / 4 + 1) as f64 / (PLACES + 1) as f64);
        let levels = sampler.along::<41>(at - across, at + across)?;
        let steepest = levels.windows(3).map(|w| (w[2] - w[0]).abs() / 2.0).fold(f32::MIN_POSITIVE, f32::max);
        Some(f64::from((levels[40] - levels[0]).abs() / steepest) * 2.0 * ACROSS_PX / 40.0)
    };
    quantile(&mut (0..4 * PLACES).filter_map(width_at).collect::<Vec<f64>>(), 0.5)
}

/// Sharpness and crispness of every sample. Sharpness is how much more steeply the level changes at a place than around
/// it: twice the difference between the means of the `half` samples after and before, less that of twice as many. It is
/// 0 on a ramp, such as a soft shadow. Crispness is its fraction of the steepness. 0 at the ends.
fn sharpness(levels: &[f32; SAMPLES], half: usize) -> [[f32; 2]; SAMPLES] {
    let mut sums = [0.0f32; SAMPLES + 1];
    for (i, level) in levels.iter().enumerate() {
        sums[i + 1] = sums[i] + level;
    }
    let difference = |i: usize, half: usize| {
        let (before, after) = (sums[i] - sums[i - half], sums[i + half + 1] - sums[i + 1]);
        (after - before) / half as f32
    };
    array::from_fn(|i| {
        if i < 2 * half || i + 2 * half >= SAMPLES {
            return [0.0; 2];
        }
        let (near, far) = (difference(i, half), difference(i, 2 * half));
        let sharp = (near.signum() * (2.0 * near - far)).max(0.0);
        [sharp, (sharp / near.abs().max(f32::MIN_POSITIVE)).min(1.0)]
    })
}
