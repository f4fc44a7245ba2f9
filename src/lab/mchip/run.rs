//! Simulation of one run: the part on the array, step by step.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use super::contact::{Contact, Outline};
use super::device::{COLUMNS, Device, LENGTH_M, PITCH_M, ROWS, axis_m};
use super::drive::ResonatorDrive;
use super::impact::Collision;
use super::part::{MChipPart, PartShape};
use super::resonator::{ExactStep, Rotor, Swing};
use upm_core::units::GRAVITY_MPS2;

/// Change of a contact point's height with the resonator's angle, m/rad, above which the resonator is turned back to
/// remove an overlap.
const LEAST_RISE_M: f64 = 3e-5;
/// Drive cycles before the part is dropped: the free oscillation has settled by then.
const WARM_UP_CYCLES: f64 = 20.0;

/// Device, drive, part and steps of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setup {
    pub device: Device,
    pub drive: ResonatorDrive,
    pub part: PartShape,
    pub step_s: f64,
    /// Time between samples, s.
    pub sample_s: f64,
}

impl Setup {
    /// The paper's device, part and step, with `drive`.
    pub fn published(drive: ResonatorDrive) -> Self {
        Self { device: Device::published(), drive, part: PartShape::published(), step_s: 1e-6, sample_s: 20e-6 }
    }
}

/// Initial position of a dropped part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    /// Middle of the part along x and y, m.
    pub middle_m: [f64; 2],
    /// Turn about the vertical, rad.
    pub yaw_rad: f64,
    /// Height above the highest reach of the ridges, m.
    pub drop_m: f64,
}

impl Start {
    /// Middle of the part along x, m: its front has just passed the rims of the fifth row, and so it covers four.
    const MIDDLE_M: f64 = 0.617e-3;

    /// A part just above the rims, aligned with the array.
    pub fn aligned() -> Self {
        Self { middle_m: [Self::MIDDLE_M, 0.0], yaw_rad: 0.0, drop_m: 1e-6 }
    }

    /// As [`Start::aligned`], displaced by up to 15 µm along x, 5 µm along y and 5 mrad; `draw` gives uniform numbers
    /// in 0..1.
    pub fn scattered(mut draw: impl FnMut() -> f64) -> Self {
        let mut about = |reach: f64| reach * (2.0 * draw() - 1.0);
        let aligned = Self::aligned();
        Self {
            middle_m: [aligned.middle_m[0] + about(15e-6), about(5e-6)],
            yaw_rad: about(5e-3),
            drop_m: aligned.drop_m + about(0.5e-6),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Impact {
    pub at_s: f64,
    /// Number of the resonator, row by row.
    pub resonator: usize,
    /// False for a resonator of a row that is strobed off.
    pub driven: bool,
    /// Angle and angular speed of the resonator just before the impact.
    pub swing: Swing,
    pub impulse_ns: Vector3<f64>,
}

/// State of the part at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    pub at_s: f64,
    pub state: MChipPart,
}

#[derive(Clone, Debug)]
pub struct Run {
    pub setup: Setup,
    rotor: Rotor,
    torque_nm: f64,
    exact: ExactStep,
    outline: Outline,
    /// Middles of the resonators' axes, m.
    axes_m: Vec<Vector3<f64>>,
    /// Resonators, row by row.
    pub swings: Vec<Swing>,
    pub state: MChipPart,
    steps: u64,
    /// External force on the part's centre, N.
    pub force_n: Vector3<f64>,
    pub impacts: Vec<Impact>,
    pub samples: Vec<Sample>,
}

impl Run {
    /// A run whose part is dropped at `start`. The array already oscillates: a part at rest on it when the torque is
    /// switched on would be thrown up.
    pub fn new(setup: Setup, start: &Start) -> Self {
        let device = &setup.device;
        let [x, y] = start.middle_m;
        let bottom_m = Vector3::new(x, y, device.rest_height_m() + device.reach_m() + start.drop_m);
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), start.yaw_rad);
        let axes_m: Vec<Vector3<f64>> = (0..ROWS * COLUMNS).map(|i| axis_m(i / COLUMNS, i % COLUMNS)).collect();
        let rotor = device.rotor();
        let mut run = Self {
            rotor,
            torque_nm: device.torque_nm(),
            exact: rotor.exact_step(setup.step_s),
            outline: Outline::of(device),
            swings: vec![Swing::default(); axes_m.len()],
            axes_m,
            state: MChipPart::resting(&setup.part, bottom_m, turn),
            steps: 0,
            force_n: Vector3::zeros(),
            impacts: Vec::new(),
            samples: Vec::new(),
            setup,
        };
        let cycle_s = 1.0 / run.setup.device.drive_hz;
        let steps = (WARM_UP_CYCLES * cycle_s / run.setup.step_s).round() as i64;
        for step in -steps..0 {
            run.swing_on(step as f64);
        }
        run
    }

