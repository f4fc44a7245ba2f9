mod end;
mod moving;
mod planning;
mod play;
mod probe;

use std::sync::Arc;
use std::sync::atomic::Ordering;

use super::findings::Findings;
use super::found::{Found, Reason};
use super::gain_estimator::GainEstimator;
use super::guards::{MotionGuard, StepGuard};
use super::hindrance::past;
use super::params::ControlParams;
use super::perception::{FramePurpose, Perception};
use super::progress::ProgressWatch;
use super::pulse_planner::PulsePlanner;
use super::run_end::{OrEnd, RunEnd, check_stop};
use super::{CycleFacts, EventFacts, EventKind, EventLevel, RunIo};
use upm_core::geometry::Vec2;
use upm_core::job::{Evidence, Finding, Outcome};
use upm_core::time::PlateTime;
use upm_core::units::{GRAVITY_MPS2, mm_from_m};
use upm_planning::cor_library::Library;
use upm_planning::planner::PlanningMethod;
use upm_planning::task::{LateLap, Setpoints, Task};

pub use self::planning::fallbacks;

/// Factor for the wanted steps while coils or accelerometers are in doubt, and the length, m, below which steps are not
/// shortened.
const CAUTIOUS_SHARE: f64 = 0.5;
const CAUTIOUS_STEP_M: f64 = 2e-3;

/// A part that moves less than the first share of the distance the library predicts is slow; from the second share on
/// it no longer is.
const SLOW: f64 = 0.7;
const NOT_SLOW: f64 = 0.75;

/// Plate time without a pulse after which a run counts as stalled, s.
const STALLED_S: f64 = 10.0;

/// Largest friction of a part on the plate: of dry metal.
const MOST_FRICTION: f64 = 0.5;

/// Ending of a run and the state of its parts then.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FinalState {
    /// Outcome, cause and reason.
    pub ending: RunEnd,
    /// The task's last request; `None` when it was never asked.
    pub wanted: Option<Setpoints>,
    /// Last seen positions of the parts, m; empty when they were never seen.
    pub measured_m: Vec<Vec2>,
    /// Indices of the parts that are lost.
    pub lost: Vec<usize>,
    /// How near the run came to the findings that rest on chance; `None` when it never began.
    pub evidence: Option<Evidence>,
}

/// Runs `task` to its end. Motors are at zero when this returns, also after an error.
pub fn run(mut io: RunIo<'_>, library: &Arc<Library>, task: &mut dyn Task, params: &ControlParams) -> FinalState {
    let limits = params.guards.limits(params.parts.len(), params.method != PlanningMethod::MovingField);
    let open = |io: &mut RunIo<'_>| {
        let planner = PulsePlanner::new(params, library, io.planner.take())?;
        let mut perception = Perception::open(io, &params.kinds, &params.parts, params.guards)?;
        let noise_px = library.camera_noise.map(|noise| noise.corner_px);
        perception.delay.for_run(limits.late_limit, noise_px);
        Ok((planner, perception))
    };
    let finish = match open(&mut io) {
        Ok((planner, perception)) => {
            let mut cycle = ControlCycle {
                planner,
                gains: GainEstimator::new(params.parts.len(), 0.5 * io.model.plate_side_m),
                watch: ProgressWatch::new(params.follows_paths, params.tolerance_m),
                load_mps2: MOST_FRICTION * GRAVITY_MPS2 * params.parts_mass_kg() / io.model.plate_mass_kg,
                io: &mut io,
                library,
                task,
                params,
                perception,
                findings: Findings::default(),
                played: false,
                wanted: None,
                furthest: 0.0,
                index: 0,
                motion: MotionGuard::default(),
                steps: StepGuard::default(),
                limits,
                unconfirmed: 0,
                is_cautious: false,
                suspects_knock: false,
                stalled: None,
            };
            cycle.until_end()
        }
        Err(ending) => FinalState { ending, ..FinalState::default() },
    };
    io.rig.stop();
    let level = if finish.ending.outcome == Outcome::Failed { EventLevel::Error } else { EventLevel::Info };
    let RunEnd { outcome, cause, reason } = finish.ending.clone();
    let kind = EventKind::RunEnded { outcome, cause };
    io.sink.event(&EventFacts { at: io.rig.now(), level, text: reason, kind });
    finish
}

