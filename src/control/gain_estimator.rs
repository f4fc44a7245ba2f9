//! Gains of the displacements, learned during a run: friction differs from part to part, and the plate from place to
//! place.
//!
//! The gain of part i at p is modelled as `1 + part_i + Σ_c w_c(p) region_c` and scales its forecast steps. The regions
//! are the nodes of a grid over the plate and w_c their bilinear weights at the part. The parameters are estimated by
//! recursive least squares (a Kalman filter of constants; forecasts are linearised about the current gain), so that
//! each is corrected in proportion to its uncertainty: one slow part is not taken for a slow corner of the plate once
//! it has been elsewhere.

use nalgebra::{DMatrix, DVector};

use super::PulsePositions;
use upm_core::geometry::Vec2;
use upm_planning::planner::{PartState, PlannedPulse};

/// Nodes of the grid along each side.
const NODES: usize = 4;
/// Prior standard deviation of parts and regions.
const PART_SD: f64 = 0.1;
const REGION_SD: f64 = 0.04;
/// Forecast steps below this are not used, m.
const SHORTEST_STEP_M: f64 = 0.3e-3;
/// A ratio that deviates by more is a disturbance, not friction.
const FARTHEST: f64 = 0.6;
/// Limits of a gain.
const RANGE: (f64, f64) = (0.4, 2.5);

/// Gain increment of the second forecast of an observation.
pub(super) const MORE: f64 = 0.05;

/// Standard deviation of a forecast's error that remains at the true gains.
#[derive(Clone, Copy, Debug)]
pub(super) struct ForecastDeviation {
    /// Part independent of the step, m.
    least_m: f64,
    /// Additional part, relative to the step.
    of_step: f64,
    /// Scatter of the ratio itself, independent of the step.
    of_ratio: f64,
}

impl ForecastDeviation {
    /// The scatter of `pulse`; the least part as measured on the simulated plate. The displacement by a field is not
    /// linear in its gain: when it was taken as linear, parts within 10 % of the usual friction were reported as slow
    /// after long first pulses.
    pub(super) fn of(pulse: &PlannedPulse) -> Self {
        match pulse {
            PlannedPulse::Rotation(_) => Self { least_m: 0.03e-3, of_step: 0.0, of_ratio: 0.02 },
            PlannedPulse::Field(_) => Self { least_m: 0.2e-3, of_step: 0.03, of_ratio: 0.06 },
        }
    }
}

/// Gain of each part at each place, relative to the displacement model.
#[derive(Clone, Debug, PartialEq)]
pub struct GainEstimator {
    half_side_m: f64,
    parts: usize,
    /// Parameters: parts, then nodes row by row.
    state: DVector<f64>,
    covariance: DMatrix<f64>,
}

impl GainEstimator {
    /// Nothing is learned yet of `parts` parts on a plate whose side is twice `half_side_m`.
    pub fn new(parts: usize, half_side_m: f64) -> Self {
        let size = parts + NODES * NODES;
        let variance = |i: usize| if i < parts { PART_SD * PART_SD } else { REGION_SD * REGION_SD };
        let covariance = DMatrix::from_diagonal(&DVector::from_fn(size, |i, _| variance(i)));
        Self { half_side_m, parts, state: DVector::zeros(size), covariance }
    }

    /// Gain of `part` at `p_m`; 1 before anything is learned.
    pub fn get(&self, part: usize, p_m: Vec2) -> f64 {
        let weighted = |(at, weight): (usize, f64)| self.state.get(at).map_or(0.0, |value| weight * value);
        (1.0 + self.pattern(part, p_m).map(weighted).iter().sum::<f64>()).clamp(RANGE.0, RANGE.1)
    }

    /// Gain of `part` alone, independent of its place.
    pub(super) fn of_part(&self, part: usize) -> f64 {
        1.0 + if part < self.parts { self.state[part] } else { 0.0 }
    }

