//! Motions without pauses: from rest, segment after segment, until the parts rest again.

use std::sync::atomic::Ordering;

use super::ControlCycle;
use super::play::drive_of;
use crate::found::Found;
use crate::guards::PlateSwing;
use crate::perception::FramePurpose;
use crate::progress::{ProgressWatch, farthest_m};
use crate::pulse_planner::PulsePlanner;
use crate::run_end::{OrEnd, RunEnd, is_stopped};
use crate::{CycleFacts, PulseFacts, PulsePositions};
use upm_core::geometry::Vec2;
use upm_core::job::Finding;
use upm_core::rig::RigError;
use upm_core::signal::{AccelTrace, Drive};
use upm_core::time::PlateTime;
use upm_core::units::mm_from_m;
use upm_perception::estimation::{ExpectedMotion, FitError, MotionJudgement, PlateFit, TakeOver, judge};
use upm_planning::cor_library::CoilResponse;
use upm_planning::planner::{FieldPlanner, Heading, MovingPlanner, Plan, PlanStatus, PlannedPulse, Segment};
use upm_planning::task::Setpoints;

/// Segments that count as one cycle for the watch of a run's progress: as long as a pulse from rest with its rest.
const SEGMENTS_A_CYCLE: u64 = 5;

/// So many times as far from their targets as when motions stalled, parts have new ones.
const FAR: f64 = 2.0;

/// Segments from one recorded picture to the next: five pictures a second, as many as pulses from rest have at most.
const SHOWN_EVERY: u64 = 3;
/// Frames without a part after which the plate comes to rest: it may have been carried under something, or over the
/// edge.
const UNSEEN_FRAMES: u32 = 6;

/// A segment with its drive and what it was planned for.
struct PlannedSegment {
    segment: Segment,
    drive: Drive,
    wanted: Setpoints,
    plan_us: f64,
}

impl ControlCycle<'_, '_> {
    /// The planner of motions without pauses; `None` where the run has another.
    pub(super) fn moving(&mut self) -> Option<&mut MovingPlanner> {
        match &mut self.planner {
            PulsePlanner::Moving(planner) => Some(planner),
            _ => None,
        }
    }

    /// Moves the parts, which rest at `observed`, without a pause until they rest again; returns where they do. `None`
    /// where the run has another planner.
    pub(super) fn move_on(&mut self, observed: &[Vec2], wanted: Setpoints) -> Option<OrEnd<Vec<Vec2>>> {
        self.moving()?.rest(observed);
        Some(self.move_until_rest(wanted))
    }

    /// Plays pulses from rest where motions without pauses bring the parts no nearer, which they then do; motions come
    /// back once the parts have arrived or have a long way to go again.
    pub(super) fn change_planner(&mut self, wanted: &Setpoints, observed: &[Vec2]) {
        let farthest_m = farthest_m(observed, &wanted.targets_m);
        let is_over = |of_stall_m: f64| wanted.asks_nothing(observed) || farthest_m > FAR * of_stall_m;
        if let Some((planner, _)) = self.stalled.take_if(|(_, of_stall_m)| is_over(*of_stall_m)) {
            self.planner = planner;
        } else if self.moving().is_some() && self.watch.stalls() {
            let fields = FieldPlanner::new(self.library, self.params.planner).map(PulsePlanner::Fields);
            let Some(fields) = fields else { return };
            self.stalled = Some((std::mem::replace(&mut self.planner, fields), farthest_m));
        } else {
            return;
        }
        let params = self.params;
        self.watch = ProgressWatch::new(params.follows_paths, params.tolerance_m);
        self.limits = params.guards.limits(params.parts.len(), self.stalled.is_some());
    }

