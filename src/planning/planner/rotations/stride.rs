//! Longest displacement of a part in one sequence.

use super::RotationPlanner;
use super::planner::LEAST_REACH_M;

/// The displacement, relative to half the plate's side: this over the number of parts, within bounds.
const WAY: f64 = 1.05;
const WAYS: (f64, f64) = (0.105, 0.2625);

impl RotationPlanner {
    /// Longest displacement of a part in one sequence with `parts` parts on a plate of half side `half_side_m`, m.
    pub fn longest_path_m(parts: usize, half_side_m: f64) -> f64 {
        half_side_m * (WAY / parts.max(1) as f64).clamp(WAYS.0, WAYS.1)
    }

    /// Bounds that displacement by the task's stride, m. Sequences then leave less of the steps, too: by the square, as
    /// their terms of second order.
    pub fn limit_stride(&mut self, stride_m: Option<f64>) {
        self.stride_m = stride_m.unwrap_or(f64::INFINITY);
    }

    pub(super) fn usual_m(&self, parts: usize) -> f64 {
        Self::longest_path_m(parts, self.params.half_side_m).min(self.stride_m).max(LEAST_REACH_M)
    }

    /// The bounded displacement, relative to the longest.
    pub(super) fn stride_share(&self, parts: usize) -> f64 {
        self.usual_m(parts) / Self::longest_path_m(parts, self.params.half_side_m)
    }
}
