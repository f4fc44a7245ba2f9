//! Contacts of parts, rim to rim: an impulse with restitution along the line of centres, Coulomb friction across it,
//! both rigid and instantaneous. The step in which the rims overlapped is taken back to the instant of touch and
//! repeated with the new velocities, so that momentum, angular momentum and energy are exact; only an overlap that
//! existed before is pushed apart. Equation sheet, section 6.

use super::ContactParams;
use super::parts::PartBody;
use upm_core::geometry::{Vec2, perp};

/// Gap from which a pair that has touched is no longer in contact, m.
const RELEASE_GAP_M: f64 = 5e-5;
/// Largest gap that is measured, m.
const HORIZON_M: f64 = 2e-3;
/// Tolerated overlap, m.
const SLOP_M: f64 = 1e-7;

/// Pairs in contact, number of touches, and the distance for which nothing can touch.
#[derive(Clone, Debug)]
pub(super) struct Contacts {
    params: ContactParams,
    step_s: f64,
    in_contact: Vec<bool>,
    /// Contacts begun so far.
    pub touches: u64,
    /// Lower bound of all gaps, m.
    clearance_m: f64,
}

impl Contacts {
    pub fn new(params: &ContactParams, parts: usize, step_s: f64) -> Self {
        let pairs = parts * parts.saturating_sub(1) / 2;
        Self { params: *params, step_s, in_contact: vec![false; pairs], touches: 0, clearance_m: 0.0 }
    }

    /// Resolves contacts, if any gap can have closed, after a step in which no part moved farther than `moved_m`.
    #[inline]
    pub fn step(&mut self, bodies: &mut [PartBody], moved_m: f64) {
        self.clearance_m -= 2.0 * moved_m;
        if self.clearance_m <= 0.0 {
            self.clearance_m = self.resolve(bodies);
        }
    }

    /// One pass over all pairs; returns the smallest gap left, zero while any pair is in contact.
    fn resolve(&mut self, bodies: &mut [PartBody]) -> f64 {
        let mut clearance_m = HORIZON_M;
        let mut pairs = self.in_contact.iter_mut();
        for j in 1..bodies.len() {
            let (earlier, later) = bodies.split_at_mut(j);
            let Some(b) = later.first_mut() else { continue };
            for (a, in_contact) in earlier.iter_mut().zip(&mut pairs) {
                let gap_m = gap(a, b);
                if gap_m > RELEASE_GAP_M {
                    *in_contact = false;
                    clearance_m = clearance_m.min(gap_m);
                    continue;
                }
                clearance_m = 0.0;
                if gap_m <= 0.0 {
                    self.touches += u64::from(!*in_contact);
                    *in_contact = true;
                    meet(&self.params, self.step_s, a, b);
                }
            }
        }
        clearance_m
    }
}

/// Distance between rims, m; the horizon when it is more, or when one is a point or has fallen.
#[inline]
fn gap(a: &PartBody, b: &PartBody) -> f64 {
    let reach_m = a.radius_m + b.radius_m;
    let apart = b.motion.part_in_table.position_m - a.motion.part_in_table.position_m;
    let distance2 = apart.norm_squared();
    let can_touch = |body: &PartBody| body.motion.on_plate && body.radius_m != 0.0;
    if distance2 > (reach_m + HORIZON_M).powi(2) || !(can_touch(a) && can_touch(b)) {
        return HORIZON_M;
    }
    distance2.sqrt() - reach_m
}

/// Resolves two overlapping discs: by an impulse if they approach, else by separating them.
fn meet(params: &ContactParams, step_s: f64, a: &mut PartBody, b: &mut PartBody) {
    let apart = b.motion.part_in_table.position_m - a.motion.part_in_table.position_m;
    let approach = b.motion.velocity_mps - a.motion.velocity_mps;
    let reach_m = a.radius_m + b.radius_m;
    let closing = -apart.dot(&approach);
    if closing <= 0.0 {
        separate(a, b, apart, reach_m);
        return;
    }
    // |apart - approach t| = reach, t before now
    let overlap = reach_m * reach_m - apart.norm_squared();
    let since_touch_s = overlap / (closing + (closing * closing + approach.norm_squared() * overlap).sqrt());
    let since_touch_s = since_touch_s.min(step_s);
    carry(a, b, -since_touch_s);
    let normal = (apart - approach * since_touch_s).try_normalize(1e-12).unwrap_or(Vec2::x());
    bounce(params, a, b, normal, approach);
    carry(a, b, since_touch_s);
}

