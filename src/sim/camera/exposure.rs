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
    pub(super) fn sub_exposures(&self, poses: impl Iterator<Item = Pose>) -> Vec<SubExposure> {
        let arm_m = self.arm_m;
        let samples: Vec<_> =
            poses.map(|pose| Vector3::new(pose.position_m.x, pose.position_m.y, pose.heading_rad)).collect();
        let travel_m = |step: Vector3<f64>| step.xy().norm() + step.z.abs() * arm_m;
        let variance_m2 = |spread: &Matrix3<f64>| spread[(0, 0)] + spread[(1, 1)] + spread[(2, 2)] * arm_m * arm_m;
        let sub_exposure = |(mean, spread, weight): (Vector3<f64>, Matrix3<f64>, f64)| {
            let position_m = Vec2::new(self.rounded_m(mean.x), self.rounded_m(mean.y));
            SubExposure { pose: Pose { position_m, heading_rad: self.rounded_turn(mean.z) }, spread, weight }
        };
        self.sections(&samples, travel_m, variance_m2).map(sub_exposure).collect()
    }

    /// Cuts a motion into the fewest sections that give the same picture: the mean and covariance of each and its share
    /// of the samples. `travel_m` is the way of the farthest point in a step, `variance_m2` that of its motion.
    pub(super) fn sections(
        &self,
        samples: &[Vector3<f64>],
        travel_m: impl Fn(Vector3<f64>) -> f64,
        variance_m2: impl Fn(&Matrix3<f64>) -> f64,
    ) -> impl Iterator<Item = (Vector3<f64>, Matrix3<f64>, f64)> {
        let step_m = samples.windows(2).map(|pair| travel_m(pair[1] - pair[0])).fold(0.0, f64::max);
        let together = ((Self::MERGED * self.blur_m / step_m) as usize).clamp(1, samples.len().max(1));
        let invisible_m2 = (Self::STILL * self.blur_m).powi(2);
        samples.chunks(together).map(move |section| {
            let (mean, mut spread) = moments(section);
            if variance_m2(&spread) < invisible_m2 {
                spread.fill(0.0);
            }
            (mean, spread, section.len() as f64 / samples.len() as f64)
        })
    }

    pub(super) fn rounded_m(&self, x_m: f64) -> f64 {
        let grain_m = Self::ROUNDING * self.blur_m;
        (x_m / grain_m).round() * grain_m
    }

    pub(super) fn rounded_turn(&self, turn_rad: f64) -> f64 {
        let grain_rad = Self::ROUNDING * self.blur_m / self.arm_m;
        (turn_rad / grain_rad).round() * grain_rad
    }
}

/// Mean and covariance of `samples`.
fn moments(samples: &[Vector3<f64>]) -> (Vector3<f64>, Matrix3<f64>) {
    let share = 1.0 / samples.len() as f64;
    let mean = samples.iter().fold(Vector3::zeros(), |sum, sample| sum + share * sample);
    let spread = samples.iter().fold(Matrix3::zeros(), |sum, sample| {
        let off = sample - mean;
        sum + share * off * off.transpose()
    });
    (mean, spread)
}
