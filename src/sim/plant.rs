//! Everything that moves, stepped together: motors, plate, parts, accelerometers. The camera is separate.

use multiversion::multiversion;

use super::accelerometers::Accelerometers;
use super::faults::PlantFaults;
use super::interlock_port::InterlockPort;
use super::motors::Motors;
use super::parts::{PartMotion, Parts};
use super::plate::{PlateMotion, ShakenPlate, Wrench};
use super::{PartParams, SimParams, Snapshot};
use upm_core::geometry::Pose;
use upm_core::random::Streams;
use upm_core::signal::{AccelTrace, Drive, MOTORS};
use upm_core::time::PlateTime;

/// Thresholds below which everything counts as at rest: a tenth of a micrometre, ten micrometres per second.
const STILL_M: f64 = 1e-7;
const STILL_MPS: f64 = 1e-5;

/// The moving half of the simulated rig. Time advances in whole steps of whole nanoseconds.
///
/// The parts' friction acts on the plate one step late: accurate enough, since friction never exceeds μ m g.
#[derive(Clone, Debug)]
pub struct Plant {
    step_ns: u64,
    step_s: f64,
    half_side_m: f64,
    now_ns: u64,
    pub(crate) motors: Motors,
    pub(crate) plate: ShakenPlate,
    pub(crate) parts: Parts,
    accelerometers: Accelerometers,
    motion: PlateMotion,
    reaction: Wrench,
    pulse_steps: u64,
    /// True when nothing moves or will move without a new command.
    pub(crate) still: bool,
}

impl Plant {
    /// A plant at rest, with `parts` on the plate.
    pub fn new(params: &SimParams, parts: &[(PartParams, Pose)], streams: &Streams) -> Self {
        let step_ns = PlateTime::from_secs(params.step_s).nanos().max(1);
        let step_s = step_ns as f64 * 1e-9;
        Self {
            step_ns,
            step_s,
            half_side_m: 0.5 * params.plate.side_m,
            now_ns: 0,
            motors: Motors::new(&params.motors, step_s),
            plate: ShakenPlate::new(&params.plate, step_s),
            parts: Parts::new(parts, &params.contact, params.plate.side_m, step_s),
            accelerometers: Accelerometers::new(&params.accelerometers, streams),
            motion: PlateMotion::default(),
            reaction: Wrench::default(),
            pulse_steps: 0,
            still: true,
        }
    }

    /// Time up to which the plant has been stepped.
    pub fn now(&self) -> PlateTime {
        PlateTime::from_nanos(self.now_ns)
    }

    /// Starts `drive` now, replacing any other.
    pub fn play(&mut self, drive: Drive) {
        self.accelerometers.start(drive.envelope.driven_s());
        self.motors.start(drive);
        self.pulse_steps = 0;
        self.still = false;
    }

    /// Plays `samples` of the motors now, which last `driven_s`.
    pub fn play_samples(&mut self, samples: Vec<[i16; MOTORS]>, driven_s: f64) {
        self.accelerometers.start(driven_s);
        self.motors.start_samples(samples);
        (self.pulse_steps, self.still) = (0, false);
    }

    /// Lets `drive` take over from the playing one; returns the time until then, s. `None` where it is too late.
    pub fn take_over(&mut self, drive: Drive) -> Option<f64> {
        self.motors.take_over(drive)
    }

    /// Sets all motors to zero now.
    pub fn stop(&mut self) {
        self.motors.stop();
        self.accelerometers.stop();
    }

    /// Advances to the end of the first step that is not before `time`; skips time at rest. `port` is asked before
    /// every step whether to cut the motors in it, and notified when they are silent.
    pub(super) fn advance_to(&mut self, time: PlateTime, port: &mut InterlockPort) {
        while self.now_ns < time.nanos() {
            let cut = port.should_cut(self.now());
            if cut {
                self.stop();
            }
            if port.driving && (cut || self.motors.is_idle()) {
                port.motors_off(self.now());
            }
            if self.still {
                self.now_ns = time.nanos().div_ceil(self.step_ns) * self.step_ns;
            } else {
                self.step();
            }
        }
    }

    /// Advances one step.
    pub fn step(&mut self) {
        step(self);
    }

    /// The coils' present force and torque on the plate.
    pub fn wrench(&self) -> Wrench {
        self.motors.wrench()
    }

    /// The plate's present motion.
    pub fn plate(&self) -> &PlateMotion {
        &self.motion
    }

    /// The parts' present state.
    pub fn parts(&self) -> &Parts {
        &self.parts
    }

    /// Replaces all present faults by `faults`.
    pub(crate) fn set_faults(&mut self, faults: &PlantFaults) {
        self.motors.set_faults(&faults.coils);
        self.plate.detune(if faults.resonance > 0.0 { faults.resonance } else { 1.0 });
        self.parts.set_faults(faults);
        self.still = false;
    }

    /// Trace of the accelerometers over the last pulse, up to now.
    pub fn trace(&self) -> &AccelTrace {
        self.accelerometers.trace()
    }

