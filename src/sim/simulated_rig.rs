//! The simulated rig behind the hardware boundary: the plant under a camera, its truth visible only through a probe.

mod exposure;
mod faults;

use self::exposure::{EXPOSURE_SNAPSHOTS, Exposure, MIDDLE};
use super::interlock_port::InterlockPort;
use super::{Camera, DiscShape, PartParams, Plant, SimParams, Snapshot};
use upm_core::geometry::Pose;
use upm_core::ground_truth::{GroundTruthHandle, PartTruth};
use upm_core::random::{Rng, Streams};
use upm_core::rig::{Interlock, Rig, RigFault, RigModel};
use upm_core::signal::{AccelTrace, Drive, Frame};
use upm_core::time::PlateTime;

/// Longest pulse, its rest included, s.
const LONGEST_PULSE_S: f64 = 600.0;

/// A [`Rig`] made of equations. Time advances only in [`Rig::capture`] and [`Rig::pass`], and stops on whole simulation
/// steps. After its interlock has tripped it takes no more frames and plays no more pulses.
#[derive(Debug)]
pub struct SimRig {
    model: RigModel,
    plant: Plant,
    camera: Camera,
    probe: GroundTruthHandle,
    /// Noise of positions in place of pictures; `None` where the camera takes pictures.
    position_noise: Option<Rng>,
    exposure: [Snapshot; EXPOSURE_SNAPSHOTS],
    /// Factor on the exposure time, 1 without a fault.
    exposure_factor: f64,
    last_frame: u64,
    settled_at: PlateTime,
    rest_s: f64,
    port: InterlockPort,
}

impl SimRig {
    /// A rig at rest with `parts` on its plate. Control sees `model`; the simulation uses `params`.
    pub fn new(model: RigModel, params: SimParams, parts: Vec<(PartParams, Pose)>, streams: Streams) -> Self {
        let discs = parts
            .iter()
            .map(|(part, _)| DiscShape { radius_m: part.radius_m, thickness_m: part.thickness_m })
            .collect();
        let rig = Self {
            model,
            plant: Plant::new(&params, &parts, &streams),
            camera: Camera::new(params.camera, params.plate.side_m, discs, streams.stream("camera")),
            probe: GroundTruthHandle::default(),
            position_noise: None,
            exposure: Default::default(),
            exposure_factor: 1.0,
            last_frame: 0,
            settled_at: PlateTime::ZERO,
            rest_s: 0.0,
            port: InterlockPort::default(),
        };
        rig.publish(PlateTime::ZERO, 0.0);
        rig
    }

    /// Delivers measured positions in place of pictures, at the same times; `streams` has their noise.
    pub fn without_pixels(self, streams: &Streams) -> Self {
        Self { position_noise: Some(streams.stream("positions")), ..self }
    }

    /// Puts the motors under `interlock` for the lifetime of this rig; see [`Interlock`] for its ownership.
    ///
    /// # Errors
    /// [`RigFault::Device`] when `interlock` is already attached to a rig.
    pub fn attach(&mut self, interlock: Interlock) -> Result<(), RigFault> {
        self.port.attach(&interlock, self.now())
    }

    /// The true camera, for publishing ground truth.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// A handle on the ground truth at the middle of the last exposure.
    pub fn probe(&self) -> GroundTruthHandle {
        self.probe.clone()
    }

    /// Sets the motors to zero and returns `Err` once the interlock has tripped.
    fn stop_if_tripped(&mut self) -> Result<(), RigFault> {
        let checked = self.port.check();
        if checked.is_err() {
            self.stop();
        }
        checked
    }

    fn advance_to(&mut self, time: PlateTime) {
        self.plant.advance_to(time, &mut self.port);
    }

    /// Publishes the state `before_s` ago, at most one step, as the truth at `at`.
    fn publish(&self, at: PlateTime, before_s: f64) {
        self.probe.update(|truth| {
            truth.at = at;
            truth.parts.clear();
            truth.parts.extend(self.plant.parts().motions().map(|part| PartTruth {
                part_in_table: part.pose_before(before_s),
                velocity_mps: part.velocity_mps,
                on_plate: part.on_plate,
            }));
            truth.plate_in_table = self.plant.plate().pose_before(before_s);
            truth.collisions = self.plant.parts().collisions();
        });
    }

