use crate::geometry::Vec2;

/// Part of a new ratio that enters the gain.
const WEIGHT: f64 = 0.3;
/// Predicted steps below this say little about the gain, m.
const SHORTEST_STEP_M: f64 = 0.5e-3;
/// A gain outside this range is a disturbance, not friction.
const RANGE: (f64, f64) = (0.4, 2.5);

/// How far each part goes against what the displacement model says: friction differs from part to part.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Gains(Vec<f64>);

impl Gains {
    pub(super) fn new(parts: usize) -> Self {
        Self(vec![1.0; parts])
    }

    pub(super) fn get(&self, part: usize) -> f64 {
        self.0.get(part).copied().unwrap_or(1.0)
    }

    /// Learns from one cycle: positions before it, predicted and measured positions after it, m.
    /// The prediction was made with the present gains.
    pub(super) fn learn(&mut self, before_m: &[Vec2], predicted_m: &[Vec2], measured_m: &[Vec2]) {
        for (((gain, before), predicted), measured) in self.0.iter_mut().zip(before_m).zip(predicted_m).zip(measured_m)
        {
            let step = predicted - before;
            if step.norm() >= SHORTEST_STEP_M {
                let ratio = (measured - before).dot(&step) / step.norm_squared();
                *gain = (*gain * (1.0 + WEIGHT * (ratio - 1.0))).clamp(RANGE.0, RANGE.1);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn converges_on_a_slippery_part_and_ignores_small_steps() {
        let mut gains = Gains::new(1);
        for _ in 0..40 {
            let predicted = Vec2::new(0.004 * gains.get(0), 0.0);
            gains.learn(&[Vec2::zeros()], &[predicted], &[Vec2::new(0.004 * 0.8, 0.0)]);
        }
        assert!((gains.get(0) - 0.8).abs() < 1e-3);
        gains.learn(&[Vec2::zeros()], &[Vec2::new(1e-4, 0.0)], &[Vec2::zeros()]);
        assert!((gains.get(0) - 0.8).abs() < 1e-3);
    }
}
