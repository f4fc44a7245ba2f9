//! The simulated rig behind the hardware boundary: the plant under a camera, its truth visible only through a probe.

mod exposure;

use self::exposure::{EXPOSURE_SNAPSHOTS, Exposure, MIDDLE};
use super::faults::{PlantFaults, SeenDisc};
use super::interlock_port::InterlockPort;
use super::{Camera, PartParams, Plant, SimParams, Snapshot};
use upm_core::geometry::{Pose, Vec2};
use upm_core::ground_truth::{GroundTruthHandle, PartTruth};
use upm_core::random::{Rng, Streams};
use upm_core::rig::{Interlock, Rig, RigError, RigModel};
use upm_core::signal::{AccelTrace, Drive, Frame, MOTORS};
use upm_core::time::PlateTime;

/// Longest pulse, its rest included, s.
const LONGEST_PULSE_S: f64 = 600.0;

/// A [`Rig`] made of equations. Time advances only in [`Rig::capture`] and [`Rig::pass`], and stops on whole simulation
/// steps. After its interlock has tripped it takes no more frames and plays no more pulses.
#[derive(Debug)]
pub struct SimRig {
    model: RigModel,
    pub(crate) plant: Plant,
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
        let discs = parts.iter().map(|(part, _)| *part).collect();
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
    /// [`RigError::Device`] when `interlock` is already attached to a rig.
    pub fn attach(&mut self, interlock: Interlock) -> Result<(), RigError> {
        self.port.attach(&interlock, self.now())
    }

    /// True projection of a table point `height_m` above the plate, px, lens distortion included.
    pub fn image_from_table(&self, p_m: Vec2, height_m: f64) -> Vec2 {
        self.camera.image_from_table(p_m, height_m)
    }

    /// Replaces all present faults by `faults`.
    pub(crate) fn set_faults(&mut self, faults: &PlantFaults) {
        self.plant.set_faults(faults);
        self.exposure_factor = if faults.exposure > 0.0 { faults.exposure } else { 1.0 };
    }

    /// Image of a part of the first kind at `place_m`; `None` without parts.
    pub(crate) fn seen_disc(&self, place_m: Vec2) -> Option<SeenDisc> {
        let disc = self.camera.parts.first()?;
        let at = |p_m: Vec2| self.camera.image_from_table(p_m, disc.thickness_m);
        let center_px = at(place_m);
        let radius_px = (at(place_m + Vec2::new(disc.radius_m, 0.0)) - center_px).norm();
        let [_, _, level] = self.camera.params.levels;
        Some(SeenDisc { center_px, radius_px, level })
    }

    /// A handle on the ground truth at the middle of the last exposure.
    pub fn probe(&self) -> GroundTruthHandle {
        self.probe.clone()
    }

    /// The last exposure's first instant as a picture, also where the camera delivers positions. No measured position
    /// depends on it.
    pub fn picture(&mut self) -> Frame {
        let mut frame = Frame::new(0, 0);
        self.camera.render(&self.exposure[..1], &mut frame);
        frame
    }

    /// Plays samples of the motors, whole counts, as a sound card would, with `rest_s` of rest after them: those of
    /// [`Drive::samples`] move the plate exactly as their drive does.
    ///
    /// # Errors
    /// As [`Rig::play`].
    pub fn play_samples(&mut self, samples: Vec<[i16; MOTORS]>, driven_s: f64, rest_s: f64) -> Result<(), RigError> {
        self.stop_if_tripped()?;
        if !(driven_s >= 0.0 && rest_s >= 0.0 && driven_s + rest_s <= LONGEST_PULSE_S) {
            return Err(RigError::BadDrive("samples and rest take 0 s to ten minutes".to_owned()));
        }
        if self.now() < self.settled_at {
            return Err(RigError::Busy(self.settled_at));
        }
        self.check_peak(samples.iter().flatten().map(|counts| f64::from(counts.unsigned_abs())).fold(0.0, f64::max))?;
        self.port.energize()?;
        (self.settled_at, self.rest_s) = (self.now() + driven_s + rest_s, rest_s);
        self.plant.play_samples(samples, driven_s);
        Ok(())
    }

    /// Samples a second of the motors.
    pub fn sample_hz(&self) -> f64 {
        self.plant.motors.sample_hz()
    }

    /// Sets the motors to zero and returns `Err` once the interlock has tripped.
    fn stop_if_tripped(&mut self) -> Result<(), RigError> {
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

    fn check(&self, drive: &Drive) -> Result<(), RigError> {
        let bad = |what: &str| Err(RigError::BadDrive(what.to_owned()));
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
        Ok(())
    }

    /// `Err` for a drive that peaks at `peak_counts`.
    fn check_peak(&self, peak_counts: f64) -> Result<(), RigError> {
        let limit_counts = self.model.count_limit;
        if peak_counts > limit_counts { Err(RigError::DriveTooStrong { peak_counts, limit_counts }) } else { Ok(()) }
    }
}

impl Rig for SimRig {
    fn now(&self) -> PlateTime {
        self.plant.now()
    }

    fn play(&mut self, drive: &Drive) -> Result<(), RigError> {
        self.stop_if_tripped()?;
        self.check(drive)?;
        if self.now() < self.settled_at {
            return Err(RigError::Busy(self.settled_at));
        }
        // the bound holds for every sustain, and these samples for this one
        if drive.peak_counts() > self.model.count_limit {
            self.check_peak(self.plant.motors.peak_of(drive))?;
        }
        self.port.energize()?;
        self.settled_at = self.now() + drive.envelope.total_s();
        self.rest_s = drive.envelope.rest_s;
        self.plant.play(drive.clone());
        Ok(())
    }

    fn takes_over(&self) -> bool {
        true
    }

    fn take_over(&mut self, drive: &Drive) -> Result<PlateTime, RigError> {
        self.stop_if_tripped()?;
        self.check(drive)?;
        self.check_peak(self.plant.motors.peak_of_take_over(drive, self.model.count_limit))?;
        let start = self.now() + self.plant.take_over(drive.clone()).ok_or(RigError::TooLate)?;
        self.settled_at = start + drive.envelope.total_s();
        self.rest_s = drive.envelope.rest_s;
        Ok(start)
    }

    fn settled_at(&self) -> PlateTime {
        self.settled_at
    }

    fn capture(&mut self, frame: &mut Frame) -> Result<(), RigError> {
        self.stop_if_tripped()?;
        let exposure = Exposure::next(&self.camera.params, self.exposure_factor, self.now(), self.last_frame);
        self.advance_to(exposure.opens);
        let taken = if self.plant.still {
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

    fn pass(&mut self, until: PlateTime) -> Result<(), RigError> {
        let lease_ends = self.now() + Interlock::LEASE_S;
        if !self.port.driving || until <= lease_ends {
            self.advance_to(until);
            return self.stop_if_tripped();
        }
        self.advance_to(lease_ends);
        let trip = self.port.lease_expired(self.now());
        self.stop();
        self.advance_to(until);
        Err(RigError::Stopped(trip))
    }
}

#[cfg(test)]
mod stop_tests;

#[cfg(test)]
mod tests;
