//! Simulation of the impact and the following swing: a rigid body in the plane whose contact point is held by impulse
//! and force. It is independent of the closed form: it uses neither angular momentum about the edge nor energy.

use nalgebra::{Matrix2, Vector2};

use super::peg::Pivot;
use crate::numerics::{bisect, runge_kutta};
use upm_core::geometry::cross;
use upm_core::units::GRAVITY_MPS2;

/// Steps in the time `sqrt(h/g)`, h being the centre's height above the edge.
const STEPS: f64 = 1_000.0;
/// Such times after which a part that has neither toppled nor fallen back counts as balanced on its edge.
const MOST_TIMES: f64 = 400.0;
/// Halvings of the interval of speeds.
const HALVINGS: usize = 40;

impl Pivot {
    /// True when a part that arrives at `speed_mps` topples over the edge.
    pub fn topples(&self, speed_mps: f64) -> bool {
        let mut body = self.after_impact(speed_mps);
        let step_s = (self.above_m / GRAVITY_MPS2).sqrt() / STEPS;
        for _ in 0..(MOST_TIMES * STEPS) as usize {
            if body[0] > 0.0 || body[0] < -self.behind_m {
                return body[0] > 0.0;
            }
            body = runge_kutta(body, step_s, |body, _| self.slope(body));
        }
        false
    }

    /// The body after the impulse that stops its point at the edge: plastic, and the edge holds. Its centre from the
    /// edge, m, the centre's velocity, m/s, and spin, counter-clockwise, rad/s.
    fn after_impact(&self, speed_mps: f64) -> [f64; 5] {
        let arm_m = Vector2::new(self.behind_m, -self.above_m);
        let velocity_mps = Vector2::new(speed_mps, 0.0);
        let impulse = self.inverse_mass(arm_m).try_inverse().map_or_else(Vector2::zeros, |mass| -(mass * velocity_mps));
        let velocity_mps = velocity_mps + impulse;
        let spin_radps = cross(arm_m, impulse) / self.gyration_m2;
        [-self.behind_m, self.above_m, velocity_mps.x, velocity_mps.y, spin_radps]
    }

    /// Velocity that a unit impulse on a unit mass gives the point at `arm_m` from the centre.
    fn inverse_mass(&self, arm_m: Vector2<f64>) -> Matrix2<f64> {
        let turned = Vector2::new(-arm_m.y, arm_m.x);
        Matrix2::identity() + turned * turned.transpose() / self.gyration_m2
    }

