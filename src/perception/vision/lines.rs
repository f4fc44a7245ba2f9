//! Sides of the table to a small fraction of a pixel: many profiles across a side, their half-level crossings, and a
//! robust straight line through them that rejects outliers (coins over the edge, a hand).

use super::hough::{HoughLine, IdealEdge};
use super::sampling::{Sampler, biweight, quantile, rising_crossing};
use upm_core::geometry::{Lens, Vec2};

/// Share of a side at each end that is left out because of the blur of the next side.
const ENDS: f64 = 0.03;
/// Least share of profiles that must agree.
const LEAST_AGREEING: f64 = 0.2;
/// Least step across a side, as a fraction of that of three quarters of its profiles: at first, and once the side is
/// known. Where a hand covers part of a side the step differs from that to the ground.
const FAINT_GROUND: f64 = 0.35;
const SAME_GROUND: f64 = 0.6;
/// Least step across a side, levels.
const FAINTEST: f64 = 4.0;

/// One edge found across a side: place along it and distance from it, ideal px, and strength.
struct EdgeSample {
    along: f64,
    across: f64,
    contrast: f64,
}

/// Measurement of one side of the table.
#[derive(Clone, Copy)]
pub(super) struct SideMeasurement<'a> {
    pub(super) sampler: &'a Sampler<'a>,
    pub(super) lens: &'a Lens,
    /// True when the plate is lighter than the ground.
    pub(super) bright: bool,
    /// Most profiles taken.
    pub(super) stations: usize,
    /// True when the side is known well enough for most of the profiles to show it.
    pub(super) known: bool,
}

/// First estimate of a side: the least-squares line through the edges near `from → to` (ideal px, the plate to the
/// right hand, y down) whose dark side is along `outward`. `None` when there are too few.
pub(super) fn through_edges(
    edges: &[IdealEdge],
    from: Vec2,
    to: Vec2,
    outward: Vec2,
    reach_px: f64,
) -> Option<HoughLine> {
    let (along, inward) = axes(from, to);
    let length = (to - from).norm();
    let mut sums = LineSums::default();
    for edge in edges {
        let (t, y) = ((edge.at - from).dot(&along), (edge.at - from).dot(&inward));
        if y.abs() < reach_px && t > 0.0 && t < length && edge.outward.dot(&outward) > 0.966 {
            sums.add(1.0, t, y);
        }
    }
    let (offset, slope) = sums.line().filter(|_| sums.n >= 4.0)?;
    Some(HoughLine::through(from + inward * offset, to + inward * (offset + slope * length)))
}

impl SideMeasurement<'_> {
    /// Refines the side near `from → to` with profiles of `N` pixels. `None` when too little of it shows.
    pub(super) fn refine<const N: usize>(&self, from: Vec2, to: Vec2) -> Option<HoughLine> {
        let stations = ((to - from).norm() as usize).clamp(40, self.stations.max(40));
        let mut crossings = self.crossings::<N>(from, to, stations);
        let mut contrasts: Vec<f64> = crossings.iter().map(|c| c.contrast).collect();
        let share = if self.known { SAME_GROUND } else { FAINT_GROUND };
        let least = (share * quantile(&mut contrasts, 0.75)).max(FAINTEST);
        crossings.retain(|c| c.contrast > least);
        let (offset, slope) = fit(&crossings, stations, self.known)?;
        let (along, inward) = axes(from, to);
        let length = (to - from).norm();
        let a = from + inward * offset;
        let b = from + along * length + inward * (offset + slope * length);
        Some(HoughLine::through(a, b))
    }

    fn crossings<const N: usize>(&self, from: Vec2, to: Vec2, stations: usize) -> Vec<EdgeSample> {
        let (along, inward) = axes(from, to);
        let length = (to - from).norm();
        let middle = (N as f64 - 1.0) / 2.0;
        let sign = if self.bright { 1.0 } else { -1.0 };
        let mut found = Vec::with_capacity(stations);
        for station in 0..stations {
            let t = length * (ENDS + (1.0 - 2.0 * ENDS) * (station as f64 + 0.5) / stations as f64);
            let ideal = from + along * t;
            let (center, step) = if self.lens.is_ideal() {
                (ideal, inward)
            } else {
                (self.lens.image_from_ideal(ideal), self.lens.jacobian_at_ideal(ideal) * inward)
            };
            let scale = step.norm();
            let step = step / scale;
            if !(scale > 0.1 && self.sampler.contains(center, 1.0)) {
                continue;
            }
            let profile =
                self.sampler.profile::<N>(center - step * middle, center + step * middle).map(|level| sign * level);
            let outside = (profile[0] + profile[1]) / 2.0;
            let inside = (profile[N - 1] + profile[N - 2]) / 2.0;
            if let Some(at) = rising_crossing(&profile, outside, inside) {
                let across = (at - middle) / scale;
                found.push(EdgeSample { along: t, across, contrast: f64::from(inside - outside) });
            }
        }
        found
    }
}

