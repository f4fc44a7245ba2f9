use nalgebra::{Matrix2, Vector3};

use upm_core::geometry::Vec2;

/// Rays about a centre.
pub(in super::super) const RAYS: usize = 36;
/// Fewest rays that must agree on a circle.
pub(in super::super) const LEAST_AGREEING: usize = 9;
/// Lanes of a sum: a processor adds this many numbers at once, and the order of additions stays fixed.
const LANES: usize = 4;

/// Distance from the circle up to which a crossing is near it, in units of the least scatter: outliers of a noiseless
/// picture are small.
const NEAR: f32 = 15.0;

/// One number for each ray.
pub(in super::super) type PerRay = [f32; RAYS];

/// Directions of the rays.
pub(in super::super) struct Rays {
    pub(in super::super) directions: [Vec2; RAYS],
    cos: PerRay,
    sin: PerRay,
}

/// `constant + slope·u` around a ring, u the direction: models light, and a circle off the rays' centre.
#[derive(Clone, Copy)]
pub(in super::super) struct RimHarmonic {
    pub(in super::super) constant: f32,
    pub(in super::super) slope: [f32; 2],
    /// Covariance of the slope, for values of unit variance.
    covariance: Matrix2<f64>,
}

/// A circle through crossings, in estimated radii.
pub(in super::super) struct RimCircle {
    pub(in super::super) center: Vec2,
    pub(in super::super) radius: f64,
    /// Variance of one crossing about the circle.
    pub(in super::super) variance: f64,
    /// Covariance of the centre, for crossings of unit variance.
    pub(in super::super) covariance: Matrix2<f64>,
    pub(in super::super) agreeing: usize,
    /// Bit mask of the rays, set where the crossing is near the circle.
    pub(in super::super) near: u64,
}

/// Unit vector of ray `k`.
pub(in super::super) fn direction(k: usize) -> Vec2 {
    let (sin, cos) = libm::sincos((k as f64 + 0.5) / RAYS as f64 * std::f64::consts::TAU);
    Vec2::new(cos, sin)
}

impl Rays {
    pub(in super::super) fn new() -> Self {
        let directions: [Vec2; RAYS] = std::array::from_fn(direction);
        Self { directions, cos: directions.map(|u| u.x as f32), sin: directions.map(|u| u.y as f32) }
    }

    /// Least squares; `None` below `least` weight or where the rays do not determine the slope.
    pub(in super::super) fn fit(&self, values: &PerRay, weights: &PerRay, least: f64) -> Option<RimHarmonic> {
        let wx: PerRay = std::array::from_fn(|k| weights[k] * self.cos[k]);
        let wy: PerRay = std::array::from_fn(|k| weights[k] * self.sin[k]);
        let (n, x, y) = (sum(|k| weights[k]), sum(|k| wx[k]), sum(|k| wy[k]));
        let (xx, xy) = (sum(|k| wx[k] * self.cos[k]), sum(|k| wx[k] * self.sin[k]));
        let yy = n - xx;
        let right =
            Vector3::new(sum(|k| weights[k] * values[k]), sum(|k| wx[k] * values[k]), sum(|k| wy[k] * values[k]));
        let cofactors = [xx * yy - xy * xy, y * xy - x * yy, x * xy - y * xx];
        let determinant = n * cofactors[0] + x * cofactors[1] + y * cofactors[2];
        if !(n >= least && determinant > 1e-4 * n.powi(3)) {
            return None;
        }
        let (mixed, per) = (x * y - n * xy, 1.0 / determinant);
        let covariance = Matrix2::new(n * yy - y * y, mixed, mixed, n * xx - x * x) * per;
        let beside = Vec2::new(cofactors[1], cofactors[2]) * per;
        let slope = beside * right.x + covariance * right.yz();
        let constant = (cofactors[0] * per) * right.x + beside.dot(&right.yz());
        Some(RimHarmonic { constant: constant as f32, slope: [slope.x as f32, slope.y as f32], covariance })
    }

    /// A harmonic at every ray.
    pub(in super::super) fn values(&self, harmonic: &RimHarmonic) -> PerRay {
        let RimHarmonic { constant, slope: [x, y], .. } = *harmonic;
        std::array::from_fn(|k| constant + x * self.cos[k] + y * self.sin[k])
    }

