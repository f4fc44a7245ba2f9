//! Parts on the plate: discs driven by friction, colliding with each other, falling off the edge.
//!
//! Inputs: the plate's motion at the middle of a step. States: pose, velocity and spin of each part in the table
//! frame. Output: the wrench that the parts exert on the plate. Semi-implicit steps: friction changes the velocity,
//! sticking where it can (see [`DiscFriction::remaining_slip_fractions`]), and the new velocity carries the part.

mod body;

use super::collision::Contacts;
use super::faults::{Oil, PlantFaults};
use super::plate::{PlateMotion, Wrench};
use super::{ContactParams, PartParams};
use upm_core::disc_friction::DiscFriction;
use upm_core::geometry::{Pose, Vec2, cross};

pub(super) use body::PartBody;
pub use body::PartMotion;

/// Position of parts that are taken off the plate, m: far outside every view.
const AWAY_M: f64 = 100.0;

/// SIMD lanes: parts whose friction is solved side by side.
const LANES: usize = 8;
/// Parts from which the lanes are used: with two a step takes as long either way, with four it is shorter in lanes.
const WORTH_LANES: usize = 3;

/// Factor on the friction of part `part` at `arm_m` from the plate's centre.
fn friction_factor(faults: &PlantFaults, part: usize, arm_m: Vec2) -> f64 {
    let own = faults.friction.get(part).copied().unwrap_or(1.0);
    let is_in = |oil: &Oil| (arm_m - oil.center_m).norm_squared() < oil.radius_m * oil.radius_m;
    own * faults.oil.filter(is_in).map_or(1.0, |oil| oil.friction)
}

/// All parts of one plate.
#[derive(Clone, Debug)]
pub struct Parts {
    bodies: Vec<PartBody>,
    contacts: Contacts,
    friction: &'static DiscFriction,
    half_side_m: f64,
    step_s: f64,
    fastest_mps: f64,
    faults: PlantFaults,
}

impl Parts {
    /// Parts at rest on a square plate, for steps of `step_s`. A part of radius zero is a point: it slides by Coulomb's
    /// law and neither spins nor touches others.
    pub fn new(parts: &[(PartParams, Pose)], contact: &ContactParams, plate_side_m: f64, step_s: f64) -> Self {
        Self {
            bodies: parts.iter().map(|(params, pose)| PartBody::new(params, *pose, step_s)).collect(),
            contacts: Contacts::new(contact, parts.len(), step_s),
            friction: DiscFriction::shared(),
            half_side_m: 0.5 * plate_side_m,
            step_s,
            fastest_mps: 0.0,
            faults: PlantFaults::default(),
        }
    }

    /// Advances one step over a plate that moves as `plate` at the middle of the step. Returns the wrench of the parts'
    /// friction on the plate, about the plate's centre.
    #[inline(always)]
    pub fn step(&mut self, plate: &PlateMotion) -> Wrench {
        let (center, tilt) = (plate.plate_in_table.position_m, plate.plate_in_table.heading_rad);
        let (mut impulse, mut turn, mut liveliest) = (Vec2::zeros(), 0.0, 0.0f64);
        let Self { bodies, faults, .. } = self;
        let pull_mps = faults.pull_mps2 * self.step_s;
        for (group, bodies) in bodies.chunks_mut(LANES).enumerate() {
            let (mut arms, mut slips) = ([Vec2::zeros(); LANES], [(Vec2::zeros(), 0.0); LANES]);
            // nothing holds a lane without a part
            let (mut slide_mps, mut rim_mps, mut reach_mps) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
            for (i, body) in bodies.iter_mut().enumerate().filter(|(_, body)| body.motion.on_plate) {
                arms[i] = body.motion.part_in_table.position_m - center;
                reach_mps[i] = body.reach_mps * friction_factor(faults, LANES * group + i, arms[i]);
                body.motion.velocity_mps += pull_mps;
                slips[i] = body.slip(plate.twist.velocity_at(arms[i]), plate.twist.spin_radps);
                (slide_mps[i], rim_mps[i]) = (slips[i].0.norm_squared().sqrt(), body.radius_m * slips[i].1.abs());
            }
            let friction = self.friction;
            let kept = if bodies.len() < WORTH_LANES {
                let alone = |i: usize| friction.remaining_slip_fractions(slide_mps[i], rim_mps[i], reach_mps[i]);
                std::array::from_fn(|i| if i < bodies.len() { alone(i) } else { [0.0; 2] })
            } else {
                friction.remaining_slip_fractions_of(slide_mps, rim_mps, reach_mps)
            };
            for (i, body) in bodies.iter_mut().enumerate().filter(|(_, body)| body.motion.on_plate) {
                let (sped, spun) = (slips[i].0 * (kept[i][0] - 1.0), slips[i].1 * (kept[i][1] - 1.0));
                body.motion.velocity_mps += sped;
                body.motion.spin_radps += spun;
                impulse += sped * body.mass_kg;
                turn += cross(arms[i], sped) * body.mass_kg + body.inertia_kgm2() * spun;
                liveliest = liveliest.max(body.min_rim_speed_squared());

                let motion = &mut body.motion;
                motion.part_in_table.position_m += motion.velocity_mps * self.step_s;
                motion.part_in_table.heading_rad += motion.spin_radps * self.step_s;
                let along_plate = Vec2::new(arms[i].x + tilt * arms[i].y, arms[i].y - tilt * arms[i].x);
                if along_plate.amax() > self.half_side_m {
                    body.fall(arms[i], self.half_side_m);
                }
            }
        }
        self.fastest_mps = liveliest.sqrt();
        self.contacts.step(&mut self.bodies, self.fastest_mps * self.step_s);
        Wrench::new(impulse.x, impulse.y, turn) * -self.step_s.recip()
    }

