use upm_core::geometry::Vec2;

/// Velocity kept from one frame to the next: parts stop between pulses.
const DAMPING: f64 = 0.98;
/// Standard deviation of the change of velocity from frame to frame, radii.
const PUSH_RADII: f64 = 0.05;
/// Least variance of a position, px²: an outline shifts with light and with its neighbourhood.
const LEAST_VARIANCE_PX2: f64 = 1.0;

/// A part's position and velocity in the picture: a Kalman filter with equal variance along both axes (Kalman, 1960;
/// constant velocity, white accelerations). Time is counted in frames.
#[derive(Clone, Debug)]
pub(super) struct MotionModel {
    pub(super) place_px: Vec2,
    pub(super) velocity_px: Vec2,
    push_variance: f64,
    /// Variance of position, covariance of both, variance of velocity.
    variance: [f64; 3],
    /// Upper bound of the position's variance: the part is in the picture.
    most_variance: f64,
}

impl MotionModel {
    /// A part at rest, in pictures of `frame_size` px.
    pub(super) fn at_rest(place_px: Vec2, radius_px: f64, frame_size: [usize; 2]) -> Self {
        let push_variance = (PUSH_RADII * radius_px).powi(2).max(0.01);
        let [width, height] = frame_size.map(|n| n as f64);
        let most_variance = (width * width + height * height) / 16.0;
        Self {
            place_px,
            velocity_px: Vec2::zeros(),
            push_variance,
            variance: [0.01, 0.0, push_variance],
            most_variance,
        }
    }

    /// Predicts one frame ahead.
    pub(super) fn step(&mut self) {
        let [place, both, velocity] = self.variance;
        self.place_px += self.velocity_px;
        self.velocity_px *= DAMPING;
        let push = self.push_variance;
        let place = (place + 2.0 * both + velocity + 0.25 * push).min(self.most_variance);
        let velocity = DAMPING * DAMPING * velocity + push;
        // Correlation at most one, also where the position's variance was cut.
        let both = (DAMPING * (both + self.variance[2]) + 0.5 * push).min((place * velocity).sqrt());
        self.variance = [place, both, velocity];
    }

    /// Variance of the position along an axis, px².
    pub(super) fn place_variance(&self) -> f64 {
        self.variance[0].max(LEAST_VARIANCE_PX2)
    }

    /// Updates with a measured position `place_px` and its variance along an axis, px².
    pub(super) fn see(&mut self, place_px: Vec2, variance_px2: f64) {
        let [place, both, velocity] = self.variance;
        let innovation = place_px - self.place_px;
        let total = place + variance_px2.max(1e-6);
        self.place_px += innovation * (place / total);
        self.velocity_px += innovation * (both / total);
        let left = 1.0 - place / total;
        self.variance = [place * left, both * left, (velocity - both * both / total).max(0.0)];
    }
}
