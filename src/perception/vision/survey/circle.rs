//! Measurement of outlines by their sharp edges: along rays from an estimated middle every crest of the gradient may be
//! the rim, and the circle is the one on which most rays have a crest.

use std::array;

use nalgebra::Matrix2;

use super::super::rim::RAYS;
use super::super::rim::map::LocalMap;
use super::super::rim::ring::{PerRay, Rays};
use super::super::sampling::{Sampler, quantile};
use super::super::{DetectedDisc, Table};
use upm_core::geometry::Vec2;

/// Radial range of the rays about the estimated radius, radii, and number of samples in it.
const REACH: f64 = 0.3;
const SAMPLES: usize = 61;
/// Length of the two means whose difference is an edge's steepness, as a fraction of the width of the plate's own
/// edges, and its bounds, px.
const MEAN_SHARE: f64 = 0.6;
const MEAN_PX: [f64; 2] = [0.8, 4.0];
/// Most crests kept of a ray, and their least sharpness against the rays' median sharpest and in levels.
const CRESTS: usize = 4;
const LEAST_CREST: f32 = 0.2;
const FAINTEST: f32 = 3.0;
/// Largest distance of a crest from a circle it is on, radii and px.
const ON_CIRCLE: f64 = 0.02;
const ON_CIRCLE_PX: f64 = 0.8;
/// Bins of distances in which circles are voted for.
const BINS: usize = 128;
/// A middle farther from the estimate than this, radii, is another disc's.
const FARTHEST: f64 = 0.25;
const LEAST_SD: f32 = 1e-3;

/// Measurement of outlines in one picture.
pub(super) struct OutlineGauge<'a> {
    sampler: &'a Sampler<'a>,
    table: &'a Table,
    rays: Rays,
    /// Length of the means whose difference is an edge's steepness.
    mean_px: f64,
}

/// Crests along all rays about a place, sharpest first.
struct Crests {
    map: LocalMap,
    origin_m: Vec2,
    radius_m: f64,
    /// Distances in radii; NaN beyond the last.
    at: [[f32; CRESTS]; RAYS],
    /// Against the rays' median sharpest, at most 1.
    sharpness: [[f32; CRESTS]; RAYS],
    /// Fraction of the steepness that is sharp: 1 for a step, 0 for a ramp.
    crispness: [[f32; CRESTS]; RAYS],
    on_plate: [bool; RAYS],
}

/// A circle among crests, in estimated radii.
#[derive(Clone, Copy)]
struct CircleFit {
    center: Vec2,
    radius: f64,
    covariance: Matrix2<f64>,
    share: f64,
    crispness: f64,
}

impl<'a> OutlineGauge<'a> {
    pub(super) fn new(sampler: &'a Sampler<'a>, table: &'a Table) -> Self {
        let mean_px = (MEAN_SHARE * side_width_px(sampler, table)).clamp(MEAN_PX[0], MEAN_PX[1]);
        Self { sampler, table, rays: Rays::new(), mean_px }
    }

    /// The disc near `at_m` whose radius is within `window` of `radius_m`, as a fraction of it.
    pub(super) fn measure(&self, at_m: Vec2, radius_m: f64, window: f64) -> Option<DetectedDisc> {
        let first = self.crests(at_m, radius_m)?;
        let (center, radius) = self.consensus(&first, window)?;
        let again = self.crests(at_m + center * radius_m, radius * radius_m)?;
        let best = self.fit(&again)?;
        let at_m = again.origin_m + best.center * again.radius_m;
        let measured_m = best.radius * again.radius_m;
        self.table.holds(at_m, 0.5 * measured_m).then(|| DetectedDisc {
            center_px: again.map.middle_of_circle(best.center, best.radius),
            radius_px: again.map.radius_px() * best.radius,
            at_m,
            radius_m: measured_m,
            outline_share: best.share,
            crispness: best.crispness,
            level: 1.0,
            covariance_px2: again.map.covariance_px2(best.covariance),
        })
    }

    /// The discs, their outline shares referred to the outline that the others leave visible.
    pub(super) fn with_mutual_occlusion(&self, discs: Vec<DetectedDisc>) -> Vec<DetectedDisc> {
        let open_share = |disc: &DetectedDisc| {
            let margin_m = 1.5 / self.table.px_per_m_at(disc.at_m) + 0.03 * disc.radius_m;
            let near: Vec<&DetectedDisc> = discs
                .iter()
                .filter(|other| *other != disc)
                .filter(|other| (other.at_m - disc.at_m).norm() < disc.radius_m + other.radius_m + margin_m)
                .collect();
            let is_open = |ray: &&Vec2| {
                let at = disc.at_m + **ray * (disc.radius_m + margin_m);
                near.iter().all(|other| (other.at_m - at).norm() > other.radius_m)
            };
            self.rays.directions.iter().filter(is_open).count() as f64 / RAYS as f64
        };
        let shares: Vec<f64> = discs.iter().map(open_share).collect();
        let seen = |(disc, open): (DetectedDisc, f64)| {
            let outline_share = (disc.outline_share / open.max(0.25)).min(1.0);
            DetectedDisc { outline_share, ..disc }
        };
        discs.into_iter().zip(shares).map(seen).collect()
    }