    /// Updates the gains from one pulse: positions before and after it, its forecast with gains larger by [`MORE`], and
    /// the error of the forecast at the true gains.
    pub(super) fn learn(&mut self, seen: &PulsePositions, with_more_m: &[Vec2], scatter: ForecastDeviation) {
        let forecasts = seen.by_learning_m.iter().zip(with_more_m);
        let each = seen.before_m.iter().zip(forecasts).zip(&seen.after_m).take(self.parts).enumerate();
        for (part, ((before, (forecast, with_more)), measured)) in each {
            let per_gain = (with_more - forecast) / MORE;
            let length_m = per_gain.norm();
            if length_m < SHORTEST_STEP_M {
                continue;
            }
            let off = (measured - forecast).dot(&per_gain) / per_gain.norm_squared();
            if off.abs() < FARTHEST {
                let scatter_m = scatter.least_m + scatter.of_step * (forecast - before).norm();
                let variance = scatter.of_ratio.powi(2) + (scatter_m / length_m).powi(2);
                self.correct(self.pattern(part, *before), off, variance);
            }
        }
    }

    /// Updates the gains from `pulse`: the parts that rested as in `before` came to rest at `after_m`; `forecast` has
    /// their forecast places, `None` for a pulse that is not forecast.
    pub fn learn_pulse(
        &mut self,
        pulse: &PlannedPulse,
        before: &[PartState],
        after_m: &[Vec2],
        forecast: &dyn Fn(&[PartState]) -> Option<Vec<Vec2>>,
    ) {
        let more: Vec<PartState> = before.iter().map(|part| PartState { gain: part.gain + MORE, ..*part }).collect();
        let (Some(by_learning_m), Some(with_more_m)) = (forecast(before), forecast(&more)) else { return };
        let before_m = before.iter().map(|part| part.position_m).collect();
        let seen = PulsePositions { before_m, after_m: after_m.to_vec(), by_library_m: Vec::new(), by_learning_m };
        self.learn(&seen, &with_more_m, ForecastDeviation::of(pulse));
    }

    /// Corrects the parameters by one observation: the sum of `pattern` was measured larger by `off` than estimated.
    fn correct(&mut self, pattern: [(usize, f64); 5], off: f64, variance: f64) {
        let mut spread = DVector::zeros(self.state.len());
        for (at, weight) in pattern {
            spread.axpy(weight, &self.covariance.column(at), 1.0);
        }
        let total = variance + pattern.iter().map(|&(at, weight)| weight * spread[at]).sum::<f64>();
        self.state.axpy(off / total, &spread, 1.0);
        self.covariance.ger(-1.0 / total, &spread, &spread, 1.0);
    }