    fn move_until_rest(&mut self, wanted: Setpoints) -> OrEnd<Vec<Vec2>> {
        let Some(coils) = self.library.segment_coils() else {
            return Err(RunEnd::failed("the library has no response to segments"));
        };
        let mut present = self.plan_segment(wanted)?;
        let (mut started_at, mut fading, mut segments) = (self.io.rig.now(), None, 0);
        self.perception.expect_pulse(started_at, None, Some(self.swing_after(&present, None)));
        self.io.rig.play(&present.drive)?;
        loop {
            let _span = tracing::trace_span!("cycle", index = self.index).entered();
            self.moving().into_iter().for_each(MovingPlanner::begin);
            let started = self.io.clock.elapsed();
            let (observed_at, before_m) = (self.perception.seen_at(), self.of_moving(|planner| planner.places_m()));
            let sets_down = present.segment.sets_down;
            let next = if sets_down { None } else { self.plan_next(started_at, segments)? };
            let (next, ends_at) = self.take_over(next, started_at)?;
            if let Some(next) = &next {
                let swing = self.swing_after(next, Some(&present));
                self.perception.delay.expect_next(ends_at.secs(), swing);
            }
            let forecast_m = match &next {
                _ if sets_down => present.segment.ends_m.clone(),
                Some(_) => self.of_moving(|planner| planner.next_places_m()),
                None => self.of_moving(|planner| planner.fades_out()).0,
            };
            let followed = self.follow_segment(started_at, next.as_ref().map(|_| ends_at), &forecast_m);
            let is_over = next.is_none() || self.perception.motors_stopped;
            let after_m =
                if is_over { self.perception.positions_m() } else { self.of_moving(|planner| planner.places_m()) };
            let steps =
                PulsePositions { before_m, after_m, by_library_m: forecast_m.clone(), by_learning_m: forecast_m };
            let trace = self.trace_until(ends_at, next.as_ref());
            let (facts, judged) = self.read_segment(&present, (started_at, trace), (fading.take(), &coils), &steps);
            if !is_stopped(&followed) {
                self.io.sink.pulse(&facts);
            }
            followed?;
            let cycle_us = (self.io.clock.elapsed() - started).as_secs_f64() * 1e6;
            self.end_cycle(present, observed_at, steps, cycle_us);
            segments += 1;
            if !self.perception.motors_stopped {
                self.doubt_segment(&facts, judged)?;
            }
            match next {
                Some(next) if !is_over => {
                    self.perception.delay.begin_next();
                    (present, started_at, fading) = (next, ends_at, Some(facts.drive));
                }
                _ => break,
            }
        }
        let is_seen = !self.perception.invalidates_plan() && self.perception.frames_missing() == 0;
        let places_m = if is_seen { self.perception.positions_m() } else { self.observe_at_rest()? };
        self.suspects_knock &= !self.perception.relocated;
        Ok(places_m)
    }

    /// Lets `next` take over from the segment that began at `started_at`; returns it and the time when it begins. Where
    /// it comes too late, the present motion fades out as if there were no next one, and rests at that time.
    fn take_over(
        &mut self,
        next: Option<PlannedSegment>,
        started_at: PlateTime,
    ) -> OrEnd<(Option<PlannedSegment>, PlateTime)> {
        let taken = next.map(|next| (self.io.rig.take_over(&next.drive), next));
        let Some((begins_at, next)) = taken.filter(|(begins_at, _)| *begins_at != Err(RigError::TooLate)) else {
            return Ok((None, self.io.rig.settled_at()));
        };
        let begins_at = begins_at?;
        self.moving().into_iter().for_each(|planner| planner.plays_for(begins_at.secs_since(started_at)));
        Ok((Some(next), begins_at))
    }

    /// The trace of the segment from which `next` took over at `ends_at`. It has no samples where so many frames were
    /// lost that `next` has risen meanwhile: the rig then shows that one's.
    fn trace_until(&self, ends_at: PlateTime, next: Option<&PlannedSegment>) -> AccelTrace {
        let (trace, since_s) = (self.io.rig.trace(), self.io.rig.now().secs_since(ends_at));
        let sample_s = trace.sample_hz.recip();
        let has_risen = next.is_some_and(|next| since_s + sample_s >= next.drive.envelope.attack_s);
        if has_risen { AccelTrace { counts: Default::default(), ..trace } } else { trace }
    }

    /// The facts of a segment that began at `started_at` and in which the parts went as in `steps`, and the judgement
    /// of its trace; the drive `fading` was playing before.
    fn read_segment(
        &self,
        present: &PlannedSegment,
        (started_at, trace): (PlateTime, AccelTrace),
        (fading, coils): (Option<Drive>, &CoilResponse),
        steps: &PulsePositions,
    ) -> (PulseFacts, Option<MotionJudgement>) {
        let (drive, sensors) = (present.drive.clone(), self.sensors());
        let take_over = TakeOver::new(&trace, fading, &drive);
        let expected = |take_over| ExpectedMotion { take_over: Some(take_over), ..self.expected(&drive, coils) };
        let fit = take_over.as_ref().map_err(FitError::clone);
        let fit = fit.and_then(|t| expected(t).fit_take_over(&trace, &sensors)).map(PlateFit::Wave);
        let judged = take_over.iter().next().map(|t| judge(&expected(t), fit.as_ref(), &sensors));
        let facts = PulseFacts {
            cycle: self.index,
            started_at,
            planned: PlannedPulse::Field(present.segment.pulse.clone()),
            is_probe: false,
            drive,
            trace,
            fit,
            positions: (self.perception.frames_missing() == 0).then(|| steps.clone()),
        };
        (facts, judged)
    }

