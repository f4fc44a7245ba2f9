//! The plate without parts: played without a picture, and its true steady motion.

use std::f64::consts::TAU;
use std::sync::atomic::AtomicBool;

use nalgebra::Complex;

use super::{LabError, LabRig};
use upm_control::calibration::{Axes, CalibrationError, CalibrationParams, CalibrationSession};
use upm_core::geometry::Twist;
use upm_core::random::Streams;
use upm_core::rig::{Rig, RigModel};
use upm_core::signal::{AccelTrace, Drive, Envelope, Frame};
use upm_perception::estimation::{AccelerometerPair, AxisPhasors, TwistFit, fit_twist};
use upm_sim::{Plant, SimRig};

/// Time after which the rods' oscillation has decayed, s.
const SETTLED_S: f64 = 2.5;
/// Time over which the steady motion is measured, s.
const WINDOW_S: f64 = 1.0;

/// A rig without parts whose camera is one pixel, so that simulation takes almost no time.
#[derive(Debug)]
pub(super) struct BarePlate {
    model: RigModel,
    rig: SimRig,
    frame: Frame,
}

impl BarePlate {
    pub fn new(lab: &LabRig) -> Self {
        let mut sim = lab.sim.clone();
        sim.camera.size_px = [1, 1];
        let model = RigModel { frame_size_px: [1, 1], ..lab.model.clone() };
        let rig = SimRig::new(model.clone(), sim, Vec::new(), Streams::new(lab.seed));
        Self { model, rig, frame: Frame::new(1, 1) }
    }

    /// Plays a pulse to the end of its rest; returns the accelerometer trace.
    pub fn play(&mut self, drive: &Drive) -> Result<AccelTrace, LabError> {
        let refused = |fault: upm_core::rig::RigError| LabError::Rig(fault.to_string());
        self.rig.play(drive).map_err(refused)?;
        while self.rig.now() < self.rig.settled_at() {
            self.rig.capture(&mut self.frame).map_err(refused)?;
        }
        Ok(self.rig.trace())
    }

    /// Plays a pulse; returns the motion that the accelerometers read.
    pub fn read(&mut self, what: &str, drive: &Drive, sensors: &AccelerometerPair) -> Result<TwistFit, LabError> {
        let trace = self.play(drive)?;
        let fit = fit_twist(&trace, &drive.envelope, drive.base_radps, sensors);
        fit.map_err(|fault| LabError::Rig(format!("{what}: {fault}")))
    }

    /// The axes' response as determined by calibration.
    pub fn axes(&mut self) -> Result<Axes, LabError> {
        self.calibrated(|session, _| session.axes())
    }

    /// Measurements by a session of calibration.
    pub fn calibrated<T>(
        &mut self,
        measure: impl FnOnce(CalibrationSession<'_>, &CalibrationParams) -> Result<T, CalibrationError>,
    ) -> Result<T, LabError> {
        let (params, stop) = (CalibrationParams::full(Vec::new(), Vec::new()), AtomicBool::new(false));
        let mut quiet = |_| ();
        let session = CalibrationSession::new(&mut self.rig, &self.model, &stop, &mut quiet);
        measure(session, &params).map_err(|fault| LabError::Rig(fault.to_string()))
    }
}

/// The plate's true motion once the rods have settled under `drive`, whatever its envelope: the twist's first two
/// harmonics, by a discrete Fourier transform under a Hann window, phases as in the drive.
pub(super) fn steady_motion(lab: &LabRig, drive: &Drive) -> [AxisPhasors; 3] {
    let length_s = SETTLED_S + WINDOW_S;
    let envelope = Envelope { attack_s: drive.envelope.attack_s, sustain_s: length_s, rest_s: 0.0 };
    let mut plant = Plant::new(&lab.sim, &[], &Streams::new(lab.seed));
    plant.play(Drive { envelope, ..drive.clone() });
    let [from, steps] = [SETTLED_S, WINDOW_S].map(|time_s| (time_s / lab.sim.step_s).round() as usize);
    for _ in 0..from {
        plant.step();
    }
    let mut sums = [[Complex::new(0.0, 0.0); 2]; 3];
    let mut weights = 0.0;
    for i in 0..steps {
        plant.step();
        let weight = 1.0 - (TAU * (i as f64 + 0.5) / steps as f64).cos();
        let turn = Complex::from_polar(1.0, -drive.base_radps * (from + i + 1) as f64 * lab.sim.step_s);
        let Twist { velocity_mps, spin_radps } = plant.plate().twist;
        for (sum, value) in sums.iter_mut().zip([velocity_mps.x, velocity_mps.y, spin_radps]) {
            sum[0] += turn * (weight * value);
            sum[1] += turn * turn * (weight * value);
        }
        weights += weight;
    }
    sums.map(|[first, second]| AxisPhasors { first: first * (2.0 / weights), second: second * (2.0 / weights) })
}
