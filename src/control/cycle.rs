mod end;
mod play;
mod probe;

use std::ops::ControlFlow::{Break, Continue};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::condition::{Condition, why_not};
use super::conditions::Conditions;
use super::ending::{Ending, Flow, check_stop};
use super::eyes::{Eyes, Moment};
use super::guards::{CoilResponses, MotionGuard, StepGuard};
use super::params::ControlParams;
use super::planning::{Planning, STALLED_S};
use super::plans::FreshPlanner;
use super::{CycleFacts, EventLevel, Milestone, MilestoneFacts, Sink};
use upm_core::geometry::Vec2;
use upm_core::job::{Outcome, StopCause};
use upm_core::rig::{Rig, RigModel};
use upm_core::time::{Clock, PlateTime};
use upm_goal::{Goal, Wanted};
use upm_library::Library;
use upm_planner::Plan;

/// Share of the wanted steps that is taken while coils or accelerometers are in doubt, and the length that steps keep, m.
const CAUTIOUS_SHARE: f64 = 0.5;
const CAUTIOUS_STEP_M: f64 = 2e-3;

/// A part that goes less than this part of the way the library has it is slow, and no longer slow from the second on.
const SLOW: f64 = 0.7;
const NOT_SLOW: f64 = 0.75;

/// What a run plays on and tells to.
pub struct Devices<'a> {
    /// The plate.
    pub rig: &'a mut dyn Rig,
    /// What is known of it.
    pub model: &'a RigModel,
    /// Takes the facts.
    pub sink: &'a mut dyn Sink,
    /// For timings only.
    pub clock: &'a dyn Clock,
    /// Set from outside to stop.
    pub stop: &'a AtomicBool,
    /// Set from outside to end the run between two cycles.
    pub give_way: &'a AtomicBool,
}

/// How a run ended and where things stood then.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Finish {
    /// How and why.
    pub ending: Ending,
    /// What the goal last wanted; `None` when it was never asked.
    pub wanted: Option<Wanted>,
    /// Where the parts were last seen, m; empty when they never were.
    pub measured_m: Vec<Vec2>,
    /// Indices of the parts that are lost.
    pub lost: Vec<usize>,
}

/// Runs `goal` to its end. Motors are at zero when this returns, whatever happened.
pub fn run(devices: Devices<'_>, library: &Arc<Library>, goal: &mut dyn Goal, params: &ControlParams) -> Finish {
    let Devices { rig, model, sink, clock, stop, give_way } = devices;
    let mut open = || {
        let planner = match FreshPlanner::new(params.method, library, params.planner).plans() {
            Ok(planner) => planner,
            Err(ending) => return Break(ending),
        };
        let guards = params.guards.clone();
        Continue((planner, Eyes::open(rig, model, &params.kinds, &params.parts, guards, sink, clock, stop)?))
    };
    let finish = match open() {
        Continue((planner, eyes)) => {
            let mut cycle = Cycle {
                rig: &mut *rig,
                model,
                sink: &mut *sink,
                clock,
                stop,
                give_way,
                library,
                goal,
                params,
                eyes,
                planning: Planning::new(params, library, planner, 0.5 * model.plate_side_m),
                conditions: Conditions::default(),
                played: false,
                wanted: None,
                furthest: 0.0,
                index: 0,
                coil_responses: CoilResponses::new(library),
                motion: MotionGuard::default(),
                steps: StepGuard::default(),
                unconfirmed: 0,
                is_cautious: false,
            };
            cycle.until_end()
        }
        Break(ending) => Finish { ending, ..Finish::default() },
    };
    rig.stop();
    let level = if finish.ending.outcome == Outcome::Failed { EventLevel::Error } else { EventLevel::Info };
    let Ending { outcome, cause, reason } = &finish.ending;
    let milestone = Milestone::RunEnded { outcome: *outcome, cause: *cause };
    sink.milestone(&MilestoneFacts { at: rig.now(), level, milestone, text: reason });
    finish
}