    /// Reports a segment as a cycle of its own.
    fn end_cycle(&mut self, present: PlannedSegment, observed_at: PlateTime, steps: PulsePositions, cycle_us: f64) {
        let PlannedSegment { segment, wanted, plan_us, .. } = present;
        let plan = Plan {
            status: PlanStatus::Solved,
            pulses: vec![PlannedPulse::Field(segment.pulse)],
            predicted_m: vec![segment.ends_m],
            ..Plan::default()
        };
        self.io.sink.cycle(&CycleFacts {
            index: self.index,
            observed_at,
            observed_m: steps.before_m,
            wanted,
            plan,
            ended_at: self.perception.seen_at(),
            result_m: steps.after_m,
            ends_at_rest: false,
            plan_us,
            cycle_us,
        });
        self.index += 1;
    }

    /// Plans the segment after the present one, for the places that the parts will have at its end; `None` where the
    /// plate should come to rest because another job waits, once the present motion fades out clear, or a part is out
    /// of sight, or because the parts will be where they should be.
    fn plan_next(&mut self, started_at: PlateTime, segments: u64) -> OrEnd<Option<PlannedSegment>> {
        self.check_limits()?;
        let wants_rest = self.io.give_way.load(Ordering::Relaxed) || self.watch.stalls();
        let gives_way = wants_rest && self.of_moving(|planner| planner.fades_out()).1;
        if gives_way || self.perception.frames_missing() > UNSEEN_FRAMES {
            return Ok(None);
        }
        let Some(planner) = self.moving() else { return Ok(None) };
        let (at, places_m) = (started_at + planner.period_s(), planner.next_places_m());
        let mut wanted = self.task.next(at, &places_m);
        self.io.sink.setpoints(at, &wanted);
        if wanted.asks_nothing(&places_m) {
            if let (ends_m, true) = self.of_moving(|planner| planner.fades_out())
                && self.task.next(at, &ends_m).asks_nothing(&ends_m)
            {
                return Ok(None);
            }
            wanted.targets_m.clone_from(&wanted.subgoals_m);
        }
        if segments.is_multiple_of(SEGMENTS_A_CYCLE) {
            self.warn_of_hindrances(&wanted, &places_m);
            self.warn_of_corridors(&wanted);
            self.check_progress(&wanted, &places_m, true)?;
        }
        self.plan_segment(wanted).map(Some)
    }

    fn warn_of_corridors(&mut self, wanted: &Setpoints) {
        for (part, (stretch, off_m)) in wanted.paths.iter().zip(&wanted.cross_track_m).enumerate() {
            let by_m = stretch.as_ref().map_or(0.0, |stretch| off_m - stretch.corridor_m);
            if by_m > 0.0 {
                let reason = format!("{} leaves its corridor by {:.2} mm", self.params.id(part), mm_from_m(by_m));
                self.warn(Found::about(Finding::CorridorLeft, part), reason);
            }
        }
    }

    fn plan_segment(&mut self, wanted: Setpoints) -> OrEnd<PlannedSegment> {
        let _span = tracing::trace_span!("plan").entered();
        self.check_stop()?;
        let planning = self.io.clock.elapsed();
        let Some(planner) = self.moving() else { return Err(RunEnd::failed("no planner of moving parts")) };
        let segment = planner.plan(&headings(planner, &wanted));
        let plan_us = (self.io.clock.elapsed() - planning).as_secs_f64() * 1e6;
        let drive = drive_of(self.library, &PlannedPulse::Field(segment.pulse.clone()))?;
        Ok(PlannedSegment { segment, drive, wanted, plan_us })
    }

    fn of_moving<T: Default>(&mut self, of: impl FnOnce(&mut MovingPlanner) -> T) -> T {
        self.moving().map(of).unwrap_or_default()
    }