    fn crests(&self, origin_m: Vec2, radius_m: f64) -> Option<Crests> {
        let map = LocalMap::new(self.table, origin_m, radius_m)?;
        let radius_px = map.radius_px();
        if !(radius_px > 3.0 && radius_px.is_finite()) {
            return None;
        }
        let step = 2.0 * REACH / (SAMPLES as f64 - 1.0);
        let half = (self.mean_px / (step * radius_px)).round().clamp(1.0, 8.0) as usize;
        let edge_m = 1.5 / self.table.px_per_m_at(origin_m);
        let mut slopes = [[[0.0f32; 2]; SAMPLES]; RAYS];
        let mut on_plate = [true; RAYS];
        for (k, ray) in self.rays.directions.iter().enumerate() {
            on_plate[k] = self.table.holds(origin_m + ray * (1.02 * radius_m), edge_m);
            let (linear, square) = map.along(*ray);
            let place = |s: f64| map.origin + (linear + square * s) * s;
            let (from, to) = (place(1.0 - REACH), place(1.0 + REACH));
            slopes[k] = sharpness(&self.sampler.profile::<SAMPLES>(from, to), half);
        }
        let mut tops: [f32; RAYS] = array::from_fn(|k| slopes[k].iter().fold(0.0, |a: f32, v| a.max(v[0])));
        let median = *tops.select_nth_unstable_by(RAYS / 2, f32::total_cmp).1;
        let least = (LEAST_CREST * median).max(FAINTEST);
        let mut crests = Crests {
            map,
            origin_m,
            radius_m,
            at: [[f32::NAN; CRESTS]; RAYS],
            sharpness: [[0.0; CRESTS]; RAYS],
            crispness: [[0.0; CRESTS]; RAYS],
            on_plate,
        };
        for (k, slopes) in slopes.iter().enumerate() {
            crests.take(k, slopes, [least, median.max(FAINTEST)], [1.0 - REACH, step].map(|v| v as f32));
        }
        Some(crests)
    }

    /// Middle and radius of the circle with most and sharpest crests, from triples of crests a third of a turn apart.
    fn consensus(&self, crests: &Crests, window: f64) -> Option<(Vec2, f64)> {
        const THIRD: usize = RAYS / 3;
        const LIKELY: usize = 3;
        let ballot = crests.ballot(1.5 * self.on_circle(crests));
        let mut best: Option<(f32, Vec2, f64)> = None;
        for k in 0..THIRD {
            let rays = [k, k + THIRD, k + 2 * THIRD];
            for slots in 0..LIKELY.pow(3) {
                let slots = [slots % LIKELY, slots / LIKELY % LIKELY, slots / LIKELY / LIKELY];
                let at = [0, 1, 2].map(|i| f64::from(crests.at[rays[i]][slots[i]]));
                let radius = at.iter().sum::<f64>() / 3.0;
                let center = (0..3).map(|i| self.rays.directions[rays[i]] * at[i]).sum::<Vec2>() * (2.0 / 3.0);
                if !((radius - 1.0).abs() <= window && center.norm() <= FARTHEST) {
                    continue;
                }
                let votes = self.votes(&ballot, center, radius);
                if best.is_none_or(|(most, ..)| votes > most) {
                    best = Some((votes, center, radius));
                }
            }
        }
        best.map(|(_, center, radius)| (center, radius))
    }

    /// Sharpness of the crests on a circle.
    fn votes(&self, ballot: &[[f32; BINS]; RAYS], center: Vec2, radius: f64) -> f32 {
        let of_ray =
            |(ray, bins): (&Vec2, &[f32; BINS])| bins.get(bin_of(radius + center.dot(ray))).copied().unwrap_or(0.0);
        self.rays.directions.iter().zip(ballot).map(of_ray).sum()
    }

    /// Largest distance of a crest from a circle it is on, radii.
    fn on_circle(&self, crests: &Crests) -> f64 {
        ON_CIRCLE.max(ON_CIRCLE_PX.max(0.5 * self.mean_px) / crests.map.radius_px())
    }

