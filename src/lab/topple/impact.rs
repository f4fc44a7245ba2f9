//! Simulation of the impact and the following swing: a rigid body in the plane whose contact point is held by impulse
//! and force. It is independent of the closed form: it uses neither angular momentum about the edge nor energy.

use nalgebra::{Matrix2, Vector2};

use super::peg::Pivot;
use crate::numerics::bisect;
use upm_core::units::GRAVITY_MPS2;

/// Steps in the time `sqrt(h/g)`, h being the centre's height above the edge.
const STEPS: f64 = 1_000.0;
/// Such times after which a part that has neither toppled nor fallen back counts as balanced on its edge.
const MOST_TIMES: f64 = 400.0;
/// Halvings of the interval of speeds.
const HALVINGS: usize = 40;

/// State of the body: its centre from the edge, m; velocity of the centre, m/s; spin, counter-clockwise, rad/s.
#[derive(Clone, Copy, Debug)]
struct Body {
    center_m: Vector2<f64>,
    velocity_mps: Vector2<f64>,
    spin_radps: f64,
}

impl Pivot {
    /// True when a part that arrives at `speed_mps` topples over the edge.
    pub fn topples(&self, speed_mps: f64) -> bool {
        let mut body = self.after_impact(speed_mps);
        let step_s = (self.above_m / GRAVITY_MPS2).sqrt() / STEPS;
        let start_m = body.center_m.x;
        for _ in 0..(MOST_TIMES * STEPS) as usize {
            if body.center_m.x > 0.0 {
                return true;
            }
            if body.center_m.x < start_m {
                return false;
            }
            body = self.stepped(body, step_s);
        }
        false
    }

    /// The body after the impulse that stops its point at the edge: plastic, and the edge holds.
    fn after_impact(&self, speed_mps: f64) -> Body {
        let center_m = Vector2::new(-self.behind_m, self.above_m);
        let arm_m = -center_m;
        let velocity_mps = Vector2::new(speed_mps, 0.0);
        let impulse = self.inverse_mass(arm_m).try_inverse().map_or_else(Vector2::zeros, |mass| -(mass * velocity_mps));
        Body { center_m, velocity_mps: velocity_mps + impulse, spin_radps: cross(arm_m, impulse) / self.gyration_m2 }
    }

    /// Velocity that a unit impulse on a unit mass gives the point at `arm_m` from the centre.
    fn inverse_mass(&self, arm_m: Vector2<f64>) -> Matrix2<f64> {
        let turned = Vector2::new(-arm_m.y, arm_m.x);
        Matrix2::identity() + turned * turned.transpose() / self.gyration_m2
    }

    /// A step of the fourth-order Runge-Kutta method; the edge holds the body's point by a force.
    fn stepped(&self, body: Body, step_s: f64) -> Body {
        let along = |slope: &Slope, share: f64| Body {
            center_m: body.center_m + slope.velocity_mps * (share * step_s),
            velocity_mps: body.velocity_mps + slope.accel_mps2 * (share * step_s),
            spin_radps: body.spin_radps + slope.spin_radps2 * (share * step_s),
        };
        let k1 = self.slope(&body);
        let k2 = self.slope(&along(&k1, 0.5));
        let k3 = self.slope(&along(&k2, 0.5));
        let k4 = self.slope(&along(&k3, 1.0));
        let mean = Slope {
            velocity_mps: (k1.velocity_mps + 2.0 * (k2.velocity_mps + k3.velocity_mps) + k4.velocity_mps) / 6.0,
            accel_mps2: (k1.accel_mps2 + 2.0 * (k2.accel_mps2 + k3.accel_mps2) + k4.accel_mps2) / 6.0,
            spin_radps2: (k1.spin_radps2 + 2.0 * (k2.spin_radps2 + k3.spin_radps2) + k4.spin_radps2) / 6.0,
        };
        along(&mean, 1.0)
    }

    /// Accelerations under gravity and the force that keeps the body's point at the edge.
    fn slope(&self, body: &Body) -> Slope {
        let arm_m = -body.center_m;
        let gravity = Vector2::new(0.0, -GRAVITY_MPS2);
        // acceleration of the point without the force: gravity and the centripetal acceleration
        let free = gravity - arm_m * body.spin_radps.powi(2);
        let force = self.inverse_mass(arm_m).try_inverse().map_or_else(Vector2::zeros, |mass| -(mass * free));
        Slope {
            velocity_mps: body.velocity_mps,
            accel_mps2: gravity + force,
            spin_radps2: cross(arm_m, force) / self.gyration_m2,
        }
    }

    /// Least speed at which the simulated part topples, m/s, by bisection.
    pub fn simulated_critical_mps(&self) -> f64 {
        let (mut stays, mut topples) = (0.0, (GRAVITY_MPS2 * (self.behind_m + self.above_m)).sqrt());
        while !self.topples(topples) && topples < f64::MAX.sqrt() {
            (stays, topples) = (topples, 2.0 * topples);
        }
        bisect([stays, topples], HALVINGS, |speed_mps| self.topples(speed_mps))[1]
    }
}

/// Rates of change of a body.
#[derive(Clone, Copy, Debug)]
struct Slope {
    velocity_mps: Vector2<f64>,
    accel_mps2: Vector2<f64>,
    spin_radps2: f64,
}

fn cross(a: Vector2<f64>, b: Vector2<f64>) -> f64 {
    a.x * b.y - a.y * b.x
}

#[cfg(test)]
mod tests {
    use super::super::peg::{Peg, Shape};

    /// The tolerance is 0.1 %.
    #[test]
    fn simulated_speed_is_that_of_the_closed_form() {
        for (shape, length_mm, height_mm, ledge_mm) in [
            (Shape::Block, 10.0, 10.0, 0.0),
            (Shape::Block, 10.0, 25.0, 0.0),
            (Shape::Block, 25.0, 10.0, 0.0),
            (Shape::Cylinder, 9.5, 19.0, 0.0),
            (Shape::Cylinder, 9.5, 19.0, 0.889),
        ] {
            let peg = Peg { shape, length_m: 1e-3 * length_mm, height_m: 1e-3 * height_mm };
            let pivot = peg.pivot(1e-3 * ledge_mm).unwrap();
            let off = pivot.simulated_critical_mps() / pivot.critical_mps() - 1.0;
            assert!(off.abs() < 1e-3, "{shape:?} {length_mm} by {height_mm} mm, ledge {ledge_mm} mm: {off}");
        }
    }
}