    /// Advances every resonator by one step, without contact; `step` counts from the start of the run.
    fn swing_on(&mut self, step: f64) {
        let Setup { device, drive, step_s, .. } = &self.setup;
        // the middle of the step, so that no switching time falls on a boundary
        let cycles = (step + 0.5) * step_s * device.drive_hz;
        for (row, swings) in self.swings.chunks_mut(COLUMNS).enumerate() {
            let torque_nm = if drive.pushes(row, cycles) { self.torque_nm } else { 0.0 };
            for swing in swings {
                *swing = self.exact.after(swing, torque_nm);
            }
        }
    }

    /// Height of the part's bottom above its rest position, m.
    pub fn height_m(&self, state: &MChipPart) -> f64 {
        state.center_m.z - self.setup.part.half_m.z - self.setup.device.rest_height_m()
    }

    /// Advances until `until_s`, or until the part leaves the array; false in that case.
    pub fn advance(&mut self, until_s: f64) -> bool {
        let sampling = (self.setup.sample_s / self.setup.step_s).round().max(1.0) as u64;
        let end = (until_s / self.setup.step_s).round() as u64;
        let mut found = Vec::new();
        while self.steps < end && self.is_on_array() {
            self.swing_on(self.steps as f64);
            let Setup { part, step_s, .. } = &self.setup;
            let accel_mps2 = self.force_n / part.mass_kg - Vector3::z() * GRAVITY_MPS2;
            self.state.step(&accel_mps2, *step_s);
            self.steps += 1;
            self.collide(&mut found);
            if self.steps.is_multiple_of(sampling) {
                let at_s = self.steps as f64 * self.setup.step_s;
                self.samples.push(Sample { at_s, state: self.state });
            }
        }
        self.steps >= end
    }

    /// False once the part's front is past the last row or its back before the first, or it has fallen off a side.
    pub fn is_on_array(&self) -> bool {
        let (center_m, half_m) = (self.state.center_m, self.setup.part.half_m);
        center_m.x - half_m.x > -PITCH_M[0]
            && center_m.x + half_m.x < LENGTH_M
            && self.height_m(&self.state) > -half_m.z
    }

    /// Resolves the contacts at the present time one after the other, in reverse order in every second step.
    fn collide(&mut self, found: &mut Vec<Contact>) {
        let pose = self.state.pose();
        let inverse_inertia = self.setup.part.inverse_inertia(&self.state.turn.to_rotation_matrix().into_inner());
        let count = self.axes_m.len();
        for nth in 0..count {
            let index = if self.steps.is_multiple_of(2) { nth } else { count - 1 - nth };
            found.clear();
            let (axis_m, angle_rad) = (self.axes_m[index], self.swings[index].angle_rad);
            self.outline.contacts(axis_m, angle_rad, &self.setup.part, &pose, found);
            for contact in found.iter() {
                self.meet(index, contact, &inverse_inertia);
            }
        }
    }

    fn meet(&mut self, index: usize, contact: &Contact, inverse_inertia: &Matrix3<f64>) {
        let swing = self.swings[index];
        let arm_m = contact.point_m - self.state.center_m;
        let from_axis = contact.point_m - self.axes_m[index];
        // velocity of the resonator's point at one radian per second
        let lever_m = Vector3::new(from_axis.z, 0.0, -from_axis.x);
        let velocity_mps = self.state.point_velocity_mps(&arm_m) - lever_m * swing.speed_radps;
        if velocity_mps.dot(&contact.normal) >= 0.0 {
            return;
        }
        let across = arm_m.cross_matrix();
        let inverse_mass = Matrix3::identity() / self.setup.part.mass_kg - across * inverse_inertia * across
            + lever_m * lever_m.transpose() / self.rotor.inertia_kgm2;
        let Device { friction, restitution, .. } = self.setup.device;
        let collision = Collision { inverse_mass, velocity_mps, normal: contact.normal };
        let impulse_ns = collision.impulse(friction, restitution);
        self.state.velocity_mps += impulse_ns / self.setup.part.mass_kg;
        self.state.spin_radps += inverse_inertia * arm_m.cross(&impulse_ns);
        self.swings[index].speed_radps -= lever_m.dot(&impulse_ns) / self.rotor.inertia_kgm2;
        // the light resonator is turned back by the overlap: a lasting contact would otherwise creep into the part
        let rise_m = lever_m.dot(&contact.normal);
        if rise_m > LEAST_RISE_M {
            self.swings[index].angle_rad -= contact.depth_m / rise_m;
        }
        let (Setup { device, drive, .. }, at_s) = (&self.setup, self.steps as f64 * self.setup.step_s);
        let driven = !drive.is_off(index / COLUMNS, at_s * device.drive_hz);
        self.impacts.push(Impact { at_s, resonator: index, driven, swing, impulse_ns });
    }
}

