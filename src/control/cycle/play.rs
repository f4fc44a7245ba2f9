//! One pulse: sent to the motors, followed by the eyes, read from the accelerometers, learned from.

use super::Cycle;
use crate::control::ending::Ending;
use crate::control::eyes::Moment;
use crate::control::{Carried, PulseFacts};
use crate::estimation::{AccelerometerPair, FitFault, PlateFit, fit_twist, fit_wave};
use crate::geometry::Vec2;
use crate::library::Library;
use crate::planner::{PartState, PlannedPulse};
use crate::signal::{AccelTrace, Drive};

impl Cycle<'_> {
    /// Plays one pulse and follows the parts until everything rests.
    pub(super) fn play(&mut self, planned: &PlannedPulse) -> Result<(), Ending> {
        let drive = drive_of(self.library, planned).map_err(Ending::failed)?;
        let started_at = self.rig.now();
        let (all_seen, before_m) = (self.eyes.missing_for() == 0, self.eyes.positions_m());
        self.rig.play(&drive)?;
        while self.rig.now() < self.rig.quiet_at() {
            self.check_stop()?;
            self.eyes.look(self.rig, Moment::Pulse, self.sink, self.clock)?;
        }
        let trace = self.rig.trace();
        let sensors = AccelerometerPair {
            position_m: self.model.accelerometer_in_plate_m,
            gain: self.library.accelerometer_gain,
        };
        let fit = read(planned, &drive, &trace, &sensors);
        let after_m = self.eyes.positions_m();
        let all_seen = all_seen && self.eyes.missing_for() == 0;
        let forecasts = if all_seen { self.forecasts(&before_m, planned) } else { None };
        let carried = forecasts.as_ref().map(|[by_library_m, by_learning_m]| Carried {
            before_m: &before_m,
            after_m: &after_m,
            by_library_m,
            by_learning_m,
        });
        self.sink.pulse(&PulseFacts {
            cycle: self.index,
            started_at,
            planned,
            drive: &drive,
            trace: &trace,
            fit: &fit,
            carried,
        });
        if let Some([by_library_m, _]) = &forecasts {
            self.gains.learn(&before_m, by_library_m, &after_m);
            self.tell_slow_parts();
        }
        Ok(())
    }

    /// Where parts at `before_m` should be after a pulse: by the library alone, and with what was learned.
    fn forecasts(&self, before_m: &[Vec2], pulse: &PlannedPulse) -> Option<[Vec<Vec2>; 2]> {
        let state = |part: usize, position_m: Vec2, gain: f64| PartState {
            position_m,
            step_m: Vec2::zeros(),
            radius_m: self.params.radius_m(part),
            gain,
        };
        let parts = || before_m.iter().copied().enumerate();
        let plain: Vec<PartState> = parts().map(|(i, p_m)| state(i, p_m, 1.0)).collect();
        let learned: Vec<PartState> = parts().map(|(i, p_m)| state(i, p_m, self.gains.get(i, p_m))).collect();
        Some([self.plans.forecast(&plain, pulse)?, self.plans.forecast(&learned, pulse)?])
    }
}

/// What the motors are sent for a pulse; `Err` in words where the library cannot drive it.
fn drive_of(library: &Library, planned: &PlannedPulse) -> Result<Drive, String> {
    match planned {
        PlannedPulse::Rotation(rotation) => library
            .drive(rotation.entry, rotation.sustain_s)
            .map(|drive| if rotation.distance_m < 0.0 { drive.reversed() } else { drive })
            .ok_or_else(|| format!("library has no entry {}", rotation.entry)),
        PlannedPulse::Field(field) => library
            .field_drive(&field.wave, field.sustain_s)
            .ok_or_else(|| format!("library cannot drive a field of {} harmonics", field.wave.harmonics.len())),
    }
}

/// The plate's motion by the accelerometers, for as many harmonics as the pulse has.
fn read(
    planned: &PlannedPulse,
    drive: &Drive,
    trace: &AccelTrace,
    sensors: &AccelerometerPair,
) -> Result<PlateFit, FitFault> {
    match planned {
        PlannedPulse::Rotation(_) => fit_twist(trace, &drive.envelope, drive.base_radps, sensors).map(PlateFit::Twist),
        PlannedPulse::Field(field) => {
            let harmonics = field.wave.harmonics.len();
            fit_wave(trace, &drive.envelope, drive.base_radps, harmonics, sensors).map(PlateFit::Wave)
        }
    }
}
