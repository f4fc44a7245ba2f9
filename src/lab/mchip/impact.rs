//! The impulse of one impact with Coulomb friction: the law of Mirtich's Impulse engine.
//!
//! The contact velocity `u` changes by `K dp`, K being the inverse mass of both bodies at the contact. The slip may
//! slow down, stop and reverse while the normal impulse grows, and restitution is one of energy, so that no impact
//! creates energy (Stronge 1990, Mirtich 1996).

use nalgebra::{Matrix2, Matrix3, Matrix3x2, Vector3};

/// Steps of the normal impulse up to the end of compression.
const COMPRESSION_STEPS: f64 = 12.0;
/// Share of the frictionless opening rate below which the step no longer grows.
const LEAST_OPENING: f64 = 1e-3;
/// Turn of the slip in one step, rad.
const MOST_TURN: f64 = 0.15;
/// Steps after which an impact is cut short: reached where slip creeps about the edge of the friction cone.
const MOST_STEPS: usize = 300;
/// Slip below this share of the approach speed counts as sticking.
const NO_SLIP: f64 = 1e-3;
/// Least slip, as a share of the approach speed, for limiting the step by the slip's turn.
const LEAST_TURNED: f64 = 0.01;

/// Collision of two bodies at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Collision {
    /// Change of the relative velocity by a unit impulse, 1/kg.
    pub inverse_mass: Matrix3<f64>,
    /// Velocity of the first body's point against the second's, m/s.
    pub velocity_mps: Vector3<f64>,
    /// Unit normal, towards the first body.
    pub normal: Vector3<f64>,
}

impl Collision {
    /// Impulse on the first body, N s, with these surface constants; the second takes its opposite. Zero for points
    /// that separate.
    pub fn impulse(&self, friction: f64, restitution: f64) -> Vector3<f64> {
        if self.velocity_mps.dot(&self.normal) >= 0.0 {
            return Vector3::zeros();
        }
        let normal = self.normal;
        let start_mps = -self.velocity_mps.dot(&normal);
        let least_opening = LEAST_OPENING * normal.dot(&(self.inverse_mass * normal));
        let (mut velocity, mut impulse) = (self.velocity_mps, Vector3::zeros());
        let no_slip_mps = NO_SLIP * start_mps;
        // work of the normal impulse; `goal` is set when compression ends
        let (mut work, mut goal) = (0.0, None);
        for _ in 0..MOST_STEPS {
            let closing = velocity.dot(&normal);
            let slip = velocity - normal * closing;
            let speed = slip.norm();
            let slides = speed > no_slip_mps;
            let mut push =
                if slides { normal - slip * (friction / speed) } else { normal + self.sticking_push(friction) };
            let mut rate = self.inverse_mass * push;
            let mut opening = rate.dot(&normal);
            let mut step = start_mps / (COMPRESSION_STEPS * opening.max(least_opening));
            if slides {
                let drift = rate - normal * opening;
                let braking = drift.dot(&slip) / speed;
                let turning = (drift - slip * (braking / speed)).norm();
                // a slip that turns changes the friction's direction
                step = step.min(MOST_TURN * speed.max(LEAST_TURNED * start_mps) / turning.max(f64::MIN_POSITIVE));
                if speed + braking * step < 0.0 {
                    step = -speed / braking;
                } else {
                    // the friction at the middle of the step
                    let middle = slip + drift * (0.5 * step);
                    push = normal - middle * (friction / middle.norm().max(f64::MIN_POSITIVE));
                    rate = self.inverse_mass * push;
                    opening = rate.dot(&normal);
                }
            }
            let work_after = |step: f64| work + (closing + 0.5 * opening * step) * step;
            let mut over = false;
            match goal {
                None if closing + opening * step >= 0.0 => {
                    step = -closing / opening;
                    goal = Some(work_after(step) * (1.0 - restitution.powi(2)));
                }
                Some(goal) if work_after(step) >= goal => {
                    let root = (closing * closing + 2.0 * opening * (goal - work)).max(0.0).sqrt();
                    // the form without cancellation, whatever the sign of `opening`
                    step = if closing + root > 0.0 { 2.0 * (goal - work) / (closing + root) } else { step };
                    over = true;
                }
                _ => (),
            }
            work = work_after(step);
            velocity += rate * step;
            impulse += push * step;
            if over || goal.is_some_and(|goal| work >= goal) {
                return impulse;
            }
        }
        // cut short: the rest of the approach is stopped without friction, which stays in the cone and creates no
        // energy
        let left = (-velocity.dot(&normal)).max(0.0);
        impulse + normal * (left / normal.dot(&(self.inverse_mass * normal)))
    }