    /// Robust circle through crossings at `radii` on the rays that have one (`present` 1, else 0):
    /// `ρ_k + (c × u_k)² / 2 = R + c·u_k`, by least squares with Tukey's biweights.
    pub(in super::super) fn circle(
        &self,
        radii: &PerRay,
        present: &PerRay,
        start: Vec2,
        least_sd: f32,
    ) -> Option<RimCircle> {
        const ROUNDS: usize = 3;
        const CALM: f32 = 0.3;
        let count = present.iter().filter(|&&p| p > 0.0).count();
        if count < LEAST_AGREEING {
            return None;
        }
        let (mut center, mut weights) = ([start.x as f32, start.y as f32], *present);
        for round in 1.. {
            let across: PerRay = std::array::from_fn(|k| center[0] * self.sin[k] - center[1] * self.cos[k]);
            let bent: PerRay = std::array::from_fn(|k| radii[k] + 0.5 * across[k] * across[k]);
            let fit = self.fit(&bent, &weights, LEAST_AGREEING as f64 / 3.0)?;
            let on_circle = self.values(&fit);
            let residuals: PerRay = std::array::from_fn(|k| bent[k] - on_circle[k]);
            // A ring without outliers needs no further weighting.
            let calm = || (0..RAYS).all(|k| weights[k] >= CALM * present[k]);
            if round == ROUNDS || (round > 1 && calm()) {
                return agreed(&fit, &residuals, (&weights, present), least_sd);
            }
            center = fit.slope;
            let scale = (1.4826 * median_size(&residuals, present, count)).max(least_sd);
            let per_sd = 1.0 / (4.685 * scale);
            weights = std::array::from_fn(|k| {
                let share = (1.0 - (residuals[k] * per_sd).powi(2)).max(0.0);
                present[k] * share * share
            });
        }
        None
    }
}

/// The circle with its scatter. For normal residuals r and biweights w, `E w r² / E w` is 0.828 of the variance.
fn agreed(
    fit: &RimHarmonic,
    residuals: &PerRay,
    (weights, present): (&PerRay, &PerRay),
    least_sd: f32,
) -> Option<RimCircle> {
    let agreeing = weights.iter().filter(|&&w| w > 0.0).count();
    let squares = sum(|k| weights[k] * residuals[k] * residuals[k]) / sum(|k| weights[k]);
    let variance = squares / 0.828 * agreeing as f64 / (agreeing as f64 - 3.0);
    let near = (NEAR * least_sd).max(3.0 * variance.sqrt() as f32);
    let circle = RimCircle {
        center: Vec2::new(f64::from(fit.slope[0]), f64::from(fit.slope[1])),
        radius: f64::from(fit.constant),
        variance,
        covariance: fit.covariance,
        agreeing,
        near: (0..RAYS).map(|k| u64::from(present[k] > 0.0 && residuals[k].abs() < near) << k).sum(),
    };
    let sound = agreeing >= LEAST_AGREEING && circle.radius > 0.0 && circle.center.norm() < 1.0;
    (sound && circle.variance.is_finite()).then_some(circle)
}

/// Sum over all rays.
pub(in super::super) fn sum(value: impl Fn(usize) -> f32) -> f64 {
    let mut lanes = [0.0f32; LANES];
    for first in (0..RAYS).step_by(LANES) {
        for (lane, total) in lanes.iter_mut().enumerate() {
            *total += value(first + lane);
        }
    }
    f64::from((lanes[0] + lanes[2]) + (lanes[1] + lanes[3]))
}

/// Median magnitude of those `count` values that are `present`. Bit patterns of non-negative floats are ordered like
/// their values.
fn median_size(values: &PerRay, present: &PerRay, count: usize) -> f32 {
    let mut bits: [u32; RAYS] =
        std::array::from_fn(|k| if present[k] > 0.0 { values[k].abs().to_bits() } else { u32::MAX });
    f32::from_bits(*bits.select_nth_unstable(count / 2).1)
}

/// Quantile `q` of the `present` values; `None` with too few of them.
pub(in super::super) fn ring_quantile(values: &PerRay, present: &PerRay, q: f32) -> Option<f32> {
    let mut kept = [0.0f32; RAYS];
    let mut n = 0;
    for k in (0..RAYS).filter(|&k| present[k] > 0.0) {
        kept[n] = values[k];
        n += 1;
    }
    let nth = (n.saturating_sub(1) as f32 * q) as usize;
    (n >= LEAST_AGREEING).then(|| *kept[..n].select_nth_unstable_by(nth, f32::total_cmp).1)
}