    /// Follows the parts in a segment that began at `started_at` until the next one begins, or, for the last one, until
    /// a frame shows everything at rest.
    fn follow_segment(&mut self, started_at: PlateTime, until: Option<PlateTime>, forecast_m: &[Vec2]) -> OrEnd {
        let _span = tracing::trace_span!("play").entered();
        let Some(until) = until else {
            self.perception.expect_places(forecast_m);
            return self.follow(FramePurpose::Cycle);
        };
        let is_shown = self.index.is_multiple_of(SHOWN_EVERY);
        let mut purpose = if is_shown { FramePurpose::Segment } else { FramePurpose::Moving };
        while self.io.rig.now() < until && !self.perception.motors_stopped {
            self.perception.observe(self.io, std::mem::replace(&mut purpose, FramePurpose::Moving))?;
            self.check_stop()?;
            self.check_lost()?;
            if 2 * self.perception.frames_missing_in_clear_view() > self.params.lost_after_frames {
                self.perception.stop_motors(self.io.rig);
            }
            let (at_s, seen_m) = (self.perception.seen_at().secs_since(started_at), self.perception.seen_m());
            self.moving().into_iter().for_each(|planner| planner.observe(at_s, &seen_m));
            if self.may_be_knocked() || self.perception.suspects_foreign() {
                self.perception.stop_motors(self.io.rig);
            }
        }
        Ok(())
    }

    /// True where the plate's place shows, for the first time, that camera or plate may have been knocked. A look at
    /// rest decides.
    fn may_be_knocked(&mut self) -> bool {
        let is_watched = !self.suspects_knock && self.params.guards.has(Finding::CameraMoved);
        self.suspects_knock |= is_watched && self.perception.sees_knock(self.io.sink);
        is_watched && self.suspects_knock
    }

    /// Compares a segment with its plan: the plate's motion, the pictures' timing, the parts' steps.
    fn doubt_segment(&mut self, facts: &PulseFacts, judged: Option<MotionJudgement>) -> OrEnd {
        // parts coast on for a segment whatever the plate does: they are no witnesses of it
        let is_as_planned = self.check_motion(judged, None)?;
        self.check_frozen(is_as_planned)?;
        self.check_picture_delay(is_as_planned)?;
        let (reached_s, left_s) = self.moving().map_or((0.0, 0.0), |planner| (planner.reached_s(), planner.left_s()));
        // in late pictures, and in those of a segment's first half alone, parts lag behind as if they stuck
        let shows_steps = left_s <= reached_s && !self.perception.delay.is_doubted();
        let positions = facts.positions.as_ref().filter(|_| shows_steps);
        let swayed_m = |place_m: &Vec2| {
            let at_m = |s: f64| self.perception.delay.sway_m(facts.started_at.secs() + s, *place_m);
            at_m(reached_s) - at_m(0.0)
        };
        let swayed_m: Vec<Vec2> = positions.iter().flat_map(|p| p.before_m.iter().map(swayed_m)).collect();
        let stuck = positions.and_then(|positions| self.steps.check(positions, &swayed_m, self.limits.steps_limit));
        self.report_step(stuck)
    }

    /// Swing of the plate while `next` takes over from `last`.
    fn swing_after(&self, next: &PlannedSegment, last: Option<&PlannedSegment>) -> PlateSwing {
        let fades = last.map(|last| last.segment.pulse.wave.clone()).unwrap_or_default();
        self.swing_of(next.segment.pulse.wave.clone(), next.drive.envelope, Some(fades))
    }
}

/// Where each part is heading: to the place that its reference on its path will have, or to its target.
fn headings(planner: &MovingPlanner, wanted: &Setpoints) -> Vec<Heading> {
    let places = wanted.subgoals_m.iter().zip(&wanted.targets_m).enumerate();
    let heading = |(part, (&subgoal_m, &target_m)): (usize, (&Vec2, &Vec2))| match wanted.paths.get(part) {
        Some(Some(stretch)) => {
            let (place_m, velocity_mps) = stretch.reference_in(planner.ahead_s(), planner.period_s());
            // at the end of its path, rounding aside, it comes to rest
            let along_mps = Some(velocity_mps).filter(|velocity_mps| velocity_mps.norm() > 1e-3 * stretch.speed_mps);
            Heading { target_m: place_m, subgoal_m: place_m, along_mps }
        }
        _ => Heading { target_m, subgoal_m, along_mps: None },
    };
    places.map(heading).collect()
}
