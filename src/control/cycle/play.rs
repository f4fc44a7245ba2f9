//! Playing of one pulse: the signal to the motors, tracking by the camera, reading of the accelerometers, learning.

use super::ControlCycle;
use crate::found::Found;
use crate::gain_estimator::{ForecastDeviation, MORE};
use crate::guards::{MotionFinding, NEVER, PlateSwing, PulseOutcome, Sight, went};
use crate::perception::FramePurpose;
use crate::run_end::{OrEnd, is_stopped};
use crate::{EventFacts, EventLevel, PulseFacts, PulsePositions};
use upm_core::geometry::Vec2;
use upm_core::job::{Finding, StopCause};
use upm_core::rig::RigError;
use upm_core::signal::{AccelTrace, Drive, Envelope, TwistWave};
use upm_perception::estimation::{
    AccelerometerPair, ExpectedMotion, FitError, MotionJudgement, PlateFit, fit_twist, fit_wave, judge,
};
use upm_planning::cor_library::{CoilResponse, Library};
use upm_planning::planner::{PartState, PlannedPulse};

impl ControlCycle<'_, '_> {
    /// Plays one pulse and tracks the parts until a frame shows everything at rest; `purpose` is the purpose of that
    /// frame.
    pub(super) fn play(&mut self, planned: &PlannedPulse, purpose: FramePurpose) -> OrEnd {
        let _span = tracing::trace_span!("play").entered();
        let drive = drive_of(self.library, planned)?;
        let started_at = self.io.rig.now();
        let (all_seen, before_m) = (self.perception.frames_missing() == 0, self.perception.positions_m());
        let ahead = self.forecasts(&before_m, planned);
        let forecast_m = ahead.as_ref().map(|[_, learned_m, _]| learned_m.as_slice());
        let coils = planned.coils(self.library);
        let swing = coils.as_ref().map(|coils| self.swing(&self.expected(&drive, coils)));
        self.perception.expect_pulse(started_at, forecast_m, swing);
        self.io.rig.play(&drive)?;
        let followed = self.follow(purpose);
        let trace = self.io.rig.trace();
        let sensors = self.sensors();
        let fit = read(planned, &drive, &trace, &sensors);
        let after_m = self.perception.positions_m();
        let all_seen = all_seen && self.perception.frames_missing() == 0;
        let forecasts = ahead.filter(|_| followed.is_ok() && all_seen && !self.perception.motors_stopped);
        let (positions, with_more_m) = forecasts
            .map(|[by_library_m, by_learning_m, with_more_m]| {
                (PulsePositions { before_m, after_m, by_library_m, by_learning_m }, with_more_m)
            })
            .unzip();
        let (cycle, planned, is_probe) = (self.index, planned.clone(), false);
        let facts = PulseFacts { cycle, started_at, planned, is_probe, drive, trace, fit, positions };
        // the repetition of a stopped run does not stop
        if !is_stopped(&followed) {
            self.io.sink.pulse(&facts);
        }
        let PulseFacts { planned, drive, fit, positions, .. } = &facts;
        if let Err(ending) = followed {
            // a plate that did not move as planned explains parts at unexpected places
            let is_doubt = ending.cause == Some(StopCause::Found(Finding::PartsJumped));
            let judged = self.judged(drive, coils.as_ref(), fit).filter(|_| is_doubt);
            return Err(self.check_motion(judged, None).err().unwrap_or(ending));
        }
        if let Some((seen, with_more_m)) = positions.as_ref().zip(with_more_m.as_ref()) {
            self.gains.learn(seen, with_more_m, ForecastDeviation::of(planned));
            self.warn_of_slow_parts();
        }
        if self.perception.motors_stopped {
            return Ok(());
        }
        self.doubt(&facts, coils.as_ref())
    }

    /// Tracks the parts until a frame shows everything at rest.
    pub(super) fn follow(&mut self, purpose: FramePurpose) -> OrEnd {
        loop {
            let at_rest = self.perception.observe(self.io, purpose)?;
            if at_rest {
                return Ok(());
            }
            self.check_stop()?;
            self.check_lost()?;
            if 2 * self.perception.frames_missing_in_clear_view() > self.params.lost_after_frames {
                // a part blurred by motion becomes visible once the plate is still
                self.perception.stop_motors(self.io.rig);
            }
        }
    }

    /// Compares a pulse with its plan: the plate's motion, the parts' steps, the pictures' timing. Steps are there
    /// where all parts were seen.
    fn doubt(&mut self, facts: &PulseFacts, coils: Option<&CoilResponse>) -> OrEnd {
        let PulseFacts { drive, fit, positions, .. } = facts;
        let went = positions.as_ref().and_then(went);
        let is_as_planned = self.check_motion(self.judged(drive, coils, fit), went)?;
        self.check_picture_delay(is_as_planned)?;
        let stuck = positions.as_ref().and_then(|positions| self.steps.check(positions, &[], self.limits.steps_limit));
        self.report_step(stuck)
    }

