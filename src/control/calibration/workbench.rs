use std::sync::atomic::{AtomicBool, Ordering};

use super::{CalibrationFault, CalibrationProgress};
use crate::estimation::{TwistFit, fit_twist};
use crate::library::{AxisShape, drive_for};
use crate::rig::{Rig, RigModel};
use crate::signal::{Drive, Envelope, Frame};

/// The rig with what every measurement needs.
pub(super) struct Workbench<'a> {
    pub rig: &'a mut dyn Rig,
    pub model: &'a RigModel,
    pub stop: &'a AtomicBool,
    pub progress: &'a mut dyn FnMut(CalibrationProgress),
}

impl Workbench<'_> {
    pub fn report(&mut self, stage: &'static str, done: usize, total: usize) {
        let plate_time_s = self.rig.now().secs();
        (self.progress)(CalibrationProgress { stage, done, total, plate_time_s });
    }

    /// The pulse of these amplitudes.
    pub fn drive(&self, amplitudes: [i32; 4], shapes: &[AxisShape; 3], sustain_s: f64) -> Drive {
        let envelope = Envelope { attack_s: self.model.attack_s, sustain_s, rest_s: self.model.rest_s };
        drive_for(amplitudes, shapes, self.model.base_radps, envelope)
    }

    pub fn stop_check(&self) -> Result<(), CalibrationFault> {
        if self.stop.load(Ordering::Relaxed) { Err(CalibrationFault::Stopped) } else { Ok(()) }
    }

    /// Plays a pulse to the end of its rest and reads the accelerometers.
    pub fn read_twist(&mut self, what: &str, drive: &Drive) -> Result<TwistFit, CalibrationFault> {
        let [width, height] = self.model.frame_size_px;
        let mut frame = Frame::new(width, height);
        self.rig.play(drive)?;
        while self.rig.now() < self.rig.quiet_at() {
            self.stop_check()?;
            self.rig.capture(&mut frame)?;
        }
        fit_twist(&self.rig.trace(), &drive.envelope, drive.base_radps, self.model.accelerometer_in_plate_m)
            .map_err(|fault| CalibrationFault::Trace { what: what.to_owned(), fault })
    }
}