    /// The parameters that act on `part` at `p_m`, with their weights: its own and those of the four nodes around it.
    fn pattern(&self, part: usize, p_m: Vec2) -> [(usize, f64); 5] {
        let along = |x_m: f64| {
            let last = (NODES - 1) as f64;
            let x = ((x_m / self.half_side_m + 1.0) * 0.5 * last).clamp(0.0, last);
            let low = (x as usize).min(NODES - 2);
            (low, x - low as f64)
        };
        let ((column, x), (row, y)) = (along(p_m.x), along(p_m.y));
        let node = |dx: usize, dy: usize| self.parts + (row + dy) * NODES + column + dx;
        let own = part.min(self.parts.saturating_sub(1));
        [
            (own, 1.0),
            (node(0, 0), (1.0 - x) * (1.0 - y)),
            (node(1, 0), x * (1.0 - y)),
            (node(0, 1), (1.0 - x) * y),
            (node(1, 1), x * y),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;
    use upm_core::random::Streams;

    const HALF_M: f64 = 0.15;
    const SCATTER: ForecastDeviation = ForecastDeviation { least_m: 0.05e-3, of_step: 0.02, of_ratio: 0.06 };

    /// Teaches steps that grow with the gain, as a rotation's do: `steps_m` at gain 1, scaled by `ratios`.
    fn teach(gains: &mut GainEstimator, before_m: &[Vec2], steps_m: &[Vec2], ratios: &[f64]) {
        let ends = |gain: &dyn Fn(usize) -> f64| -> Vec<Vec2> {
            before_m.iter().zip(steps_m).enumerate().map(|(i, (p, step))| p + step * gain(i)).collect()
        };
        let held: Vec<f64> = before_m.iter().enumerate().map(|(i, &p)| gains.get(i, p)).collect();
        let seen = PulsePositions {
            before_m: before_m.to_vec(),
            after_m: ends(&|i| ratios[i]),
            by_library_m: Vec::new(),
            by_learning_m: ends(&|i| held[i]),
        };
        gains.learn(&seen, &ends(&|i| held[i] + MORE), SCATTER);
    }

    fn taught(truth: impl Fn(usize, Vec2) -> f64) -> GainEstimator {
        let mut rng = Streams::new(3).stream("learning");
        let mut gains = GainEstimator::new(3, HALF_M);
        for _ in 0..300 {
            let at = |_| Vec2::new(rng.random_range(-HALF_M..HALF_M), rng.random_range(-HALF_M..HALF_M));
            let before: Vec<Vec2> = (0..3).map(at).collect();
            let ratios: Vec<f64> = before.iter().enumerate().map(|(i, p)| truth(i, *p)).collect();
            teach(&mut gains, &before, &[Vec2::new(4e-3, -3e-3); 3], &ratios);
        }
        gains
    }

    #[test]
    fn friction_of_parts_and_a_slow_plate_side_are_distinguished() {
        let parts = [0.85, 1.0, 1.15];
        let gains = taught(|i, p| parts[i] - 0.05 * p.x / HALF_M);
        for (i, part) in parts.into_iter().enumerate() {
            assert!((gains.of_part(i) - part).abs() < 0.02, "{i}: {}", gains.of_part(i));
            let slope = gains.get(i, Vec2::new(-HALF_M, 0.0)) - gains.get(i, Vec2::new(HALF_M, 0.0));
            assert!((slope - 0.1).abs() < 0.02, "{slope}");
        }
    }

    #[test]
    fn small_steps_and_disturbances_leave_the_gains_unchanged() {
        let mut gains = GainEstimator::new(1, HALF_M);
        let untaught = gains.clone();
        teach(&mut gains, &[Vec2::zeros()], &[Vec2::new(1e-4, 0.0)], &[0.9]);
        teach(&mut gains, &[Vec2::zeros()], &[Vec2::new(5e-3, 0.0)], &[0.0]);
        assert_eq!(gains, untaught);
        assert_eq!(gains.get(0, Vec2::new(0.1, 0.1)), 1.0);
    }

    #[test]
    fn agrees_with_least_squares_of_everything_at_once() {
        // one part at one node: the mean of the ratios and the prior, weighted by their certainty
        let (ratios, step) = ([0.9, 0.95, 0.85], Vec2::new(0.01, 0.0));
        let mut gains = GainEstimator::new(1, HALF_M);
        let corner = Vec2::new(-HALF_M, -HALF_M);
        ratios.iter().for_each(|&ratio| teach(&mut gains, &[corner], &[step], &[ratio]));
        let prior = PART_SD * PART_SD + REGION_SD * REGION_SD;
        let (mut held, mut sum, mut certainty) = (1.0, 0.0, 1.0 / prior);
        for ratio in ratios {
            // the forecast step grows with the current gain, and its scatter with it
            let scatter_m = SCATTER.least_m + SCATTER.of_step * step.norm() * held;
            let noise = SCATTER.of_ratio.powi(2) + (scatter_m / step.norm()).powi(2);
            sum += (ratio - 1.0) / noise;
            certainty += 1.0 / noise;
            held = 1.0 + sum / certainty;
        }
        assert!((gains.get(0, corner) - held).abs() < 1e-9);
    }
}