    /// Ends a run whose part stays although it is carried.
    pub(super) fn report_step(&mut self, stuck: Option<usize>) -> OrEnd {
        let Some(part) = stuck.filter(|_| self.params.guards.has(Finding::PartStuck)) else { return Ok(()) };
        let (id, pulses) = (self.params.id(part), self.limits.steps_limit);
        let reason = format!("{id} hardly moves although {pulses} pulses in a row should carry it");
        Err(self.end_by(Found::about(Finding::PartStuck, part), reason))
    }

    fn judged(
        &self,
        drive: &Drive,
        coils: Option<&CoilResponse>,
        fit: &Result<PlateFit, FitError>,
    ) -> Option<MotionJudgement> {
        coils.map(|coils| judge(&self.expected(drive, coils), fit.as_ref(), &self.sensors()))
    }

    /// Weighs how the plate moved in a pulse in which most parts went this way; true where it moved as planned.
    pub(super) fn check_motion(&mut self, judged: Option<MotionJudgement>, went: Option<PulseOutcome>) -> OrEnd<bool> {
        let sight = self.sight(went);
        let found = judged.and_then(|judged| self.motion.check(&judged, sight));
        self.report(found)
    }

    /// The expected motion of a pulse.
    pub(super) fn expected<'a>(&self, drive: &'a Drive, coils: &'a CoilResponse) -> ExpectedMotion<'a> {
        let limit = self.limits.motion_limit;
        ExpectedMotion { drive, coils, load_mps2: self.load_mps2, limit, take_over: None }
    }

    /// A pulse as the camera saw it, in which most parts went this way.
    pub(super) fn sight(&self, parts: Option<PulseOutcome>) -> Sight {
        if self.perception.relocated {
            return Sight::default();
        }
        Sight { parts, plate: self.perception.delay.swing_seen() }
    }

    /// Reports a finding on a pulse's motion and ends the run if it must; true where the plate moved about as planned.
    pub(super) fn report(&mut self, found: Option<MotionFinding>) -> OrEnd<bool> {
        let Some(MotionFinding { found, reason, ends }) = found else { return Ok(true) };
        if self.params.guards.has(found.finding) {
            if ends {
                return Err(self.end_by(found, reason));
            }
            self.warn(found, reason);
            // parts in motion are followed frame by frame, whatever the coils give
            if !self.is_cautious && self.moving().is_none() {
                let text = "steps are shorter from now on: coils or accelerometers are in doubt";
                self.io.sink.event(&EventFacts::note(self.io.rig.now(), EventLevel::Warning, text));
            }
            self.is_cautious = true;
        }
        Ok(!ends)
    }

    /// Ends a run whose pictures are late. To be called after a pulse; one in which the plate moved off its plan is no
    /// evidence.
    pub(super) fn check_picture_delay(&mut self, is_as_planned: bool) -> OrEnd {
        let late = if is_as_planned { self.perception.delay.end() } else { None };
        let Some(late) = late.filter(|_| self.params.guards.has(Finding::CameraLate)) else { return Ok(()) };
        let reason = match late {
            NEVER => "the pictures do not show the plate move as it is driven".to_owned(),
            frames => format!("the plate moves {frames} frames later in the pictures than it is driven"),
        };
        Err(self.end_by(Finding::CameraLate, reason))
    }

    pub(super) fn sensors(&self) -> AccelerometerPair {
        AccelerometerPair { position_m: self.io.model.accelerometer_in_plate_m, gain: self.library.accelerometer_gain }
    }

    /// Expected swing of the plate in a pulse.
    pub(super) fn swing(&self, expected: &ExpectedMotion<'_>) -> PlateSwing {
        self.swing_of(expected.wave(), expected.drive.envelope, None)
    }

    /// Expected swing of the plate with this velocity at full height, while another fades.
    pub(super) fn swing_of(&self, wave: TwistWave, envelope: Envelope, fades: Option<TwistWave>) -> PlateSwing {
        let (half_side_m, px_per_m) = (0.5 * self.io.model.plate_side_m, self.perception.table.mean_px_per_m());
        PlateSwing { wave, fades, envelope, half_side_m, px_per_m }
    }

    /// Forecast places, after a pulse, of parts at `before_m`: by the library alone, with the learned gains, and with
    /// gains larger by [`MORE`].
    fn forecasts(&self, before_m: &[Vec2], pulse: &PlannedPulse) -> Option<[Vec<Vec2>; 3]> {
        let with = |gain: &dyn Fn(usize, Vec2) -> f64| {
            let state = |(part, &position_m): (usize, &Vec2)| PartState {
                position_m,
                step_m: Vec2::zeros(),
                radius_m: self.params.radius_m(part),
                gain: gain(part, position_m),
            };
            self.planner.forecast(&before_m.iter().enumerate().map(state).collect::<Vec<_>>(), pulse)
        };
        let learned = |part: usize, at_m: Vec2| self.gains.get(part, at_m);
        Some([with(&|_, _| 1.0)?, with(&learned)?, with(&|part, at_m| learned(part, at_m) + MORE)?])
    }
}