/// Weighted sums over points `(t, y)`, for the line `y = offset + slope · t` of least squares.
#[derive(Default)]
struct LineSums {
    n: f64,
    t: f64,
    tt: f64,
    y: f64,
    ty: f64,
}

impl LineSums {
    fn add(&mut self, weight: f64, t: f64, y: f64) {
        self.n += weight;
        self.t += weight * t;
        self.tt += weight * t * t;
        self.y += weight * y;
        self.ty += weight * t * y;
    }

    /// Offset and slope; `None` where the points do not determine them.
    fn line(&self) -> Option<(f64, f64)> {
        let Self { n, t, tt, y, ty } = *self;
        let det = n * tt - t * t;
        let slope = (n * ty - t * y) / det;
        (det > 1e-9 * n * tt).then(|| ((y - slope * t) / n, slope))
    }
}

fn axes(from: Vec2, to: Vec2) -> (Vec2, Vec2) {
    let along = (to - from).normalize();
    (along, Vec2::new(-along.y, along.x))
}

/// Fits `across = offset + slope · along` by least squares with biweights about the median (Beaton and Tukey, 1974).
/// For a `known` side the start is the axis itself, to within the reach of the biweights.
fn fit(crossings: &[EdgeSample], stations: usize, known: bool) -> Option<(f64, f64)> {
    const ROUNDS: usize = 5;
    let least = (LEAST_AGREEING * stations as f64).max(6.0);
    if (crossings.len() as f64) < least {
        return None;
    }
    let mut scratch = Vec::with_capacity(crossings.len());
    let (mut offset, mut slope) = if known { (0.0, 0.0) } else { least_median_start(crossings, &mut scratch) };
    let mut agreeing = 0;
    for _ in 0..ROUNDS {
        scratch.clear();
        scratch.extend(crossings.iter().map(|c| (c.across - offset - slope * c.along).abs()));
        let sd = (1.4826 * quantile(&mut scratch, 0.5)).max(0.01);
        let mut sums = LineSums::default();
        agreeing = 0;
        for c in crossings {
            let weight = biweight((c.across - offset - slope * c.along) / sd);
            agreeing += usize::from(weight > 0.0);
            sums.add(weight, c.along, c.across);
        }
        (offset, slope) = sums.line()?;
    }
    (agreeing as f64 >= least).then_some((offset, slope))
}

/// Of the lines through pairs of crossings half the side apart, the one with the least median residual (Rousseeuw,
/// 1984), so that the refinement starts among the majority.
fn least_median_start(crossings: &[EdgeSample], scratch: &mut Vec<f64>) -> (f64, f64) {
    const PAIRS: usize = 24;
    const SAMPLES: usize = 48;
    let half = crossings.len() / 2;
    let step = crossings.len().div_ceil(SAMPLES);
    let mut best = (f64::INFINITY, (0.0, 0.0));
    for pair in 0..PAIRS {
        let first = pair * half / PAIRS;
        let (a, b) = (&crossings[first], &crossings[first + half]);
        let slope = (b.across - a.across) / (b.along - a.along);
        let offset = a.across - slope * a.along;
        scratch.clear();
        scratch.extend(crossings.iter().step_by(step).map(|c| (c.across - offset - slope * c.along).abs()));
        let median = quantile(scratch, 0.5);
        if median < best.0 {
            best = (median, (offset, slope));
        }
    }
    best.1
}
