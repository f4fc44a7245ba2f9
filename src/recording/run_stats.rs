use super::lengths::{Lengths, rounded};
use super::path_stats::PathStats;
use super::report::{AccuracyReport, CycleError, GuardReport, IncidentReport, PredictionError, Report, WorkReport};
use super::timings::Timings;
use upm_control::{CycleFacts, EventFacts, EventKind, FrameFacts, LocalisedFacts, PulseFacts, Sink};
use upm_core::geometry::Vec2;
use upm_core::ground_truth::GroundTruthHandle;
use upm_core::job::Effect;
use upm_core::time::PlateTime;
use upm_core::units::m_from_mm;
use upm_planning::task::Setpoints;

/// Largest time difference between an observation and the truth it is compared with, s: a part at 0.1 m/s moves 0.1 µm.
const SAME_MOMENT_S: f64 = 1e-6;

/// Largest number of reported guards: one that comes and goes is reported each time.
const MOST_GUARDS: usize = 100;

/// Number of tasks whose beginnings are reported: a list of them may be gone through without end.
const MOST_TASKS: usize = 100;

/// Counts events and compares measurements with the truth, where the rig provides it.
#[derive(Debug, Default)]
pub struct RunStats {
    truth: Option<GroundTruthHandle>,
    frames: u64,
    cycles: u64,
    pulses: u64,
    sensing: Lengths,
    sensing_at_rest: Lengths,
    paths: PathStats,
    /// Times at which the tasks of a list began, s, up to [`MOST_TASKS`].
    tasks_from_s: Vec<f64>,
    cycle_errors: Lengths,
    off_library: Lengths,
    off_learning: Lengths,
    guards: Vec<GuardReport>,
    timings: Timings,
}

impl RunStats {
    /// Statistics that compare with `truth`, if given.
    pub fn new(truth: Option<GroundTruthHandle>) -> Self {
        Self { truth, ..Self::default() }
    }

    /// `ending`, which has the facts that a sink cannot know, with all that was counted and measured. It reads the
    /// ground truth now, so call it before the rig goes on.
    pub fn report(&self, ending: Report) -> Report {
        let mut errors = Lengths::default();
        ending.parts.iter().filter_map(|part| part.error_mm).for_each(|error_mm| errors.push(m_from_mm(error_mm)));
        let (cycles, forecasts) = (&self.cycle_errors, self.off_library.rms_mm().zip(self.off_learning.rms_mm()));
        Report {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            work: WorkReport {
                frames: self.frames,
                cycles: self.cycles,
                pulses: self.pulses,
                tasks_from_s: self.tasks_from_s.clone(),
                collisions: self.truth.as_ref().map(|truth| truth.read().collisions),
                ..ending.work
            },
            accuracy: AccuracyReport {
                max_error_mm: errors.max_mm(),
                rms_error_mm: errors.rms_mm(),
                mean_error_mm: errors.mean_mm(),
                cycle_error_mm: cycles.mean_mm().zip(cycles.max_mm()).map(|(mean, max)| CycleError { mean, max }),
                sensing_rms_error_mm: self.sensing.rms_mm(),
                sensing_rms_error_at_rest_mm: self.sensing_at_rest.rms_mm(),
                prediction_error_mm: forecasts.map(|(library, learned)| PredictionError { library, learned }),
            },
            path: self.paths.report(),
            incidents: IncidentReport { guards: self.guards.clone(), ..ending.incidents },
            timing_us: self.timings.report(),
            ..ending
        }
    }
}

impl Sink for RunStats {
    fn localised(&mut self, facts: &LocalisedFacts<'_>) {
        self.timings.localise.push(facts.localise_us);
    }

    fn frame(&mut self, facts: &FrameFacts<'_>) {
        self.frames += 1;
        self.timings.track.push(facts.track_us);
        let at = facts.frame.exposed_at;
        let truth = self.truth.as_ref().map(GroundTruthHandle::read);
        let truth = truth.filter(|truth| (truth.at - at).abs() <= SAME_MOMENT_S);
        for (i, track) in facts.tracks.iter().enumerate().filter(|(_, track)| track.frames_unseen == 0) {
            let seen_m = track.seen.position_m;
            let Some(truth) = &truth else {
                self.paths.frame(at, i, seen_m);
                continue;
            };
            let Some(part) = truth.parts.get(i).filter(|part| part.on_plate) else { continue };
            let true_m = part.part_in_table.position_m;
            self.paths.frame(at, i, true_m);
            let error_m = (seen_m - true_m).norm();
            self.sensing.push(error_m);
            if !facts.driving {
                self.sensing_at_rest.push(error_m);
            }
        }
    }