/// Velocities after the impulse along and across `normal`, which points from `a` to `b`.
fn bounce(params: &ContactParams, a: &mut PartBody, b: &mut PartBody, normal: Vec2, approach: Vec2) {
    let inverse_mass = a.inverse_mass + b.inverse_mass;
    let closing_mps = (-approach.dot(&normal)).max(0.0);
    let push = (1.0 + params.restitution) * closing_mps / inverse_mass;
    let tangent = perp(normal);
    let rims_mps = a.radius_m * a.motion.spin_radps + b.radius_m * b.motion.spin_radps;
    let rubbing_mps = approach.dot(&tangent) - rims_mps;
    // 1/m + R²/I = 3/m for I = mR²/2: a rim point yields three times as easily as the centre
    let grip = params.rim_friction * push;
    let rub = (-rubbing_mps / (3.0 * inverse_mass)).max(-grip).min(grip);

    let impulse = normal * push + tangent * rub;
    a.motion.velocity_mps -= impulse * a.inverse_mass;
    b.motion.velocity_mps += impulse * b.inverse_mass;
    a.motion.spin_radps -= 2.0 * rub * a.inverse_mass / a.radius_m;
    b.motion.spin_radps -= 2.0 * rub * b.inverse_mass / b.radius_m;
}

/// Moves both for `time_s` at their velocities.
fn carry(a: &mut PartBody, b: &mut PartBody, time_s: f64) {
    for motion in [&mut a.motion, &mut b.motion] {
        motion.part_in_table.position_m += motion.velocity_mps * time_s;
        motion.part_in_table.heading_rad += motion.spin_radps * time_s;
    }
}

/// Pushes discs apart rim to rim, the lighter one farther.
fn separate(a: &mut PartBody, b: &mut PartBody, apart: Vec2, reach_m: f64) {
    let overlap_m = reach_m - apart.norm();
    if overlap_m <= SLOP_M {
        return;
    }
    let shift = apart.try_normalize(1e-12).unwrap_or(Vec2::x()) * (overlap_m / (a.inverse_mass + b.inverse_mass));
    a.motion.part_in_table.position_m -= shift * a.inverse_mass;
    b.motion.part_in_table.position_m += shift * b.inverse_mass;
}

#[cfg(test)]
mod tests {
    use crate::plate::PlateMotion;
    use crate::{ContactParams, PartParams, Parts};
    use proptest::prelude::*;
    use upm_core::geometry::{Pose, Vec2, cross};

    const STEP_S: f64 = 5e-5;

    fn disc(radius_m: f64, mass_kg: f64, friction: f64) -> PartParams {
        PartParams { radius_m, thickness_m: 1.5e-3, mass_kg, friction }
    }

    fn at(x: f64, y: f64) -> Pose {
        Pose { position_m: Vec2::new(x, y), heading_rad: 0.0 }
    }

    /// Momentum, angular momentum about the origin, kinetic energy.
    fn totals(parts: &Parts, params: &[PartParams]) -> (Vec2, f64, f64) {
        parts.motions().zip(params).fold((Vec2::zeros(), 0.0, 0.0), |(p, l, e), (motion, part)| {
            let (m, inertia) = (part.mass_kg, 0.5 * part.mass_kg * part.radius_m * part.radius_m);
            let (v, w) = (motion.velocity_mps, motion.spin_radps);
            let spin = cross(motion.part_in_table.position_m, v) * m + inertia * w;
            (p + v * m, l + spin, e + 0.5 * m * v.norm_squared() + 0.5 * inertia * w * w)
        })
    }

