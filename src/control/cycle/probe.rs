//! The probe: a small pulse that moves no part and tests every coil and accelerometer. It is the first pulse of a run
//! and is played again after the table was located anew.

use super::ControlCycle;
use crate::PulseFacts;
use crate::guards::MotionFinding;
use crate::perception::FramePurpose;
use crate::run_end::{OrEnd, is_stopped};
use upm_core::job::Finding;
use upm_core::signal::Follows;
use upm_perception::estimation::{ExpectedMotion, FitError, PlateFit, fit_wave, judge};
use upm_planning::planner::{FieldPulse, PlannedPulse};

/// Largest number of probes in a row until one is tracked to its end.
const MOST_PROBES: usize = 3;

impl ControlCycle<'_, '_> {
    /// Plays the probe, if the library has one, until one is tracked to its end, and judges it.
    pub(super) fn probe(&mut self) -> OrEnd {
        let Some((mut drive, coils)) = self.library.probe() else { return Ok(()) };
        drive.envelope.sustain_s = drive.envelope.sustain_s.min(self.io.model.max_sustain_s);
        let expected = self.expected(&drive, &coils);
        for _ in 0..MOST_PROBES {
            let fit = self.play_probe(&expected)?;
            if !self.perception.invalidates_plan() {
                return self.judge_probe(&expected, &fit);
            }
            if !self.perception.motors_stopped {
                // the camera's view of the swing is lost; the readings of coils and channels are not
                let found = self.read_probe(&expected, &fit).filter(|found| found.found.finding != Finding::MotionOff);
                self.report(found)?;
            }
            self.observe_at_rest()?;
        }
        Ok(())
    }

    fn play_probe(&mut self, expected: &ExpectedMotion<'_>) -> OrEnd<Result<PlateFit, FitError>> {
        let drive = expected.drive;
        let (wave, follows, sustain_s) = (expected.wave(), Follows::Displacement, drive.envelope.sustain_s);
        let planned = PlannedPulse::Field(FieldPulse { wave, follows, sustain_s });
        let (started_at, before_m) = (self.io.rig.now(), self.perception.positions_m());
        self.perception.expect_pulse(started_at, Some(&before_m), Some(self.swing(expected)));
        self.io.rig.play(drive)?;
        let followed = self.follow(FramePurpose::Pulse);
        let trace = self.io.rig.trace();
        let fit = fit_wave(&trace, &drive.envelope, drive.base_radps, 1, &self.sensors()).map(PlateFit::Wave);
        // the repetition of a stopped run does not stop
        if !is_stopped(&followed) {
            self.io.sink.pulse(&PulseFacts {
                cycle: self.index,
                started_at,
                planned,
                is_probe: true,
                drive: drive.clone(),
                trace,
                fit: fit.clone(),
                positions: None,
            });
        }
        followed.map(|()| fit)
    }

    fn read_probe(&mut self, expected: &ExpectedMotion<'_>, fit: &Result<PlateFit, FitError>) -> Option<MotionFinding> {
        let judged = judge(expected, fit.as_ref(), &self.sensors());
        self.motion.check(&judged, self.sight(None))
    }

    fn judge_probe(&mut self, expected: &ExpectedMotion<'_>, fit: &Result<PlateFit, FitError>) -> OrEnd {
        let found = self.read_probe(expected, fit);
        let is_as_planned = self.report(found)?;
        self.check_frozen(is_as_planned)?;
        self.check_picture_delay(is_as_planned)
    }

    /// Ends a run whose pictures show nothing of the first pulse.
    pub(super) fn check_frozen(&mut self, is_as_planned: bool) -> OrEnd {
        if is_as_planned && !self.perception.has_changed() && self.params.guards.has(Finding::CameraFrozen) {
            let reason = "no picture differs from the first, and the plate was shaken".to_owned();
            return Err(self.end_by(Finding::CameraFrozen, reason));
        }
        Ok(())
    }
}
