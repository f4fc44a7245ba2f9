//! Sides of the table to a small part of a pixel: many profiles across a side, their half-level crossings,
//! a straight line through them that disbelieves what does not fit (coins over the edge, a hand).

use super::hough::Line;
use super::sampling::{Sampler, biweight, quantile, rising_crossing};
use crate::geometry::{Lens, Vec2};

/// Share of a side at each end that is left out: there the blur of the next side reaches in.
const ENDS: f64 = 0.03;
/// Half the longest profile, px.
const MAX_REACH: usize = 24;
/// Least share of profiles that must agree.
const LEAST_AGREEING: f64 = 0.2;

/// One edge found across a side: place along it and distance from it, ideal px, and how strong.
struct Crossing {
    along: f64,
    across: f64,
    contrast: f64,
}

/// The side near `from → to` (ideal px, the plate to the right hand, y down), looked for within `reach_px`.
/// `None` when too little of it shows.
pub(super) fn refine(sampler: &Sampler, lens: &Lens, from: Vec2, to: Vec2, reach_px: usize) -> Option<Line> {
    let stations = ((to - from).norm() as usize).clamp(40, 800);
    let mut crossings = crossings(sampler, lens, from, to, reach_px.min(MAX_REACH), stations);
    let mut contrasts: Vec<f64> = crossings.iter().map(|c| c.contrast).collect();
    let least = (0.35 * quantile(&mut contrasts, 0.75)).max(4.0);
    crossings.retain(|c| c.contrast > least);
    let (offset, slope) = fit(&crossings, stations)?;
    let (along, inward) = axes(from, to);
    let length = (to - from).norm();
    let a = from + inward * offset;
    let b = from + along * length + inward * (offset + slope * length);
    Some(Line::through(a, b))
}

fn axes(from: Vec2, to: Vec2) -> (Vec2, Vec2) {
    let along = (to - from).normalize();
    (along, Vec2::new(-along.y, along.x))
}

fn crossings(sampler: &Sampler, lens: &Lens, from: Vec2, to: Vec2, reach: usize, stations: usize) -> Vec<Crossing> {
    let (along, inward) = axes(from, to);
    let length = (to - from).norm();
    let mut profile = [0.0f32; 2 * MAX_REACH + 1];
    let profile = &mut profile[..2 * reach + 1];
    let mut found = Vec::with_capacity(stations);
    for station in 0..stations {
        let t = length * (ENDS + (1.0 - 2.0 * ENDS) * (station as f64 + 0.5) / stations as f64);
        let ideal = from + along * t;
        let (center, step) = (lens.image_from_ideal(ideal), lens.jacobian_at_ideal(ideal) * inward);
        let scale = step.norm();
        let step = step / scale;
        if !(scale > 0.1 && sampler.contains(center, 1.0)) {
            continue;
        }
        for (k, value) in profile.iter_mut().enumerate() {
            let p = center + step * (k as f64 - reach as f64);
            *value = sampler.at(p.x, p.y);
        }
        let dark = (profile[0] + profile[1]) / 2.0;
        let light = (profile[2 * reach] + profile[2 * reach - 1]) / 2.0;
        if let Some(at) = rising_crossing(profile, dark, light) {
            let across = (at - reach as f64) / scale;
            found.push(Crossing { along: t, across, contrast: f64::from(light - dark) });
        }
    }
    found
}

/// `across = offset + slope · along` by least squares with biweights about the median (Beaton and Tukey, 1974).
fn fit(crossings: &[Crossing], stations: usize) -> Option<(f64, f64)> {
    let least = (LEAST_AGREEING * stations as f64).max(6.0);
    if (crossings.len() as f64) < least {
        return None;
    }
    let mut scratch = Vec::with_capacity(crossings.len());
    let (mut offset, mut slope) = least_median_start(crossings, &mut scratch);
    let mut agreeing = 0.0;
    for _ in 0..10 {
        scratch.clear();
        scratch.extend(crossings.iter().map(|c| (c.across - offset - slope * c.along).abs()));
        let sd = (1.4826 * quantile(&mut scratch, 0.5)).max(0.01);
        let (mut n, mut st, mut stt, mut sy, mut sty) = (0.0, 0.0, 0.0, 0.0, 0.0);
        agreeing = 0.0;
        for c in crossings {
            let w = biweight((c.across - offset - slope * c.along) / sd);
            agreeing += f64::from(w > 0.0);
            n += w;
            st += w * c.along;
            stt += w * c.along * c.along;
            sy += w * c.across;
            sty += w * c.along * c.across;
        }
        let det = n * stt - st * st;
        if det <= 1e-9 * n * stt || det.is_nan() {
            return None;
        }
        slope = (n * sty - st * sy) / det;
        offset = (sy - slope * st) / n;
    }
    (agreeing >= least).then_some((offset, slope))
}

/// Of the lines through pairs of crossings half the side apart, the one with the least median residual
/// (Rousseeuw, 1984), so that what follows starts among the majority.
fn least_median_start(crossings: &[Crossing], scratch: &mut Vec<f64>) -> (f64, f64) {
    const PAIRS: usize = 48;
    const SAMPLES: usize = 100;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_third_of_wild_crossings_does_not_move_the_line() {
        let crossings: Vec<_> = (0..300)
            .map(|i| {
                let along = f64::from(i);
                let wild = (80..180).contains(&i);
                Crossing { along, across: if wild { 3.0 } else { 0.2 + 0.004 * along }, contrast: 100.0 }
            })
            .collect();
        let (offset, slope) = fit(&crossings, 300).unwrap();
        assert!((offset - 0.2).abs() < 0.01 && (slope - 0.004).abs() < 1e-4, "{offset} {slope}");
        assert!(fit(&crossings[..30], 300).is_none());
    }
}
