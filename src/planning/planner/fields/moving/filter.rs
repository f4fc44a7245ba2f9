//! Place, velocity and friction of a moving part: an extended Kalman filter.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

use crate::planner::fields::rollout::RolloutDisc;
use upm_core::geometry::Vec2;

/// Standard deviation of a part's place in a frame, m: a fifteenth of a pixel of 0.35 mm, and smear by motion.
const SENSING_M: f64 = 0.025e-3;
/// Standard deviation of a velocity's forecast after 1 s, m/s: the plate's response is known to half a percent, and
/// friction pulls with up to 3 m/s².
const FORECAST_MPS: f64 = 0.015;
/// Deviation of friction before anything is seen, and of its change in a step from frame to frame, relative.
const FRICTION: f64 = 0.1;
const FRICTION_CHANGE: f64 = 3e-5;
/// Range of friction relative to that of the calibration's coins.
const RANGE: (f64, f64) = (0.4, 2.0);

/// Estimated state of one part: x, y, their velocities, and friction.
#[derive(Clone, Debug)]
pub(super) struct PartFilter {
    state: SVector<f64, 5>,
    covariance: SMatrix<f64, 5, 5>,
    radius_m: f64,
    usual_friction: f64,
}

impl PartFilter {
    pub fn new(radius_m: f64, usual_friction: f64) -> Self {
        let mut filter = Self {
            state: SVector::from([0.0, 0.0, 0.0, 0.0, usual_friction]),
            covariance: SMatrix::zeros(),
            radius_m,
            usual_friction,
        };
        filter.covariance[(4, 4)] = (FRICTION * usual_friction).powi(2);
        filter
    }

    /// The part rests at `place_m`, as seen in one frame; its friction stays as it was learned.
    pub fn rest(&mut self, place_m: Vec2) {
        let [variance, of_friction] = [SENSING_M * SENSING_M, self.covariance[(4, 4)]];
        self.state.fixed_rows_mut::<4>(0).copy_from_slice(&[place_m.x, place_m.y, 0.0, 0.0]);
        self.covariance = SMatrix::from_diagonal(&SVector::from([variance, variance, 0.0, 0.0, of_friction]));
    }

    pub fn disc(&self) -> RolloutDisc {
        let [x, y, vx, vy, friction]: [f64; 5] = self.state.into();
        RolloutDisc { position_m: Vec2::new(x, y), velocity_mps: Vec2::new(vx, vy), radius_m: self.radius_m, friction }
    }

    /// Takes over the forecast place and velocity after `after_s`.
    pub fn predict(&mut self, (place_m, velocity_mps): (Vec2, Vec2), after_s: f64) {
        let gained_mps = velocity_mps - self.disc().velocity_mps;
        let mut step = SMatrix::<f64, 5, 5>::identity();
        let mut noise = SMatrix::<f64, 5, 5>::zeros();
        let variance = FORECAST_MPS * FORECAST_MPS * after_s;
        for axis in 0..2 {
            let by_friction = gained_mps[axis] / self.state[4];
            step[(axis, 2 + axis)] = after_s;
            step[(2 + axis, 4)] = by_friction;
            step[(axis, 4)] = 0.5 * after_s * by_friction;
            noise[(axis, axis)] = variance * after_s * after_s / 3.0;
            noise[(axis, 2 + axis)] = 0.5 * variance * after_s;
            noise[(2 + axis, axis)] = 0.5 * variance * after_s;
            noise[(2 + axis, 2 + axis)] = variance;
        }
        noise[(4, 4)] = (FRICTION_CHANGE * self.usual_friction).powi(2);
        let place = [place_m.x, place_m.y, velocity_mps.x, velocity_mps.y];
        self.state.fixed_rows_mut::<4>(0).copy_from_slice(&place);
        self.covariance = step * self.covariance * step.transpose() + noise;
    }

    /// Takes the place at which a frame shows the part.
    pub fn correct(&mut self, seen_m: Vec2) {
        let off_m = seen_m - self.disc().position_m;
        let of_place = self.covariance.fixed_view::<2, 2>(0, 0) + Matrix2::identity() * (SENSING_M * SENSING_M);
        let Some(inverse) = of_place.try_inverse() else { return };
        let gain = self.covariance.fixed_view::<5, 2>(0, 0) * inverse;
        self.state += gain * Vector2::new(off_m.x, off_m.y);
        let of_places = self.covariance.fixed_view::<2, 5>(0, 0).into_owned();
        self.covariance -= gain * of_places;
        let [least, most] = [RANGE.0, RANGE.1].map(|share| share * self.usual_friction);
        self.state[4] = self.state[4].clamp(least, most);
    }
}