struct Cycle<'a> {
    rig: &'a mut dyn Rig,
    model: &'a RigModel,
    sink: &'a mut dyn Sink,
    clock: &'a dyn Clock,
    stop: &'a AtomicBool,
    give_way: &'a AtomicBool,
    library: &'a Arc<Library>,
    goal: &'a mut dyn Goal,
    params: &'a ControlParams,
    eyes: Eyes,
    planning: Planning<'a>,
    conditions: Conditions,
    /// True when the last cycle had pulses and began something: the rest of a sequence may lead away before it leads near.
    played: bool,
    wanted: Option<Wanted>,
    /// Progress when a cycle without a pulse last got further.
    furthest: f64,
    index: u64,
    coil_responses: CoilResponses,
    motion: MotionGuard,
    steps: StepGuard,
    /// Times the goal seemed reached and a second look said no.
    unconfirmed: u32,
    /// True once a fault of a coil or an accelerometer was found that the run bears: steps are shorter from then on.
    is_cautious: bool,
}

impl Cycle<'_> {
    fn until_end(&mut self) -> Finish {
        let mut last_pulse_at = self.rig.now();
        self.goal.first_seen(&self.eyes.positions_m());
        let mut look = self.look_at_rest();
        let ending = loop {
            look = match look {
                // here the last cycle is over, its parts seen at rest
                Continue(_) if self.give_way.load(Ordering::Relaxed) => {
                    break Ending::gave_way(self.params.endless && self.is_getting_on());
                }
                Continue(observed) => self.once(observed, &mut last_pulse_at),
                Break(ending) => break ending,
            };
        };
        // a stopped run ends in the middle: its repetition goes on, and tells of no end there
        if !ending.is_external() {
            self.conditions.end_run(self.rig.now(), self.sink);
            self.eyes.end_run(self.rig.now(), self.sink);
        }
        let lost = if self.is_part_lost() { self.eyes.unseen() } else { Vec::new() };
        Finish { ending, wanted: self.wanted.take(), measured_m: self.eyes.positions_m(), lost }
    }

    /// One cycle from a look at rest to the next, whose positions it returns.
    fn once(&mut self, observed: Vec<Vec2>, last_pulse_at: &mut PlateTime) -> Flow<Vec<Vec2>> {
        if self.eyes.take_relocated() {
            // a mirrored or late picture may look like a knock: the probe tells them apart
            self.check_limits()?;
            self.probe()?;
            return self.look_at_rest();
        }
        let started = self.clock.elapsed();
        let observed_at = self.eyes.seen_at();
        let wanted = self.goal.next(observed_at, &observed);
        let is_first = self.wanted.replace(wanted.clone()).is_none();
        if wanted.done {
            return self.finish(wanted.phase);
        }
        if is_first {
            self.planning.check_controllable(&observed, &wanted)?;
            self.check_limits()?;
            self.probe()?;
            return self.look_at_rest();
        }
        self.warn_of_blocked(&wanted.boxed_in);
        self.check_limits()?;
        if self.planning.watch.look(&wanted, &observed, self.played) && self.params.guards.has_code("no_progress") {
            return Break(self.planning.no_progress(&wanted, &observed));
        }
        let planning = self.clock.elapsed();
        let plan = self.plan(&observed, &wanted)?;
        let plan_us = (self.clock.elapsed() - planning).as_secs_f64() * 1e6;
        self.conditions.end_cycle(self.rig.now(), self.sink);
        self.eyes.end_cycle(self.rig.now(), self.sink);
        self.played = !plan.pulses.is_empty() && !plan.continues;

        for (number, pulse) in (1..).zip(&plan.pulses) {
            self.check_limits()?;
            self.play(pulse, if number == plan.pulses.len() { Moment::Cycle } else { Moment::Pulse })?;
            *last_pulse_at = self.rig.now();
            self.look_for_missing()?;
            if self.eyes.invalidates_plan() {
                break;
            }
        }
        // the last frame of a pulse shows all at rest: it starts the next cycle, unless a part is missing in it
        let seen = !plan.pulses.is_empty() && self.eyes.missing_for() == 0;
        let result = if seen { self.eyes.positions_m() } else { self.look_at_rest()? };
        if plan.pulses.is_empty() {
            // a goal that gets on by time alone asks for no pulse
            if wanted.progress > self.furthest {
                (self.furthest, *last_pulse_at) = (wanted.progress, self.rig.now());
            }
            if self.rig.now() - *last_pulse_at > STALLED_S {
                let held_up = self.planning.held_up(&wanted, &result);
                let reason = format!("stalled: no pulse for {STALLED_S} s of plate time; {held_up}");
                return Break(Ending::failed_because(StopCause::NoProgress, reason));
            }
            return Continue(result);
        }
        let cycle_us = (self.clock.elapsed() - started).as_secs_f64() * 1e6;
        self.sink.cycle(&CycleFacts {
            index: self.index,
            observed_at,
            observed_m: &observed,
            wanted: &wanted,
            plan: &plan,
            ended_at: self.eyes.seen_at(),
            result_m: &result,
            plan_us,
            cycle_us,
        });
        self.index += 1;
        Continue(result)
    }

    /// Plans the wanted steps, or what of them can be made.
    fn plan(&mut self, observed: &[Vec2], wanted: &Wanted) -> Flow<Plan> {
        self.check_stop()?;
        let whole = self.planning.states(observed, wanted, |step_m| self.cautious(step_m));
        let Self { planning, conditions, rig, sink, stop, params, .. } = self;
        planning.plan(self.index, wanted, &whole, |plan, is_part| {
            if let Some(condition) = Condition::of_plan(&plan.status).filter(|_| !is_part) {
                let reason = || {
                    let why = why_not(&plan.status, params.method, |part| params.id(part));
                    format!("steps are cut short or made one part at a time, because {why}")
                };
                conditions.note(rig.now(), condition, reason, *sink);
            }
            check_stop(stop)
        })
    }

    /// The step to take where `step_m` is wanted: a fault that grows worse carries parts less far before it is seen.
    fn cautious(&self, step_m: Vec2) -> Vec2 {
        let length_m = step_m.norm();
        if !self.is_cautious || length_m <= CAUTIOUS_STEP_M {
            return step_m;
        }
        step_m * CAUTIOUS_SHARE.max(CAUTIOUS_STEP_M / length_m)
    }

    /// Notes the parts that no way leads to their targets.
    fn warn_of_blocked(&mut self, blocked: &[usize]) {
        for &part in blocked {
            let reason = format!("{} is boxed in: no way to its target is free", self.params.id(part));
            self.warn(Condition::PartBlocked { part }, reason);
        }
    }

    /// Notes each part that goes much less far than calibration has it.
    fn tell_slow_parts(&mut self) {
        for part in 0..self.params.parts.len() {
            let (condition, gain) = (Condition::PartSlow { part }, self.planning.gains.of_part(part));
            let below = if self.conditions.holds(condition) { NOT_SLOW } else { SLOW };
            if gain < below {
                let reason =
                    format!("{} is slow: it goes {gain:.2} of the way measured in calibration", self.params.id(part));
                self.warn(condition, reason);
            }
        }
    }

    fn warn(&mut self, condition: Condition, reason: String) {
        self.conditions.note(self.rig.now(), condition, || reason, self.sink);
    }

    fn check_stop(&self) -> Flow {
        check_stop(self.stop)
    }

    /// Nothing more is played while a part that was not seen for long may be lost.
    fn look_for_missing(&mut self) -> Flow {
        if self.eyes.missing_for() > self.params.lost_after_frames && !self.eyes.silenced_pulse() {
            self.look_at_rest()?;
        }
        Continue(())
    }

    /// Looks until a frame taken at rest shows every part; a part that stays away is lost.
    fn look_at_rest(&mut self) -> Flow<Vec<Vec2>> {
        loop {
            self.check_stop()?;
            let at_rest = self.eyes.look(self.rig, Moment::Cycle, self.sink, self.clock)?;
            if at_rest && self.eyes.missing_for() == 0 {
                return Continue(self.eyes.positions_m());
            }
            self.check_lost()?;
            if at_rest && self.is_part_lost() {
                // the guard sleeps: the run goes on from where the part was last seen
                return Continue(self.eyes.positions_m());
            }
        }
    }
}