    fn check(&self, drive: &Drive) -> Result<(), RigFault> {
        let bad = |what: &str| Err(RigFault::BadDrive(what.to_owned()));
        let envelope = &drive.envelope;
        if !(drive.base_radps.is_finite() && drive.base_radps > 0.0) {
            return bad("the base frequency is not a positive number");
        }
        if drive.motors.iter().flatten().any(|h| !(h.cos.is_finite() && h.sin.is_finite())) {
            return bad("an amplitude is not a number");
        }
        if [envelope.attack_s, envelope.sustain_s, envelope.rest_s].iter().any(|s| !(s.is_finite() && *s >= 0.0)) {
            return bad("attack, sustain or rest is negative or not a number");
        }
        if envelope.sustain_s > self.model.max_sustain_s * (1.0 + 1e-9) {
            return bad("the sustain is longer than the rig allows");
        }
        if envelope.total_s() > LONGEST_PULSE_S {
            return bad("the pulse is longer than ten minutes");
        }
        if self.now() < self.settled_at {
            return Err(RigFault::Busy(self.settled_at));
        }
        let (peak_counts, limit_counts) = (drive.peak_counts(), self.model.count_limit);
        if peak_counts > limit_counts {
            return Err(RigFault::DriveTooStrong { peak_counts, limit_counts });
        }
        Ok(())
    }
}

impl Rig for SimRig {
    fn now(&self) -> PlateTime {
        self.plant.now()
    }

    fn play(&mut self, drive: &Drive) -> Result<(), RigFault> {
        self.stop_if_tripped()?;
        self.check(drive)?;
        self.port.energize()?;
        self.settled_at = self.now() + drive.envelope.total_s();
        self.rest_s = drive.envelope.rest_s;
        self.plant.play(drive.clone());
        Ok(())
    }

    fn settled_at(&self) -> PlateTime {
        self.settled_at
    }

    fn capture(&mut self, frame: &mut Frame) -> Result<(), RigFault> {
        self.stop_if_tripped()?;
        let exposure = Exposure::next(self.camera.params(), self.exposure_factor, self.now(), self.last_frame);
        self.advance_to(exposure.opens);
        let taken = if self.plant.is_still() {
            self.advance_to(exposure.middle);
            self.plant.snapshot_at(exposure.middle, &mut self.exposure[0]);
            self.publish(exposure.middle, 0.0);
            1
        } else {
            for i in 0..EXPOSURE_SNAPSHOTS {
                let instant = exposure.instant(i);
                self.advance_to(instant);
                self.plant.snapshot_at(instant, &mut self.exposure[i]);
                if i == MIDDLE {
                    self.publish(exposure.middle, self.now().secs_since(exposure.middle));
                }
            }
            EXPOSURE_SNAPSHOTS
        };
        self.stop_if_tripped()?;
        let exposed = &self.exposure[..taken];
        match &mut self.position_noise {
            Some(noise) => {
                frame.pixels.clear();
                frame.positions = Some(self.camera.positions(exposed, noise));
            }
            None => self.camera.render(exposed, frame),
        }
        (frame.index, frame.exposed_at) = (exposure.index, exposure.middle);
        self.last_frame = exposure.index;
        self.advance_to(exposure.closes());
        self.stop_if_tripped()
    }

    fn trace(&self) -> AccelTrace {
        self.plant.trace().clone()
    }

    fn stop(&mut self) {
        self.plant.stop();
        self.port.motors_off(self.now());
        self.settled_at = self.settled_at.min(self.now() + self.rest_s);
    }

    fn pass(&mut self, until: PlateTime) -> Result<(), RigFault> {
        let lease_ends = self.now() + Interlock::LEASE_S;
        if !self.port.is_driving() || until <= lease_ends {
            self.advance_to(until);
            return self.stop_if_tripped();
        }
        self.advance_to(lease_ends);
        let trip = self.port.lease_expired(self.now());
        self.stop();
        self.advance_to(until);
        Err(RigFault::Stopped(trip))
    }
}