struct ControlCycle<'a, 'io> {
    io: &'a mut RunIo<'io>,
    library: &'a Arc<Library>,
    task: &'a mut dyn Task,
    params: &'a ControlParams,
    perception: Perception,
    planner: PulsePlanner,
    gains: GainEstimator,
    watch: ProgressWatch,
    findings: Findings,
    /// True when the last cycle had pulses and began a new sequence: the rest of a sequence may lead away before it
    /// leads near.
    played: bool,
    wanted: Option<Setpoints>,
    /// Progress at the last cycle without a pulse that advanced.
    furthest: f64,
    index: u64,
    /// Most that the parts' friction changes the plate's acceleration by, m/s².
    load_mps2: f64,
    motion: MotionGuard,
    steps: StepGuard,
    limits: Evidence,
    /// Number of times the goal seemed reached and a second observation contradicted.
    unconfirmed: u32,
    /// True once a tolerable fault of a coil or an accelerometer was found: steps are shorter from then on.
    is_cautious: bool,
    /// True once moving parts were off their forecast as after a knock, and the plate at rest showed none.
    suspects_knock: bool,
    /// The planner of motions without pauses while pulses from rest are played in their place, and the farthest
    /// distance of a part from its target when they stalled, m.
    stalled: Option<(PulsePlanner, f64)>,
}

impl ControlCycle<'_, '_> {
    fn until_end(&mut self) -> FinalState {
        let mut last_pulse_at = self.io.rig.now();
        self.task.first_seen(&self.perception.positions_m());
        let mut observe = self.observe_at_rest();
        let ending = loop {
            observe = match observe {
                // the last cycle is over here, its parts seen at rest
                Ok(_) if self.io.give_way.load(Ordering::Relaxed) => {
                    break RunEnd::gave_way(self.params.endless && self.makes_progress());
                }
                Ok(observed) => self.once(observed, &mut last_pulse_at),
                Err(ending) => break ending,
            };
        };
        // a stopped run ends in the middle: its repetition goes on, and reports no end there
        if !ending.is_external() {
            self.findings.end_run(self.io.rig.now(), self.io.sink);
            self.perception.findings.end_run(self.io.rig.now(), self.io.sink);
        }
        let lost = if self.is_part_lost() { self.perception.missing_parts() } else { Vec::new() };
        let (wanted, measured_m) = (self.wanted.take(), self.perception.positions_m());
        FinalState { ending, wanted, measured_m, lost, evidence: Some(self.evidence()) }
    }

    fn evidence(&self) -> Evidence {
        let ((pulses, motion), [steps, steps_missed]) = (self.motion.read, self.steps.compared);
        Evidence { pulses, motion, late: self.perception.delay.most, steps, steps_missed, ..self.limits }
    }

    /// One cycle, from an observation at rest to the next, whose positions it returns.
    fn once(&mut self, observed: Vec<Vec2>, last_pulse_at: &mut PlateTime) -> OrEnd<Vec<Vec2>> {
        if std::mem::take(&mut self.perception.relocated) {
            // a mirrored or late picture may look like a knock: the probe tells them apart
            self.check_limits()?;
            self.probe()?;
            return self.observe_at_rest();
        }
        let started = self.io.clock.elapsed();
        let observed_at = self.perception.seen_at();
        let wanted = self.task.next(observed_at, &observed);
        self.io.sink.setpoints(observed_at, &wanted);
        let is_first = self.wanted.replace(wanted.clone()).is_none();
        if wanted.done {
            return self.finish(wanted.phase);
        }
        if is_first {
            self.check_controllable(&observed, &wanted)?;
            self.check_limits()?;
            // the first segment of a motion without pauses is a probe, too
            if self.moving().is_none() || wanted.asks_nothing(&observed) {
                self.probe()?;
                return self.observe_at_rest();
            }
        }
        self.warn_of_hindrances(&wanted, &observed);
        self.check_limits()?;
        self.check_progress(&wanted, &observed, self.played)?;
        self.change_planner(&wanted, &observed);
        // where nothing is asked, the plate rests until a part has drifted, or time has passed
        if !wanted.asks_nothing(&observed)
            && let Some(moved) = self.move_on(&observed, wanted.clone())
        {
            *last_pulse_at = self.io.rig.now();
            self.played = true;
            return moved;
        }
        let _span = tracing::trace_span!("cycle", index = self.index).entered();
        let planning = self.io.clock.elapsed();
        let plan = self.plan(&observed, &wanted)?;
        let plan_us = (self.io.clock.elapsed() - planning).as_secs_f64() * 1e6;
        if let Some((part, by_m)) = plan.corridor_excess {
            let reason = format!("{} leaves its corridor by {:.2} mm", self.params.id(part), mm_from_m(by_m));
            self.warn(Found::about(Finding::CorridorLeft, part), reason);
        }
        self.findings.end_cycle(self.io.rig.now(), self.io.sink);
        self.perception.findings.end_cycle(self.io.rig.now(), self.io.sink);
        self.played = !plan.pulses.is_empty() && !plan.continues;

        for (number, pulse) in (1..).zip(&plan.pulses) {
            self.check_limits()?;
            self.play(pulse, if number == plan.pulses.len() { FramePurpose::Cycle } else { FramePurpose::Pulse })?;
            *last_pulse_at = self.io.rig.now();
            // waits for a part that was not seen for long and may be lost, without playing anything meanwhile
            if self.perception.frames_missing() > self.params.lost_after_frames && !self.perception.motors_stopped {
                self.observe_at_rest()?;
            }
            if self.perception.invalidates_plan() {
                break;
            }
        }
        // the last frame of a pulse shows everything at rest: it starts the next cycle, unless a part is missing in it
        let seen = !plan.pulses.is_empty() && self.perception.frames_missing() == 0;
        let result = if seen { self.perception.positions_m() } else { self.observe_at_rest()? };
        if plan.pulses.is_empty() {
            // a task that advances by time alone asks for no pulse, nor does one without end whose parts have arrived
            if wanted.progress > self.furthest || self.rests_without_end(&wanted, &result) {
                (self.furthest, *last_pulse_at) = (wanted.progress, self.io.rig.now());
            }
            if self.io.rig.now() - *last_pulse_at > STALLED_S {
                let blocking_part = self.watch.blocking_part_description(&wanted, &result, self.params);
                let reason = format!("stalled: no pulse for {STALLED_S} s of plate time; {blocking_part}");
                return Err(RunEnd::failed_because(Finding::NoProgress, reason));
            }
            return Ok(result);
        }
        let cycle_us = (self.io.clock.elapsed() - started).as_secs_f64() * 1e6;
        self.io.sink.cycle(&CycleFacts {
            index: self.index,
            observed_at,
            observed_m: observed,
            wanted,
            plan,
            ended_at: self.perception.seen_at(),
            result_m: result.clone(),
            ends_at_rest: true,
            plan_us,
            cycle_us,
        });
        self.index += 1;
        Ok(result)
    }