    proptest! {
        #[test]
        fn momentum_is_kept_and_energy_not_gained(
            offset in -0.015..0.015f64, speed in 0.05..1.0f64, spins in [-50.0..50.0f64, -50.0..50.0f64],
            masses in [1e-3..6e-3f64, 1e-3..6e-3f64], restitution in 0.0..1.0f64, rim_friction in 0.0..1.0f64,
        ) {
            let params = [disc(9e-3, masses[0], 0.0), disc(11e-3, masses[1], 0.0)];
            let contact = ContactParams { restitution, rim_friction };
            let mut parts = Parts::new(&[(params[0], at(-0.03, offset)), (params[1], at(0.0, 0.0))], &contact, 10.0, STEP_S);
            parts.push(0, Vec2::new(speed, 0.0), spins[0]);
            parts.push(1, Vec2::new(-0.1 * speed, 0.0), spins[1]);
            let (p0, l0, e0) = totals(&parts, &params);
            let steps = (0.05 / (speed * STEP_S)) as usize;
            for _ in 0..steps { parts.step(&PlateMotion::default()); }
            let (p1, l1, e1) = totals(&parts, &params);
            prop_assert_eq!(parts.collisions(), 1);
            prop_assert!((p1 - p0).norm() < 1e-15 && (l1 - l0).abs() < 1e-16, "{p0} {p1} {l0} {l1}");
            prop_assert!(e1 <= e0 * (1.0 + 1e-12));
        }
    }

    #[test]
    fn a_central_hit_follows_newtons_restitution() {
        let params = [disc(1e-2, 2e-3, 0.0), disc(1e-2, 4e-3, 0.0)];
        let contact = ContactParams { restitution: 0.5, rim_friction: 0.3 };
        let mut parts = Parts::new(&[(params[0], at(-0.05, 0.0)), (params[1], at(0.0, 0.0))], &contact, 1.0, STEP_S);
        parts.push(0, Vec2::new(0.6, 0.0), 0.0);
        for _ in 0..2000 {
            parts.step(&PlateMotion::default());
        }
        let speeds: Vec<f64> = parts.motions().map(|m| m.velocity_mps.x).collect();
        assert!((speeds[0] - 0.0).abs() < 1e-12 && (speeds[1] - 0.3).abs() < 1e-12, "{speeds:?}");
    }

    #[test]
    fn a_pushed_pair_is_one_touch_and_a_second_meeting_another() {
        let params = [disc(1e-2, 2e-3, 0.3), disc(1e-2, 2e-3, 0.3)];
        let contact = ContactParams { restitution: 0.0, rim_friction: 0.2 };
        let mut parts = Parts::new(&[(params[0], at(-0.021, 0.0)), (params[1], at(0.0, 0.0))], &contact, 1.0, STEP_S);
        let mut run = |velocity: f64| {
            parts.push(0, Vec2::new(velocity, 0.0), 0.0);
            for _ in 0..4000 {
                parts.step(&PlateMotion::default());
            }
            parts.collisions()
        };
        assert_eq!(run(0.3), 1);
        assert_eq!(run(0.1), 1, "still side by side");
        assert_eq!(run(-0.1), 1, "drawn apart");
        assert_eq!(run(0.3), 2);
    }

    #[test]
    fn parts_never_stay_inside_each_other() {
        let params = disc(1e-2, 2.5e-3, 0.3);
        let row: Vec<_> = (0..5).map(|i| (params, at(0.0205 * f64::from(i), 1e-4 * f64::from(i)))).collect();
        let contact = ContactParams { restitution: 0.3, rim_friction: 0.2 };
        let mut parts = Parts::new(&row, &contact, 1.0, STEP_S);
        parts.push(0, Vec2::new(0.8, 0.0), 0.0);
        for _ in 0..20_000 {
            parts.step(&PlateMotion::default());
        }
        let places: Vec<Vec2> = parts.motions().map(|m| m.part_in_table.position_m).collect();
        for pair in places.windows(2) {
            assert!((pair[1] - pair[0]).norm() > 0.02 - 1e-6);
        }
        assert!(parts.collisions() >= 4);
    }
}