#[cfg(test)]
mod tests {
    use super::super::measures::{FeedMeasure, samples_from};
    use super::*;

    impl Run {
        /// Kinetic and potential energy of part and resonators, J.
        fn energy_j(&self) -> f64 {
            let part = self.setup.part.kinetic_j(&self.state).iter().sum::<f64>();
            let weight = self.setup.part.mass_kg * GRAVITY_MPS2 * self.height_m(&self.state);
            part + weight + self.swings.iter().map(|swing| self.rotor.energy_j(swing)).sum::<f64>()
        }
    }

    fn resting(device: Device) -> Run {
        let setup = Setup { device: Device { peak_rad: 0.0, ..device }, ..Setup::published(ResonatorDrive::plain()) };
        Run::new(setup, &Start { drop_m: 0.0, ..Start::aligned() })
    }

    #[test]
    fn part_at_rest_on_an_array_at_rest_stays() {
        let mut run = resting(Device::published());
        let start = run.state;
        assert!(run.advance(0.02));
        let moved_m = run.state.center_m - start.center_m;
        // it sinks only by the compliance of the springs
        assert!(moved_m.xy().norm() < 0.12e-6 && (-0.5e-6..0.0).contains(&moved_m.z), "{moved_m}");
        assert!(run.state.velocity_mps.norm() < 1e-4 && run.state.turn.angle() < 1e-3);
    }

    #[test]
    fn dropped_part_gains_no_energy_and_comes_to_rest() {
        let mut run = resting(Device::published());
        run.state.center_m.z += 5e-6;
        let mut most_j = run.energy_j();
        for i in 1..=100 {
            run.advance(f64::from(i) * 5e-4);
            let energy_j = run.energy_j();
            assert!(energy_j <= most_j + 1e-3 * 2.7e-12, "after {} steps: {energy_j} after {most_j}", run.steps);
            most_j = energy_j;
        }
        let kinetic_j = run.setup.part.kinetic_j(&run.state).iter().sum::<f64>();
        assert!(kinetic_j < 1e-15, "{kinetic_j}");
    }

    #[test]
    fn frictionless_impact_keeps_momentum() {
        let mut run = resting(Device { friction: 0.0, ..Device::published() });
        let (index, at) = (2 * COLUMNS + 2, axis_m(2, 2));
        run.swings[index].speed_radps = 500.0;
        let before = (run.state, run.swings[index]);
        let point_m = at + Vector3::new(-139e-6, 10e-6, 7.5e-6);
        let inverse_inertia = run.setup.part.inverse_inertia(&Matrix3::identity());
        run.meet(index, &Contact { point_m, normal: Vector3::z(), depth_m: 0.0 }, &inverse_inertia);
        let gain = (run.state.velocity_mps - before.0.velocity_mps) * run.setup.part.mass_kg;
        let turned = run.rotor.inertia_kgm2 * (run.swings[index].speed_radps - before.1.speed_radps);
        assert!(gain.z > 0.0 && gain.x.abs() < 1e-20 && gain.y.abs() < 1e-20);
        // about the resonator's axis
        assert!((139e-6 * gain.z + turned).abs() < 1e-9 * turned.abs());
        // about the part's centre
        let spin = run.setup.part.inertia_kgm2().component_mul(&(run.state.spin_radps - before.0.spin_radps));
        assert!((spin - (point_m - run.state.center_m).cross(&gain)).norm() < 1e-9 * spin.norm());
        // separation over approach
        let rim_mps = 139e-6 * run.swings[index].speed_radps;
        let part_mps = run.state.point_velocity_mps(&(point_m - run.state.center_m)).z;
        assert!(((part_mps - rim_mps) / (139e-6 * 500.0) - 0.5).abs() < 1e-6);
    }

    #[test]
    fn part_jams_at_a_new_row_and_strobing_frees_it() {
        // the longest stall within a second, or the first one longer than `enough_s`
        let stall_s = |drive: ResonatorDrive, enough_s: f64| {
            let mut run = Run::new(Setup::published(drive), &Start::aligned());
            let mut longest_s = 0.0;
            for tenth in (1..=10).map(f64::from) {
                if longest_s <= enough_s {
                    run.advance(0.1 * tenth);
                    longest_s = FeedMeasure::of(samples_from(&run, 0.05)).longest_stall_s;
                }
            }
            longest_s
        };
        assert!(stall_s(ResonatorDrive::plain(), 0.1) > 0.1);
        assert!(stall_s(ResonatorDrive::strobed(), f64::INFINITY) < 0.05);
    }
}