    /// Reports parts without a free path and laps that took longer than asked.
    fn warn_of_hindrances(&mut self, wanted: &Setpoints, seen_m: &[Vec2]) {
        // parts in motion go straight, and wait for each other only while they meet
        let blocked = if self.moving().is_some() { &[] } else { wanted.blocked.as_slice() };
        for &part in blocked {
            let past = past(self.params, part, seen_m, &wanted.targets_m);
            let reason = format!("{} is blocked: no free path to its target{past}", self.params.id(part));
            self.warn(Found::about(Finding::PartBlocked, part), reason);
        }
        if let Some(LateLap { lap, took_s, asked_s }) = wanted.late_lap {
            let reason = format!("lap {lap} took {took_s:.1} s of plate time, {asked_s:.1} s are asked");
            self.warn(Finding::LapLate, reason);
        }
    }

    /// Takes an observation, after pulses if `played`, and ends a run that no longer makes progress.
    fn check_progress(&mut self, wanted: &Setpoints, seen_m: &[Vec2], played: bool) -> OrEnd {
        if self.watch.observe(wanted, seen_m, played) && self.params.guards.has(Finding::NoProgress) {
            return Err(self.watch.ending(wanted, seen_m, self.params));
        }
        Ok(())
    }

    /// The step to take where `step_m` is wanted: a worsening fault then carries parts less far before it is detected.
    fn cautious(&self, step_m: Vec2) -> Vec2 {
        let length_m = step_m.norm();
        if !self.is_cautious || length_m <= CAUTIOUS_STEP_M {
            return step_m;
        }
        step_m * CAUTIOUS_SHARE.max(CAUTIOUS_STEP_M / length_m)
    }

    /// Notes each part that moves much less far than calibration predicts.
    fn warn_of_slow_parts(&mut self) {
        for part in 0..self.params.parts.len() {
            let (slow, gain) = (Found::about(Finding::PartSlow, part), self.gains.of_part(part));
            let below = if self.findings.holds(slow) { NOT_SLOW } else { SLOW };
            if gain < below {
                let reason =
                    format!("{} is slow: it goes {gain:.2} of the way measured in calibration", self.params.id(part));
                self.warn(slow, reason);
            }
        }
    }

    fn warn(&mut self, found: impl Into<Found>, reason: impl Into<Reason>) {
        self.findings.note(self.io.rig.now(), found, reason, self.io.sink);
    }

    /// The end of the run that a finding causes.
    fn end_by(&mut self, found: impl Into<Found>, reason: impl Into<Reason>) -> RunEnd {
        let (found, reason) = (found.into(), reason.into());
        self.warn(found, reason.clone());
        RunEnd::failed_because(found.finding, reason)
    }

    fn check_stop(&self) -> OrEnd {
        check_stop(self.io.stop)
    }

    /// Captures frames until one at rest shows every part; a part that stays missing is lost.
    fn observe_at_rest(&mut self) -> OrEnd<Vec<Vec2>> {
        loop {
            self.check_stop()?;
            let at_rest = self.perception.observe(self.io, FramePurpose::Cycle)?;
            if at_rest && self.perception.frames_missing() == 0 {
                return Ok(self.perception.positions_m());
            }
            self.check_lost()?;
            if at_rest && self.is_part_lost() {
                // the guard is off: the run goes on from the part's last seen position
                return Ok(self.perception.positions_m());
            }
        }
    }
}