    /// Friction per normal impulse of a contact that does not slip: the value that holds it, or the limit in that
    /// direction.
    fn sticking_push(&self, friction: f64) -> Vector3<f64> {
        let tangents = self.tangents();
        let across: Matrix2<f64> = tangents.transpose() * self.inverse_mass * tangents;
        let Some(inverse) = across.try_inverse() else { return Vector3::zeros() };
        let holding = -(tangents * (inverse * (tangents.transpose() * (self.inverse_mass * self.normal))));
        let size = holding.norm();
        if size <= friction { holding } else { holding * (friction / size) }
    }

    /// Two unit vectors across the normal.
    fn tangents(&self) -> Matrix3x2<f64> {
        let aside = if self.normal.x.abs() < 0.7 { Vector3::x() } else { Vector3::z() };
        let first = (aside - self.normal * aside.dot(&self.normal)).normalize();
        Matrix3x2::from_columns(&[first, self.normal.cross(&first)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;
    use upm_core::random::Streams;

    impl Collision {
        /// Energy that `impulse` takes from both bodies, J.
        fn energy_lost_j(&self, impulse: &Vector3<f64>) -> f64 {
            -impulse.dot(&self.velocity_mps) - 0.5 * impulse.dot(&(self.inverse_mass * impulse))
        }
    }

    /// Collisions of a part like the paper's with a resonator, at any place and from any direction.
    fn meetings() -> impl Iterator<Item = Collision> {
        (0..3_000).map(|seed| {
            let mut rng = Streams::new(seed).stream("meetings");
            let mut vector = |size: f64| Vector3::from_fn(|_, _| rng.random_range(-size..size));
            let (arm, lever) = (vector(5e-4).cross_matrix(), vector(1.5e-4));
            let inertia = (vector(1.0) * 4e-15).map(|value| value.abs() + 1e-15);
            let inverse_mass = Matrix3::identity() / 55e-9
                - arm * Matrix3::from_diagonal(&inertia.map(f64::recip)) * arm
                + lever * lever.transpose() / 2.3e-18;
            let normal = vector(1.0).normalize();
            let velocity = vector(0.2);
            let velocity_mps = if velocity.dot(&normal) < 0.0 { velocity } else { -velocity };
            Collision { inverse_mass, velocity_mps, normal }
        })
    }

    const RESTITUTION: f64 = 0.5;

    #[test]
    fn impulse_stays_in_the_friction_cone_separates_and_never_creates_energy() {
        for friction in [0.0, 0.3, 1.0] {
            for meeting in meetings() {
                let impulse = meeting.impulse(friction, RESTITUTION);
                let lost_j = meeting.energy_lost_j(&impulse);
                let scale_j = impulse.norm() * meeting.velocity_mps.norm();
                assert!(lost_j >= -1e-9 * scale_j, "{friction}: {lost_j} of {scale_j} for {meeting:?}");
                let along = impulse.dot(&meeting.normal);
                let across = (impulse - meeting.normal * along).norm();
                let most = friction * along * (1.0 + 1e-9) + 1e-15 * along;
                assert!(along > 0.0 && across <= most, "{meeting:?}");
                let after_mps = (meeting.velocity_mps + meeting.inverse_mass * impulse).dot(&meeting.normal);
                assert!(after_mps > -1e-9, "{friction} {after_mps} {impulse}");
            }
        }
    }

    #[test]
    fn slip_that_reverses_is_pushed_both_ways() {
        // a light resonator: its rim rises and moves forward, then falls and moves backward
        let lever = Vector3::new(1.7e-5, 0.0, 1.4e-4);
        let meeting = Collision {
            inverse_mass: Matrix3::identity() / 55e-9 + lever * lever.transpose() / 2.3e-18,
            velocity_mps: -lever * 300.0,
            normal: Vector3::z(),
        };
        let impulse = meeting.impulse(1.0, RESTITUTION);
        // forward in compression, backward in restitution: (1 - q)/(1 + q), with q near e, corrected for the turn by
        // friction
        let turn: f64 = 1.7e-5 / 1.4e-4;
        let q = 0.5 * ((1.0 + turn) / (1.0 - turn)).sqrt();
        assert!((impulse.x / impulse.z - (1.0 - q) / (1.0 + q)).abs() < 0.03, "{impulse}");
    }
}
