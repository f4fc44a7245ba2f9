use nalgebra::{Matrix3, Vector3};

use upm_core::geometry::{Pose, Vec2};

/// Section of the exposure short enough to be pictured as the body's mean pose, blurred by the spread of its motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SubExposure {
    /// The mean pose.
    pub(super) pose: Pose,
    /// Covariance of x, y (m) and heading (rad) about it.
    pub(super) spread: Matrix3<f64>,
    /// Its share of the exposure.
    pub(super) weight: f64,
}

/// Lengths that determine how an exposure is cut into sub-exposures.
#[derive(Clone, Copy, Debug)]
pub(super) struct SubExposureParams {
    /// Standard deviation of the blur, as a length on the table, m.
    pub(super) blur_m: f64,
    /// Distance from a body's origin at which its heading matters, m.
    pub(super) arm_m: f64,
}

impl SubExposureParams {
    /// Extent of one sub-exposure (number of snapshots times their spacing), in standard deviations of the blur. n
    /// snapshots s apart have the fourth cumulant κ₄ = -(n⁴ - 1) s⁴/120, and a step's blurred edge differs from that of
    /// a Gaussian of equal variance by at most κ₄/24 · 0.55 of its height: 0.14 %.
    const MERGED: f64 = 1.64;
    /// Rounding of poses, relative to the blur: a body at rest in the picture then has an exactly constant pose.
    const ROUNDING: f64 = 1e-3;
    /// Spread below which a motion counts as none, relative to the blur.
    const STILL: f64 = 1e-2;

    /// Cuts evenly spaced poses of one body into the fewest sub-exposures that give the same picture.
    pub(super) fn sub_exposures(&self, poses: impl ExactSizeIterator<Item = Pose> + Clone, out: &mut Vec<SubExposure>) {
        out.clear();
        let count = poses.len();
        let travel = |(a, b): (Pose, Pose)| {
            (b.position_m - a.position_m).norm() + (b.heading_rad - a.heading_rad).abs() * self.arm_m
        };
        let step_m = poses.clone().zip(poses.clone().skip(1)).map(travel).fold(0.0, f64::max);
        let together = self.together(step_m, count);
        let mut first = 0;
        while first < count {
            let group = poses.clone().skip(first).take(together);
            out.push(self.sub_exposure(group.clone(), group.len() as f64 / count as f64));
            first += together;
        }
    }

    /// Number of the `count` snapshots, at most `step_m` apart, that one sub-exposure holds.
    pub(super) fn together(&self, step_m: f64, count: usize) -> usize {
        ((Self::MERGED * self.blur_m / step_m) as usize).clamp(1, count.max(1))
    }

    /// True when motion of this variance is invisible.
    pub(super) fn is_still(&self, variance_m2: f64) -> bool {
        variance_m2 < (Self::STILL * self.blur_m).powi(2)
    }

    pub(super) fn rounded_m(&self, x_m: f64) -> f64 {
        let grain_m = Self::ROUNDING * self.blur_m;
        (x_m / grain_m).round() * grain_m
    }

    pub(super) fn rounded_turn(&self, turn_rad: f64) -> f64 {
        let grain_rad = Self::ROUNDING * self.blur_m / self.arm_m;
        (turn_rad / grain_rad).round() * grain_rad
    }

    fn sub_exposure(&self, group: impl ExactSizeIterator<Item = Pose> + Clone, weight: f64) -> SubExposure {
        let coordinates = |pose: Pose| Vector3::new(pose.position_m.x, pose.position_m.y, pose.heading_rad);
        let (mean, mut spread) = moments(group.map(coordinates));
        if self.is_still(spread[(0, 0)] + spread[(1, 1)] + spread[(2, 2)] * self.arm_m * self.arm_m) {
            spread.fill(0.0);
        }
        let pose = Pose {
            position_m: Vec2::new(self.rounded_m(mean.x), self.rounded_m(mean.y)),
            heading_rad: self.rounded_turn(mean.z),
        };
        SubExposure { pose, spread, weight }
    }
}

/// Mean and covariance of `samples`.
pub(super) fn moments(samples: impl ExactSizeIterator<Item = Vector3<f64>> + Clone) -> (Vector3<f64>, Matrix3<f64>) {
    let share = 1.0 / samples.len() as f64;
    let mean = samples.clone().fold(Vector3::zeros(), |sum, sample| sum + share * sample);
    let spread = samples.fold(Matrix3::zeros(), |sum, sample| {
        let off = sample - mean;
        sum + share * off * off.transpose()
    });
    (mean, spread)
}