    /// The circle about the rays' origin through the crests.
    fn fit(&self, crests: &Crests) -> Option<CircleFit> {
        let (mut center, mut radius, mut covariance) = (Vec2::zeros(), 1.0, Matrix2::zeros());
        let near = self.on_circle(crests);
        for window in [3.0, 2.0, 1.5] {
            let chosen: [Option<f32>; RAYS] = array::from_fn(|k| {
                let wanted = radius + center.dot(&self.rays.directions[k]);
                crests.pick(k, wanted as f32, (window * near) as f32).map(|slot| crests.at[k][slot])
            });
            let present: PerRay = chosen.map(|at| f32::from(u8::from(at.is_some())));
            let circle = self.rays.circle(&chosen.map(|at| at.unwrap_or(0.0)), &present, center, LEAST_SD)?;
            (center, radius, covariance) = (circle.center, circle.radius, circle.covariance * circle.variance);
        }
        let open = crests.on_plate.iter().filter(|open| **open).count();
        let crispness = |k: usize| {
            let wanted = radius + center.dot(&self.rays.directions[k]);
            let slot = crests.pick(k, wanted as f32, near as f32).filter(|_| crests.on_plate[k])?;
            Some(f64::from(crests.crispness[k][slot]))
        };
        let mut on_circle: Vec<f64> = (0..RAYS).filter_map(crispness).collect();
        let share = on_circle.len() as f64 / open.max(RAYS / 2) as f64;
        Some(CircleFit { center, radius, covariance, share, crispness: quantile(&mut on_circle, 0.5) })
    }
}

impl Crests {
    /// Takes the sharpest crests of ray `k` that reach `least`.
    fn take(&mut self, k: usize, slopes: &[[f32; 2]; SAMPLES], [least, full]: [f32; 2], [first, step]: [f32; 2]) {
        let mut found: Vec<(f32, f32, f32)> = Vec::new();
        for i in 1..SAMPLES - 1 {
            let [before, here, after] = [i - 1, i, i + 1].map(|i| slopes[i][0]);
            if here >= least && here >= before && here > after {
                let off = 0.5 * (after - before) / (2.0 * here - after - before);
                found.push((here, first + step * (i as f32 + off), slopes[i][1]));
            }
        }
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        for (slot, (sharpness, at, crispness)) in found.into_iter().take(CRESTS).enumerate() {
            self.crispness[k][slot] = crispness;
            (self.at[k][slot], self.sharpness[k][slot]) = (at, (sharpness / full).min(1.0));
        }
    }

    /// For every ray and distance the sharpest crest within `near` of it.
    fn ballot(&self, near: f64) -> [[f32; BINS]; RAYS] {
        array::from_fn(|k| {
            let mut bins = [0.0f32; BINS];
            for (&at, &sharpness) in self.at[k].iter().zip(&self.sharpness[k]).filter(|(at, _)| at.is_finite()) {
                let reached = bin_of(f64::from(at) - near)..=bin_of(f64::from(at) + near).min(BINS - 1);
                bins.get_mut(reached).into_iter().flatten().for_each(|bin| *bin = bin.max(sharpness));
            }
            bins
        })
    }

    /// The crest of ray `k` nearest to `wanted`, within `window` of it.
    fn pick(&self, k: usize, wanted: f32, window: f32) -> Option<usize> {
        let off = |slot: usize| (self.at[k][slot] - wanted).abs();
        (0..CRESTS).filter(|&slot| off(slot) <= window).min_by(|&a, &b| off(a).total_cmp(&off(b)))
    }
}

/// Bin of a distance in radii.
fn bin_of(at: f64) -> usize {
    ((at - (1.0 - REACH)) / (2.0 * REACH) * BINS as f64).max(0.0) as usize
}

/// Width of the plate's own edges, px: their rise over their steepest slope, the median over places all around.
fn side_width_px(sampler: &Sampler, table: &Table) -> f64 {
    const PLACES: usize = 8;
    const ACROSS_PX: f64 = 10.0;
    let mut widths = Vec::with_capacity(4 * PLACES);
    for side in 0..4 {
        let (from, to) = (table.corners_px[side], table.corners_px[(side + 1) % 4]);
        let along = (to - from).normalize();
        let across = Vec2::new(along.y, -along.x) * ACROSS_PX;
        for place in 0..PLACES {
            let at = from + (to - from) * ((place as f64 + 1.0) / (PLACES as f64 + 1.0));
            let Some(levels) = sampler.along::<41>(at - across, at + across) else { continue };
            let rise = (levels[40] - levels[0]).abs();
            let steepest = levels.windows(3).map(|w| (w[2] - w[0]).abs() / 2.0).fold(0.0, f32::max);
            if steepest > 0.0 {
                widths.push(f64::from(rise / steepest) * 2.0 * ACROSS_PX / 40.0);
            }
        }
    }
    quantile(&mut widths, 0.5)
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