/// The drive of the motors for a pulse; `Err` with the reason where the library cannot drive it.
pub(super) fn drive_of(library: &Library, planned: &PlannedPulse) -> Result<Drive, RigError> {
    let reason = || match planned {
        PlannedPulse::Rotation(rotation) => format!("the library has no entry {}", rotation.entry),
        PlannedPulse::Field(field) => {
            format!("the library drives no field of {} harmonics", field.wave.harmonics.len())
        }
    };
    planned.drive(library).ok_or_else(|| RigError::BadDrive(reason()))
}

/// The plate's motion from the accelerometers, for as many harmonics as the pulse has.
fn read(
    planned: &PlannedPulse,
    drive: &Drive,
    trace: &AccelTrace,
    sensors: &AccelerometerPair,
) -> Result<PlateFit, FitError> {
    match planned {
        PlannedPulse::Rotation(_) => {
            fit_twist(trace, &drive.envelope, drive.base_radps, sensors).map(Box::new).map(PlateFit::Twist)
        }
        PlannedPulse::Field(field) => {
            let harmonics = field.wave.harmonics.len();
            fit_wave(trace, &drive.envelope, drive.base_radps, harmonics, sensors).map(PlateFit::Wave)
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Complex, Matrix3};

    use super::*;
    use upm_core::geometry::Twist;
    use upm_core::signal::{TwistHarmonic, TwistWave};
    use upm_planning::cor_library::{FieldResponse, testing};
    use upm_planning::planner::{FieldPulse, Rotation};

    const BASE_RADPS: f64 = std::f64::consts::TAU * 30.0;

    fn library() -> Library {
        let fields = FieldResponse {
            base_radps: BASE_RADPS,
            attack_s: 0.06,
            rest_s: 0.05,
            limit_counts: 1000.0,
            twist_from_counts: vec![Matrix3::from_diagonal_element(Complex::new(0.0, -1e-3)); 2],
        };
        let belt = testing::library([Twist::new(0.5, 0.0, 0.0)]);
        Library { base_radps: 377.0, attack_s: 0.02, rest_s: 0.04, fields: Some(fields), ..belt }
    }

    fn field(harmonics: usize) -> PlannedPulse {
        let harmonic = TwistHarmonic { cos: Twist::new(0.1, 0.0, 0.0), sin: Twist::ZERO };
        let wave = TwistWave { base_radps: BASE_RADPS, harmonics: vec![harmonic; harmonics] };
        PlannedPulse::Field(FieldPulse { wave, follows: Default::default(), sustain_s: 0.1 })
    }

    #[test]
    fn either_kind_is_driven_by_the_library_or_refused_in_words() {
        let rotation = |entry, distance_m| {
            PlannedPulse::Rotation(Rotation { entry, distance_m, amplitude: 1.0, sustain_s: 0.1, rest_s: 0.04 })
        };
        let forwards = drive_of(&library(), &rotation(0, 0.01)).unwrap();
        assert_eq!(drive_of(&library(), &rotation(0, -0.01)), Ok(forwards.reversed()));
        assert_eq!(
            drive_of(&library(), &rotation(1, 0.01)),
            Err(RigError::BadDrive("the library has no entry 1".into()))
        );
        let drive = drive_of(&library(), &field(2)).unwrap();
        assert_eq!((drive.base_radps, drive.envelope.attack_s, drive.motors[0].len()), (BASE_RADPS, 0.06, 2));
        let refused = RigError::BadDrive("the library drives no field of 3 harmonics".into());
        assert_eq!(drive_of(&library(), &field(3)), Err(refused));
    }

    #[test]
    fn a_field_is_read_for_its_own_harmonics_and_a_short_one_is_a_fault() {
        let planned = field(2);
        let sensors = AccelerometerPair::exact(Vec2::new(0.09, 0.09));
        let mut drive = drive_of(&library(), &planned).unwrap();
        // along x alone: a(t) of velocity 0.1 (cos wt + cos 2wt) is -0.1 w (sin wt + 2 sin 2wt)
        let sample = |i: usize| {
            let angle_rad = BASE_RADPS * i as f64 / 5000.0;
            (-0.1 * BASE_RADPS * (angle_rad.sin() + 2.0 * (2.0 * angle_rad).sin()) / 0.01).round() as i16
        };
        let (along_x, still): (Vec<i16>, Vec<i16>) = ((0..1200).map(sample).collect(), vec![0; 1200]);
        let trace = AccelTrace {
            sample_hz: 5000.0,
            first_sample_s: 0.0,
            mps2_per_count: 0.01,
            count_limit: 32_000,
            counts: [along_x.clone(), still.clone(), along_x, still],
        };
        let Ok(PlateFit::Wave(fit)) = read(&planned, &drive, &trace, &sensors) else { panic!("no wave") };
        assert_eq!(fit.wave.harmonics.len(), 2);
        for harmonic in &fit.wave.harmonics {
            assert!((harmonic.cos.velocity_mps - Vec2::new(0.1, 0.0)).norm() < 1e-3, "{harmonic:?}");
        }
        drive.envelope.sustain_s = 0.03;
        assert!(matches!(read(&planned, &drive, &trace, &sensors), Err(FitError::TooShort { .. })));
    }
}