#[cfg(test)]
mod stop_tests;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pump_tests::rig_params;
    use std::f64::consts::TAU;
    use upm_core::geometry::{Lens, Vec2};
    use upm_core::signal::{Envelope, Harmonic};

    const ENVELOPE: Envelope = Envelope { attack_s: 0.01, sustain_s: 0.06, rest_s: 0.05 };

    fn model(params: &SimParams) -> RigModel {
        RigModel {
            name: "test".to_owned(),
            plate_side_m: params.plate.side_m,
            lever_arm_m: params.motors.lever_arm_m,
            motor_arrangement: params.motors.arrangement,
            plate_mass_kg: params.plate.mass_kg,
            plate_inertia_kgm2: params.plate.inertia_kgm2,
            newtons_per_count: params.motors.newtons_per_count,
            count_limit: params.motors.count_limit,
            base_radps: TAU * 60.0,
            attack_s: 0.01,
            rest_s: 0.05,
            max_sustain_s: 0.2,
            fields: None,
            accelerometer_in_plate_m: params.accelerometers.position_m,
            frame_size_px: params.camera.size_px,
            frame_hz: params.camera.frame_hz,
            exposure_s: params.camera.exposure_s,
            lens: Lens::ideal(1000.0, Vec2::new(320.0, 240.0)),
            dark_parts: true,
        }
    }

    pub(super) fn rig(seed: u64) -> SimRig {
        let penny = PartParams::PENNY;
        let at = |x, y| Pose { position_m: Vec2::new(x, y), heading_rad: 0.0 };
        let params = rig_params();
        SimRig::new(model(&params), params, vec![(penny, at(0.05, 0.02)), (penny, at(-0.04, 0.0))], Streams::new(seed))
    }

    /// A drive of spin about the plate's centre, both harmonics.
    pub(super) fn drive(counts: f64) -> Drive {
        let wave = |sign: f64| {
            let first = Harmonic { cos: 0.0, sin: -sign * counts };
            vec![first, Harmonic { cos: 0.0, sin: sign * counts }]
        };
        let motors = [wave(-1.0), wave(-1.0), wave(1.0), wave(1.0)];
        Drive { base_radps: TAU * 60.0, motors, envelope: ENVELOPE, ..Drive::default() }
    }

    fn capture(rig: &mut SimRig) -> Frame {
        let mut frame = Frame::new(1, 1);
        rig.capture(&mut frame).unwrap();
        frame
    }

    #[test]
    fn frames_come_at_their_rate_and_time_passes_only_there() {
        let mut rig = rig(1);
        assert_eq!(rig.now(), PlateTime::ZERO);
        let params = rig.camera.params().to_owned();
        for index in 1..200u64 {
            if index == 20 {
                rig.play(&drive(200.0)).unwrap();
            }
            let frame = capture(&mut rig);
            assert_eq!(frame.index, index);
            assert_eq!(frame.exposed_at, PlateTime::from_secs(index as f64 / params.frame_hz));
            assert_eq!(rig.probe().read().at, frame.exposed_at);
            let late = rig.now() - frame.exposed_at - 0.5 * params.exposure_s;
            assert!((-1e-9..5.1e-5).contains(&late), "{late}");
        }
    }

    #[test]
    fn positions_have_the_times_and_places_of_pictures() {
        let (mut pictured, mut measured) = (rig(1), rig(1).without_pixels(&Streams::new(1)));
        for index in 1..60 {
            if index == 5 {
                pictured.play(&drive(300.0)).unwrap();
                measured.play(&drive(300.0)).unwrap();
            }
            let (frame, other) = (capture(&mut pictured), capture(&mut measured));
            assert_eq!((frame.index, frame.exposed_at), (other.index, other.exposed_at));
            assert_eq!(pictured.probe().read(), measured.probe().read());
            let positions = other.positions.unwrap();
            assert!(other.pixels.is_empty() && frame.positions.is_none() && positions.corners_px.is_some());
            for (disc, part) in positions.discs.iter().zip(&measured.probe().read().parts) {
                let height_m = PartParams::PENNY.thickness_m;
                let true_px = measured.camera().image_from_table(part.part_in_table.position_m, height_m);
                // a part on the way is measured in the mean of the exposure
                let off_px = (disc.center_px - true_px).norm();
                assert!(off_px < if part.velocity_mps.norm() > 0.0 { 0.5 } else { 5.0 * disc.sd_px }, "{off_px}");
            }
        }
    }

    #[test]
    fn pulse_keeps_the_rig_busy_moves_parts_and_leaves_a_trace() {
        let mut rig = rig(1);
        capture(&mut rig);
        let before = rig.probe().read();
        let start = rig.now();
        rig.play(&drive(300.0)).unwrap();
        assert!((rig.settled_at() - start - ENVELOPE.total_s()).abs() < 1e-9);
        assert_eq!(rig.play(&drive(300.0)), Err(RigFault::Busy(rig.settled_at())));
        assert!(rig.trace().is_empty());
        while rig.now() < rig.settled_at() {
            capture(&mut rig);
        }
        let (after, trace) = (rig.probe().read(), rig.trace());
        assert_eq!(trace.len(), (ENVELOPE.driven_s() * trace.sample_hz) as usize + 1);
        assert!(trace.counts.iter().all(|c| c.iter().any(|&n| n.abs() > 50)));
        for (a, b) in before.parts.iter().zip(&after.parts) {
            let moved = b.part_in_table.position_m - a.part_in_table.position_m;
            assert!(moved.norm() > 2e-4, "{moved}");
            assert!(moved.dot(&upm_core::geometry::perp(a.part_in_table.position_m)) > 0.0, "counter-clockwise");
        }
        rig.play(&drive(300.0)).unwrap();
        assert!(rig.trace().is_empty(), "a new pulse forgets the last trace");
    }

    #[test]
    fn invalid_drives_are_refused() {
        let mut rig = rig(1);
        let with = |change: fn(&mut Drive)| {
            let mut drive = drive(300.0);
            change(&mut drive);
            drive
        };
        assert!(matches!(rig.play(&drive(1e4)), Err(RigFault::DriveTooStrong { .. })));
        for bad in [
            with(|d| d.base_radps = f64::NAN),
            with(|d| d.base_radps = 0.0),
            with(|d| d.motors[2][0].cos = f64::INFINITY),
            with(|d| d.envelope.attack_s = -0.1),
            with(|d| d.envelope.sustain_s = 0.3),
            with(|d| d.envelope.rest_s = 1e9),
        ] {
            assert!(matches!(rig.play(&bad), Err(RigFault::BadDrive(_))), "{bad:?}");
        }
        assert!(rig.plant.is_still());
    }

    #[test]
    fn stop_ends_the_pulse_now() {
        let mut rig = rig(1);
        rig.stop();
        assert_eq!(rig.settled_at(), PlateTime::ZERO);
        rig.play(&drive(300.0)).unwrap();
        capture(&mut rig);
        capture(&mut rig);
        rig.stop();
        let (stopped, length) = (rig.now(), rig.trace().len());
        assert!((rig.settled_at() - stopped - ENVELOPE.rest_s).abs() < 1e-9);
        while rig.now() < rig.settled_at() {
            capture(&mut rig);
        }
        assert_eq!(rig.trace().len(), length);
        let peak = |rig: &SimRig| rig.plant.plate().twist.spin_radps.abs();
        let ringing = peak(&rig);
        (0..240).for_each(|_| drop(capture(&mut rig)));
        assert!(peak(&rig) < 1e-3 * ringing, "no force feeds the plate any more");
        rig.play(&drive(300.0)).unwrap();
    }

    #[test]
    fn equal_seeds_give_equal_runs() {
        let run = |seed| {
            let mut rig = rig(seed);
            for i in 0..40 {
                if i % 12 == 1 {
                    rig.play(&drive(250.0)).unwrap();
                }
                capture(&mut rig);
            }
            (rig.probe().read(), rig.trace())
        };
        assert_eq!(run(5), run(5));
        assert_ne!(run(5).1, run(6).1);
    }
}