    /// Poses at `time`, which must be within the last step.
    pub(crate) fn snapshot_at(&self, time: PlateTime, snapshot: &mut Snapshot) {
        let before_s = self.now().secs_since(time).min(self.step_s);
        snapshot.plate_in_table = self.motion.pose_before(before_s);
        snapshot.parts_in_table.clear();
        let pose = |part: &PartMotion| part.on_plate.then(|| part.pose_before(before_s));
        snapshot.parts_in_table.extend(self.parts.motions().map(pose));
    }

    fn barely_moves(&self) -> bool {
        let (pose, twist) = (&self.motion.plate_in_table, &self.motion.twist);
        pose.position_m.amax() < STILL_M
            && pose.heading_rad.abs() * self.half_side_m < STILL_M
            && twist.velocity_mps.amax() < STILL_MPS
            && twist.spin_radps.abs() * self.half_side_m < STILL_MPS
            && self.parts.fastest_mps() < STILL_MPS
            && self.parts.are_held()
    }

    fn settle(&mut self) {
        self.motors.stop();
        self.plate.settle();
        self.parts.settle();
        self.motion = PlateMotion::default();
        self.reaction = Wrench::default();
        self.still = true;
    }
}

/// [`Plant::step`].
#[multiversion(targets("x86_64+avx2"))]
fn step(plant: &mut Plant) {
    plant.plate.step(plant.motors.step() + plant.reaction);
    if let Some((from_s, envelope)) = plant.motors.taken_over() {
        plant.accelerometers.take_over(from_s, &envelope);
    }
    let before = std::mem::replace(&mut plant.motion, plant.plate.motion());
    plant.reaction = plant.parts.step(&before.midway(&plant.motion));
    let from_s = plant.pulse_steps as f64 * plant.step_s;
    plant.accelerometers.observe(from_s, &before, from_s + plant.step_s, &plant.motion);
    plant.pulse_steps += 1;
    plant.now_ns += plant.step_ns;
    if plant.motors.is_forceless() && plant.barely_moves() {
        plant.settle();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pump_tests::rig_params;
    use upm_core::geometry::Vec2;
    use upm_core::signal::{Envelope, Harmonic};

    fn plant(params: &SimParams) -> Plant {
        let penny = PartParams::PENNY;
        Plant::new(params, &[(penny, Pose { position_m: Vec2::new(0.05, 0.02), heading_rad: 0.0 })], &Streams::new(1))
    }

    /// A drive on all axes, 0.12 s long.
    fn drive() -> Drive {
        let wave = |counts: f64| vec![Harmonic { cos: 0.0, sin: -counts }, Harmonic { cos: 0.0, sin: counts }];
        Drive {
            base_radps: 377.0,
            motors: [wave(300.0), wave(-100.0), wave(250.0), wave(50.0)],
            shaping: Default::default(),
            envelope: Envelope { attack_s: 0.01, sustain_s: 0.1, rest_s: 0.0 },
        }
    }

    #[test]
    fn still_time_is_skipped_to_whole_steps() {
        let mut plant = plant(&rig_params());
        let port = &mut InterlockPort::default();
        plant.advance_to(PlateTime::from_nanos(7_200_000_000_010_001), port);
        assert_eq!(plant.now().nanos(), 7_200_000_000_050_000);
        plant.play(drive());
        assert!(!plant.still);
        plant.advance_to(plant.now() + 60.0, port);
        assert!(plant.still);
    }

    #[test]
    fn tilted_plate_moves_the_parts_that_friction_does_not_hold() {
        let after_half_a_second = |friction: f64| {
            let mut plant = plant(&rig_params());
            let parts = plant.parts().len();
            let pull_mps2 = Vec2::new(0.171, 0.0);
            plant.set_faults(&PlantFaults { pull_mps2, friction: vec![friction; parts], ..PlantFaults::default() });
            let x_m = |plant: &Plant| plant.parts().motions().next().unwrap().part_in_table.position_m.x;
            let before_m = x_m(&plant);
            plant.advance_to(PlateTime::from_secs(0.5), &mut InterlockPort::default());
            (x_m(&plant) - before_m, plant.still)
        };
        let (moved_m, still) = after_half_a_second(1e-3);
        assert!((moved_m - 0.021).abs() < 1e-3 && !still, "{moved_m}");
        assert_eq!(after_half_a_second(1.0), (0.0, true));
    }

    #[test]
    fn snapshots_within_a_step_are_on_the_path() {
        let mut plant = plant(&rig_params());
        plant.play(drive());
        let (mut snapshot, mut reached) = (Snapshot::default(), 0.0f64);
        for _ in 0..2000 {
            let (plate, part) = (plant.plate().plate_in_table, plant.parts().motions().next().unwrap().part_in_table);
            let time = plant.now();
            plant.step();
            plant.snapshot_at(time, &mut snapshot);
            assert!((snapshot.parts_in_table[0].unwrap_or_default().position_m - part.position_m).norm() < 1e-12);
            assert!((snapshot.plate_in_table.position_m - plate.position_m).norm() < 2e-8);
            assert!((snapshot.plate_in_table.heading_rad - plate.heading_rad).abs() < 1e-6);
            reached = reached.max(plate.position_m.norm());
        }
        assert!(reached > 1e-4);
    }
}