    /// Rates of change under gravity and the force that keeps the body's point at the edge.
    fn slope(&self, [x, y, u, v, spin_radps]: [f64; 5]) -> [f64; 5] {
        let arm_m = Vector2::new(-x, -y);
        let gravity = Vector2::new(0.0, -GRAVITY_MPS2);
        // acceleration of the point without the force: gravity and the centripetal acceleration
        let free = gravity - arm_m * spin_radps.powi(2);
        let force = self.inverse_mass(arm_m).try_inverse().map_or_else(Vector2::zeros, |mass| -(mass * free));
        let accel = gravity + force;
        [u, v, accel.x, accel.y, cross(arm_m, force) / self.gyration_m2]
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

#[cfg(test)]
mod tests {
    use super::super::peg::{Peg, Shape};
    use super::*;
    use rand::RngExt;
    use upm_core::random::Streams;

    /// A free body in time steps, whose point at the edge is stopped by an impulse in each: true if it topples, and
    /// true if an impulse was both downward and forward, which neither table nor ledge can give.
    fn stepped(behind_m: f64, above_m: f64, gyration_m2: f64, speed_mps: f64) -> [bool; 2] {
        const STEPS: f64 = 4_000.0;
        let step_s = (above_m.min(behind_m) / GRAVITY_MPS2).sqrt() / STEPS;
        let (mut center, mut turned_rad) = ([-behind_m, above_m], 0.0f64);
        let (mut velocity, mut spin, mut pulls) = ([speed_mps, 0.0], 0.0, false);
        for i in 0..2_000_000 {
            if center[0] > 0.0 || (i > 0 && center[0] < -behind_m * (1.0 + 1e-6)) {
                return [center[0] > 0.0, pulls];
            }
            if i > 0 {
                velocity[1] -= GRAVITY_MPS2 * step_s;
            }
            // the point from the centre, and its velocity; half of its distance from the edge is taken back
            let (sin, cos) = turned_rad.sin_cos();
            let arm = [behind_m * cos + above_m * sin, behind_m * sin - above_m * cos];
            let slip = [0, 1].map(|axis| velocity[axis] + 0.5 * (center[axis] + arm[axis]) / step_s);
            let slip = [slip[0] - spin * arm[1], slip[1] + spin * arm[0]];
            let [a, b, d] = [
                1.0 + arm[1] * arm[1] / gyration_m2,
                -arm[0] * arm[1] / gyration_m2,
                1.0 + arm[0] * arm[0] / gyration_m2,
            ];
            let impulse = [b * slip[1] - d * slip[0], b * slip[0] - a * slip[1]].map(|one| one / (a * d - b * b));
            velocity = [0, 1].map(|axis| velocity[axis] + impulse[axis]);
            spin += (arm[0] * impulse[1] - arm[1] * impulse[0]) / gyration_m2;
            pulls |= i > 10 && impulse[1] < -1e-3 * GRAVITY_MPS2 * step_s && impulse[0] > 0.0;
            center = [0, 1].map(|axis| center[axis] + velocity[axis] * step_s);
            turned_rad += spin * step_s;
        }
        [false, pulls]
    }

    #[test]
    #[expect(clippy::print_stdout, reason = "the table, with --nocapture")]
    fn closed_form_of_random_blocks_and_cylinders_is_that_of_time_steps() {
        let mut rng = Streams::new(43).stream("pegs");
        let mut held = 0;
        for i in 0..30 {
            let shape = [Shape::BLOCK, Shape::CYLINDER, Shape::LYING_CYLINDER][i % 3];
            let length_m = 10f64.powf(rng.random_range(-3.0..-1.0));
            let height_m = length_m * 10f64.powf(rng.random_range(-0.8..0.6));
            let ledge_m = if i % 2 == 0 { 0.0 } else { height_m * rng.random_range(0.0..0.3) };
            let (l2, h2) = (length_m * length_m, height_m * height_m);
            let gyration_m2 = [(l2 + h2) / 12.0, l2 / 16.0 + h2 / 12.0, l2 / 12.0 + h2 / 16.0][i % 3];
            let pivot = Peg { shape, length_m, height_m }.pivot(ledge_m).unwrap();
            let stepped = |speed_mps: f64| stepped(0.5 * length_m, 0.5 * height_m - ledge_m, gyration_m2, speed_mps);
            let exact_mps = pivot.critical_mps();
            let [slow, fast] = [0.999, 1.001].map(|share| stepped(share * exact_mps));
            assert_eq!([slow[0], fast[0]], [false, true], "{shape:?} {length_m} {height_m} {ledge_m}");
            let simulated = [0.999, 1.001].map(|share| pivot.topples(share * exact_mps));
            assert_eq!(simulated, [false, true], "{shape:?} {length_m} {height_m} {ledge_m}");
            let [rise, least] = pivot.rise();
            println!(
                "{i:2} {shape:?} {length_m:.4} {height_m:.4} {ledge_m:.4} m: {exact_mps:.4} m/s, pulls {}",
                fast[1]
            );
            if (rise - least).abs() > 0.01 {
                assert_eq!(rise < least, fast[1], "{shape:?} {length_m} {height_m} {ledge_m}: {rise} {least}");
            }
            held += usize::from(rise >= least);
        }
        println!("{held} of 30 with a reference");
        assert!((15..30).contains(&held), "{held}");
    }
}