    /// Number of parts, fallen ones included.
    pub(crate) fn len(&self) -> usize {
        self.bodies.len()
    }

    /// State of every part, in the order of [`Self::new`].
    pub fn motions(&self) -> impl ExactSizeIterator<Item = &PartMotion> {
        self.bodies.iter().map(|body| &body.motion)
    }

    /// Sets the velocity and spin of part `part`; no effect when there is no such part.
    pub fn push(&mut self, part: usize, velocity_mps: Vec2, spin_radps: f64) {
        if let Some(body) = self.bodies.get_mut(part) {
            (body.motion.velocity_mps, body.motion.spin_radps) = (velocity_mps, spin_radps);
        }
    }

    /// Number of touches between parts so far.
    pub fn collisions(&self) -> u64 {
        self.contacts.touches
    }

    /// Largest `sqrt(v² + (R ω)²)` of a part in the last step, m/s: a lower bound of its fastest rim point.
    pub(crate) fn fastest_mps(&self) -> f64 {
        self.fastest_mps
    }

    /// True if friction holds every part at rest on a plate at rest, tilted or not.
    pub(crate) fn are_held(&self) -> bool {
        let pull_mps = self.faults.pull_mps2.norm() * self.step_s;
        let is_held = |(part, body): (usize, &PartBody)| {
            let factor = friction_factor(&self.faults, part, body.motion.part_in_table.position_m);
            !body.motion.on_plate || pull_mps <= body.reach_mps * factor
        };
        self.bodies.iter().enumerate().all(is_held)
    }

    /// Stops every part at its position.
    pub(crate) fn settle(&mut self) {
        for body in &mut self.bodies {
            body.motion.velocity_mps = Vec2::zeros();
            body.motion.spin_radps = 0.0;
        }
        self.fastest_mps = 0.0;
    }

    /// Replaces all present faults by `faults`: parts that are taken off vanish, those put back return.
    pub(crate) fn set_faults(&mut self, faults: &PlantFaults) {
        for (part, body) in self.bodies.iter_mut().enumerate() {
            match (faults.removed.contains(&part), body.taken_from) {
                (true, None) if body.motion.on_plate => {
                    body.taken_from = Some(body.motion.part_in_table);
                    let away = Pose { position_m: Vec2::new(AWAY_M, AWAY_M * part as f64), heading_rad: 0.0 };
                    body.motion = PartMotion { on_plate: false, ..PartMotion::at_rest(away) };
                }
                (false, Some(place)) => {
                    body.taken_from = None;
                    body.motion = PartMotion::at_rest(place);
                }
                _ => {}
            }
        }
        self.faults = faults.clone();
    }

    /// Moves part `part` by `by_m` by hand; a part that ends off the plate falls.
    pub(crate) fn shift(&mut self, part: usize, by_m: Vec2) {
        if let Some(body) = self.bodies.get_mut(part).filter(|body| body.motion.on_plate) {
            body.motion.part_in_table.position_m += by_m;
        }
    }

