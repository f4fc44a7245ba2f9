use std::f64::consts::TAU;
use std::sync::atomic::{AtomicBool, Ordering};

use super::{CalibrationError, CalibrationProgress};
use crate::{RunIo, Sink};
use upm_core::rig::{Rig, RigModel};
use upm_core::signal::{AccelTrace, Drive, Envelope, Frame, MISSING_SAMPLE};
use upm_core::time::StoppedClock;
use upm_perception::estimation::{AccelerometerPair, TwistFit, fit_twist};
use upm_planning::cor_library::{AxisShape, PlateResponse, drive_for};

/// Share of the motors' limit that calibration uses.
pub(super) const EFFORT: f64 = 0.97;

/// The rig together with everything a measurement needs. Motors are at zero after it, also after an error.
pub struct CalibrationSession<'a> {
    pub(super) rig: &'a mut dyn Rig,
    pub(super) model: &'a RigModel,
    /// The accelerometers as calibrated so far.
    pub(super) sensors: AccelerometerPair,
    /// The plate's response as measured so far.
    pub(super) plate: PlateResponse,
    stop: &'a AtomicBool,
    progress: &'a mut dyn FnMut(CalibrationProgress),
}

impl Drop for CalibrationSession<'_> {
    fn drop(&mut self) {
        self.rig.stop();
    }
}

impl<'a> CalibrationSession<'a> {
    /// With the accelerometers' gains from their data sheet; ends once `stop` is set, and reports each measurement to
    /// `progress`.
    pub fn new(
        rig: &'a mut dyn Rig,
        model: &'a RigModel,
        stop: &'a AtomicBool,
        progress: &'a mut dyn FnMut(CalibrationProgress),
    ) -> Self {
        let sensors = AccelerometerPair::exact(model.accelerometer_in_plate_m);
        Self { rig, model, sensors, plate: PlateResponse::default(), stop, progress }
    }

    /// The devices that perception works with, without a sink and a clock.
    pub(super) fn io<'s>(&'s mut self, sink: &'s mut dyn Sink) -> RunIo<'s> {
        static NEVER: AtomicBool = AtomicBool::new(false);
        let (rig, model, stop) = (&mut *self.rig, self.model, self.stop);
        RunIo { rig, model, sink, clock: &StoppedClock, stop, give_way: &NEVER, planner: None }
    }

    pub(super) fn report(&mut self, stage: &'static str, done: usize, total: usize) {
        let plate_time_s = self.rig.now().secs();
        (self.progress)(CalibrationProgress { stage, done, total, plate_time_s });
    }

    /// The pulse with these motor amplitudes in counts.
    pub(super) fn drive(&self, amplitudes: [i32; 4], shapes: &[AxisShape; 3], sustain_s: f64) -> Drive {
        let envelope = Envelope { attack_s: self.model.attack_s, sustain_s, rest_s: self.model.rest_s };
        drive_for(self.model.motor_arrangement, amplitudes, shapes, &self.plate, self.model.base_radps, envelope)
    }

    /// `wanted_s`, or as near to it as the rig and the reading of an accelerometer trace allow: three periods of the
    /// drive or more, and no longer than the longest pulse.
    pub(super) fn read_sustain_s(&self, wanted_s: f64) -> f64 {
        wanted_s.max(3.0 * TAU / self.model.base_radps).min(self.model.max_sustain_s)
    }

    /// Factor by which `amplitudes` may be scaled before a motor reaches its limit.
    pub(super) fn headroom(&self, amplitudes: [i32; 4], shapes: &[AxisShape; 3]) -> f64 {
        self.model.count_limit / self.drive(amplitudes, shapes, 0.0).peak_counts().max(f64::MIN_POSITIVE)
    }

    pub(super) fn stop_check(&self) -> Result<(), CalibrationError> {
        if self.stop.load(Ordering::Relaxed) { Err(CalibrationError::Stopped) } else { Ok(()) }
    }

    /// Largest acceleration any channel showed in the last pulse, m/s².
    pub(super) fn peak_mps2(&self) -> f64 {
        let trace = self.rig.trace();
        let shown = trace.counts.iter().flatten().filter(|&&count| count != MISSING_SAMPLE);
        f64::from(shown.map(|count| count.unsigned_abs()).max().unwrap_or(0)) * trace.mps2_per_count
    }

    /// Plays a pulse to the end of its rest and reads the plate's twist from the accelerometers.
    pub(super) fn read_twist(&mut self, what: &str, drive: &Drive) -> Result<TwistFit, CalibrationError> {
        let trace = self.play(drive)?;
        fit_twist(&trace, &drive.envelope, drive.base_radps, &self.sensors)
            .map_err(|fault| CalibrationError::Trace { what: what.to_owned(), fault })
    }

    /// Plays a pulse to the end of its rest and returns the accelerometers' trace.
    pub(super) fn play(&mut self, drive: &Drive) -> Result<AccelTrace, CalibrationError> {
        let [width, height] = self.model.frame_size_px;
        let mut frame = Frame::new(width, height);
        self.rig.play(drive)?;
        while self.rig.now() < self.rig.settled_at() {
            self.stop_check()?;
            self.rig.capture(&mut frame)?;
        }
        Ok(self.rig.trace())
    }
}