    fn setpoints(&mut self, at: PlateTime, wanted: &Setpoints) {
        self.paths.setpoints(at, wanted);
        if (self.tasks_from_s.len() + 1..=MOST_TASKS).contains(&wanted.task) {
            self.tasks_from_s.push(rounded(at.secs()));
        }
    }

    fn pulse(&mut self, facts: &PulseFacts) {
        self.pulses += 1;
        let Some(positions) = &facts.positions else { return };
        for (i, after_m) in positions.after_m.iter().enumerate() {
            let off_m = |forecast_m: &[Vec2]| forecast_m.get(i).map_or(0.0, |forecast_m| (after_m - forecast_m).norm());
            self.off_library.push(off_m(&positions.by_library_m));
            self.off_learning.push(off_m(&positions.by_learning_m));
        }
    }

    fn event(&mut self, event: &EventFacts) {
        let EventKind::Finding { found, ended_after: None, reason } = &event.kind else { return };
        if found.finding.effect() != Effect::GoesOn && self.guards.len() < MOST_GUARDS {
            let (code, at_s) = (found.finding.code().to_owned(), rounded(event.at.secs()));
            self.guards.push(GuardReport { code, at_s, text: event.text.clone(), runner_up: reason.runner_up.clone() });
        }
    }

    fn cycle(&mut self, facts: &CycleFacts) {
        self.cycles += 1;
        self.timings.plan.push(facts.plan_us);
        let Timings { plan_new, plan_correction, .. } = &mut self.timings;
        if facts.plan.continues { plan_correction } else { plan_new }.push(facts.plan_us);
        self.timings.cycle.push(facts.cycle_us);
        if !facts.ends_at_rest {
            // a part that moves is not meant to be at the subgoal of its segment
            return;
        }
        let mut off = Lengths::default();
        let steps = facts.result_m.iter().zip(&facts.wanted.subgoals_m);
        steps.for_each(|(at_m, subgoal_m)| off.push((at_m - subgoal_m).norm()));
        off.mean_m().into_iter().for_each(|error_m| self.cycle_errors.push(error_m));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::PartReport;
    use upm_fixtures::synthetic_run::SyntheticRun;

    fn ending(parts: Vec<PartReport>) -> Report {
        Report { name: "test".into(), seed: 7, parts, ..Report::default() }
    }

    fn part(target_m: Option<Vec2>, measured_m: Vec2) -> PartReport {
        PartReport::of("penny-1", "penny", target_m, Some(measured_m), None)
    }

    #[test]
    fn counts_and_figures() {
        let mut stats = RunStats::new(None);
        let mut run = SyntheticRun::new(2);
        run.wall_us = 50.0;
        run.localise(&mut stats);
        run.ends_at_rest = false;
        run.cycle(&mut stats);
        assert_eq!(stats.cycle_errors.mean_mm(), None, "moving parts have no subgoal to be at");
        run.ends_at_rest = true;
        (0..3).for_each(|_| run.cycle(&mut stats));
        let target = Some(Vec2::zeros());
        let parts =
            vec![part(target, Vec2::new(0.0003, 0.0004)), part(target, Vec2::zeros()), part(None, Vec2::zeros())];
        let report = stats.report(ending(parts));
        let WorkReport { cycles, pulses, frames, collisions, .. } = report.work;
        assert_eq!((cycles, pulses, frames), (4, run.pulses_played, run.frames_taken));
        assert_eq!(
            (report.accuracy.max_error_mm, report.accuracy.rms_error_mm, report.accuracy.mean_error_mm),
            (Some(0.5), Some(0.3536), Some(0.25))
        );
        let CycleError { mean, max } = report.accuracy.cycle_error_mm.unwrap();
        assert!(0.0 < mean && mean <= max, "{mean} {max}");
        assert_eq!((collisions, report.accuracy.sensing_rms_error_mm), (None, None));
        assert_eq!(report.parts[2].error_mm, None);
        assert_eq!(report.timing_us.track.max, 50.0);
    }

    #[test]
    fn measured_positions_are_compared_with_the_truth() {
        let mut run = SyntheticRun::new(2);
        run.sensing_offset_m = Vec2::new(3e-5, 4e-5);
        let mut stats = RunStats::new(Some(run.truth.clone()));
        (0..3).for_each(|_| run.cycle(&mut stats));
        let at_m = Some(run.parts_m[0]);
        let report = stats.report(ending(vec![PartReport::of("penny-1", "penny", at_m, Some(Vec2::zeros()), at_m)]));
        assert_eq!(report.accuracy.sensing_rms_error_mm, Some(0.05));
        assert_eq!(report.accuracy.sensing_rms_error_at_rest_mm, Some(0.05));
        let measured = (report.accuracy.max_error_mm, report.work.collisions);
        assert_eq!(measured, (Some(0.0), Some(0)), "truth, not measurement, counts");
    }
}