    /// Exchanges the positions of two parts on the plate.
    pub(crate) fn exchange(&mut self, [a, b]: [usize; 2]) {
        if let (Some(first), Some(second)) = (self.bodies.get(a), self.bodies.get(b))
            && first.taken_from.or(second.taken_from).is_none()
        {
            let (first, second) = (first.motion, second.motion);
            (self.bodies[a].motion, self.bodies[b].motion) = (second, first);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use upm_core::geometry::Twist;
    use upm_core::units::GRAVITY_MPS2;

    const PENNY: PartParams = PartParams::PENNY;
    const CONTACT: ContactParams = ContactParams { restitution: 0.5, rim_friction: 0.2 };
    const STEP_S: f64 = 5e-5;
    const DECELERATION: f64 = 0.3 * GRAVITY_MPS2;

    fn one(params: PartParams, velocity_mps: Vec2, spin_radps: f64) -> Parts {
        let mut parts = Parts::new(&[(params, Pose::IDENTITY)], &CONTACT, 2.0, STEP_S);
        parts.push(0, velocity_mps, spin_radps);
        parts
    }

    /// Steps on a resting plate until the part rests; returns the time, s, and the slip ratio before the last step.
    fn coast(parts: &mut Parts) -> (f64, f64) {
        let (mut ratio, mut time_s) = (f64::NAN, 0.0);
        loop {
            parts.step(&PlateMotion::default());
            time_s += STEP_S;
            assert!(time_s < 10.0, "still moving");
            let motion = parts.bodies[0].motion;
            if motion.velocity_mps == Vec2::zeros() && motion.spin_radps == 0.0 {
                return (time_s, ratio);
            }
            ratio = motion.velocity_mps.norm() / (motion.spin_radps * parts.bodies[0].radius_m);
        }
    }

    #[test]
    fn a_sliding_part_stops_after_its_braking_distance() {
        for params in [PENNY, PartParams { radius_m: 0.0, ..PENNY }] {
            let mut parts = one(params, Vec2::new(0.3, 0.4), 0.0);
            let (time_s, _) = coast(&mut parts);
            let end = parts.bodies[0].motion.part_in_table.position_m;
            let expected = Vec2::new(0.6, 0.8) * (0.25 / (2.0 * DECELERATION));
            assert!((end - expected).norm() < 0.5 * STEP_S * 0.5 * 1.01, "{end} {expected}");
            assert!((time_s - 0.5 / DECELERATION).abs() < 2.0 * STEP_S);
        }
    }

    #[test]
    fn a_spinning_part_stops_after_three_quarters_of_its_rim_speed() {
        // I w' = -(2/3) μ m g R with I = m R²/2
        let mut parts = one(PENNY, Vec2::zeros(), 40.0);
        let (time_s, _) = coast(&mut parts);
        assert!((time_s - 0.75 * 40.0 * PENNY.radius_m / DECELERATION).abs() < 2.0 * STEP_S, "{time_s}");
        assert_eq!(parts.bodies[0].motion.part_in_table.position_m, Vec2::zeros());
    }

    #[test]
    fn sliding_and_spinning_end_together() {
        // Farkas et al.: from any start, v/(R w) tends to 0.653, and both motions end at once.
        for start in [0.3, 0.5, 0.653, 0.9, 2.0, 6.0] {
            let speed = 0.4;
            let (_, ratio) = coast(&mut one(PENNY, Vec2::new(0.0, speed), speed / (start * PENNY.radius_m)));
            assert!((ratio - 0.653).abs() < 0.01 + 0.2 * f64::abs(start - 0.653), "{start}: {ratio}");
        }
    }

    /// The same part as 400 patches under Coulomb's law, without tables, in steps a hundred times finer.
    #[test]
    fn a_shaken_disc_moves_as_its_patches_do() {
        const PATCHES: usize = 400;
        const FINER: usize = 100;
        let (start, twist_at) = (Vec2::new(0.012, 0.005), |t: f64| {
            let wave = (377.0 * t).cos() - 0.5 * (754.0 * t).cos();
            Twist::new(0.05, -0.02, 8.0) * wave
        });
        let patches: Vec<Vec2> = (0..PATCHES)
            .map(|i| {
                let (radius, angle) = (((i as f64 + 0.5) / PATCHES as f64).sqrt(), 2.399_963_23 * i as f64);
                Vec2::new(angle.cos(), angle.sin()) * (radius * PENNY.radius_m)
            })
            .collect();
        let (mut p, mut v, mut heading, mut spin) = (start, Vec2::zeros(), 0.0, 0.0);
        let mut parts = Parts::new(&[(PENNY, Pose { position_m: start, heading_rad: 0.0 })], &CONTACT, 2.0, STEP_S);
        let h = STEP_S / FINER as f64;
        for i in 0..1000 {
            for k in 0..FINER {
                let plate = twist_at((i as f64 + (k as f64 + 0.5) / FINER as f64) * STEP_S);
                let (mut pull, mut turn) = (Vec2::zeros(), 0.0);
                for r in &patches {
                    let slip = v + upm_core::geometry::perp(*r) * spin - plate.velocity_at(p + r);
                    let drag = -slip / (slip.norm() + 1e-6);
                    pull += drag;
                    turn += cross(*r, drag);
                }
                v += pull * (DECELERATION / PATCHES as f64 * h);
                spin += turn * (2.0 * DECELERATION / (PENNY.radius_m.powi(2) * PATCHES as f64) * h);
                p += v * h;
                heading += spin * h;
            }
            parts.step(&PlateMotion { twist: twist_at((i as f64 + 0.5) * STEP_S), ..Default::default() });
        }
        let end = parts.bodies[0].motion.part_in_table;
        let (way, turned) = ((p - start).norm(), heading);
        assert!(way > 4e-4 && turned.abs() > 0.02, "{way} {turned}");
        assert!((end.position_m - p).norm() < 5e-3 * way, "{} {p}", end.position_m);
        assert!((end.heading_rad - heading).abs() < 5e-3 * turned.abs(), "{} {heading}", end.heading_rad);
    }

    #[test]
    fn friction_transfers_momentum_from_the_part_to_the_plate() {
        let mut parts =
            Parts::new(&[(PENNY, Pose { position_m: Vec2::new(0.05, 0.02), heading_rad: 0.0 })], &CONTACT, 2.0, STEP_S);
        parts.push(0, Vec2::new(0.2, -0.1), 12.0);
        let momentum = |parts: &Parts| {
            let (m, body) = (parts.bodies[0].motion, parts.bodies[0]);
            let spin = body.inertia_kgm2() * m.spin_radps;
            (m.velocity_mps * body.mass_kg, cross(m.part_in_table.position_m, m.velocity_mps) * body.mass_kg + spin)
        };
        let (p0, l0) = momentum(&parts);
        let (mut force, mut torque) = (Vec2::zeros(), 0.0);
        for _ in 0..400 {
            let wrench = parts.step(&PlateMotion::default());
            force += wrench.xy() * STEP_S;
            torque += wrench.z * STEP_S;
        }
        let (p1, l1) = momentum(&parts);
        assert!((p0 - p1 - force).norm() < 1e-12 && (l0 - l1 - torque).abs() < 1e-12);
        assert!(force.norm() > 1e-5);
    }

    #[test]
    fn a_part_sticks_to_a_plate_it_can_follow_and_slips_off_a_faster_one() {
        let ride = |acceleration: f64| {
            let mut parts = one(PENNY, Vec2::zeros(), 0.0);
            let mut speed = 0.0;
            for _ in 0..1000 {
                speed += acceleration * STEP_S;
                parts.step(&PlateMotion { twist: Twist::new(speed, 0.0, 0.0), ..Default::default() });
            }
            parts.bodies[0].motion.velocity_mps.x / speed
        };
        assert_eq!(ride(0.999 * DECELERATION), 1.0);
        assert!((ride(2.0 * DECELERATION) - 0.5).abs() < 1e-9);
    }

    #[test]
    fn fallen_part_stays_beside_the_plate() {
        let mut parts = one(PENNY, Vec2::new(3.0, 0.5), 2.0);
        parts.half_side_m = 0.1;
        for _ in 0..2000 {
            parts.step(&PlateMotion::default());
        }
        let fallen = parts.bodies[0].motion;
        assert!(!fallen.on_plate && fallen.velocity_mps == Vec2::zeros());
        assert!(fallen.part_in_table.position_m.x > 0.1 + PENNY.radius_m);
        let shaken = PlateMotion { twist: Twist::new(1.0, 1.0, 1.0), ..Default::default() };
        assert_eq!(parts.step(&shaken), Wrench::default() * -1.0);
        assert_eq!(parts.bodies[0].motion, fallen);
    }
}
