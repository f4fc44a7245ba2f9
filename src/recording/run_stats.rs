use std::time::Duration;

use super::lengths::{Lengths, mm, point_mm, rounded};
use super::path_stats::PathStats;
use super::report::{
    CycleError, FaultReport, GuardReport, PartReport, PlannerReport, PredictionError, Report, StopReport,
};
use super::timings::Timings;
use upm_control::{ConditionChange, ConditionFacts, CycleFacts, FrameFacts, LocalisedFacts, PulseFacts, Sink};
use upm_core::geometry::Vec2;
use upm_core::ground_truth::GroundTruthHandle;
use upm_core::job::{CameraMode, Outcome, StopCause};
use upm_core::time::PlateTime;
use upm_task::Setpoints;

/// Largest time difference between an observation and the truth it is compared with, s: a part at 0.1 m/s moves 0.1 µm.
const SAME_MOMENT_S: f64 = 1e-6;

/// Largest number of reported guards: one that comes and goes is reported each time.
const MOST_GUARDS: usize = 100;

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
    cycle_errors: Lengths,
    off_library: Lengths,
    off_learning: Lengths,
    guards: Vec<GuardReport>,
    timings: Timings,
}

/// Facts about the end of a run that a sink cannot know.
#[derive(Clone, Debug, Default)]
pub struct EndFacts {
    /// Name of the job.
    pub name: String,
    /// Seed of all random numbers of the run.
    pub seed: u64,
    /// What its camera delivered.
    pub camera: CameraMode,
    /// Its planner and the reason; `None` where that is unknown.
    pub planner: Option<PlannerReport>,
    /// Completed, failed or cancelled.
    pub outcome: Outcome,
    /// The reason, for people.
    pub reason: String,
    /// The cause that ended it; `None` where the outcome says it all.
    pub cause: Option<StopCause>,
    /// Plate time at the end.
    pub plate_time: PlateTime,
    /// Duration of the run by the computer's clock, s.
    pub wall_time_s: f64,
    /// Missed deadlines; `None` where plate time did not keep to the clock.
    pub deadlines: Option<Deadlines>,
    /// Number of completed laps.
    pub laps: u32,
    /// Number of lost parts.
    pub lost_parts: usize,
    /// Every part, in the order of the job.
    pub parts: Vec<PartEnd>,
    /// Faults of the rig that began within the run.
    pub faults: Vec<FaultReport>,
}

/// Deadlines of a run in real time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Deadlines {
    /// Number of missed deadlines.
    pub misses: u64,
    /// Largest lateness, whole frames.
    pub worst_frames: u64,
    /// Total lag of plate time behind the clock.
    pub behind: Duration,
}

/// State of one part at the end, as known to control.
#[derive(Clone, Debug)]
pub struct PartEnd {
    /// Name in this run.
    pub id: String,
    /// Name of its kind; empty if unknown.
    pub kind: String,
    /// Last place that the task asked for, m; `None` without one.
    pub target_m: Option<Vec2>,
    /// Last seen position, m.
    pub measured_m: Option<Vec2>,
}

impl RunStats {
    /// Statistics that compare with `truth`, if given.
    pub fn new(truth: Option<GroundTruthHandle>) -> Self {
        Self { truth, ..Self::default() }
    }

    /// Number of pulses played so far.
    pub fn pulses(&self) -> u64 {
        self.pulses
    }

    /// Wall times so far.
    pub fn timings(&self) -> &Timings {
        &self.timings
    }

    /// The whole report. It reads the ground truth now, so call it before the rig goes on.
    pub fn report(&self, ending: EndFacts) -> Report {
        let truth = self.truth.as_ref().map(GroundTruthHandle::read);
        let mut errors = Lengths::default();
        let mut parts = Vec::with_capacity(ending.parts.len());
        for (i, part) in ending.parts.into_iter().enumerate() {
            let true_m = truth.as_ref().and_then(|truth| truth.parts.get(i)).map(|p| p.part_in_table.position_m);
            let error_m = true_m.or(part.measured_m).zip(part.target_m).map(|(at, target)| (at - target).norm());
            error_m.into_iter().for_each(|error_m| errors.push(error_m));
            parts.push(PartReport {
                id: part.id,
                kind: part.kind,
                target_mm: part.target_m.map(point_mm),
                measured_mm: part.measured_m.map(point_mm),
                true_mm: true_m.map(point_mm),
                error_mm: error_m.map(mm),
            });
        }
        Report {
            verdict: None,
            guards: self.guards.clone(),
            faults: ending.faults,
            name: ending.name,
            seed: ending.seed,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            camera: ending.camera,
            planner: ending.planner,
            outcome: ending.outcome,
            stop: ending.cause.map(|cause| StopReport::of(cause, &ending.reason)),
            reason: ending.reason,
            plate_time_s: rounded(ending.plate_time.secs()),
            wall_time_s: rounded(ending.wall_time_s),
            frames: self.frames,
            cycles: self.cycles,
            pulses: self.pulses,
            laps: ending.laps,
            collisions: truth.map(|truth| truth.collisions),
            lost_parts: ending.lost_parts,
            deadline_misses: ending.deadlines.map(|deadlines| deadlines.misses),
            worst_late_frames: ending.deadlines.map(|deadlines| deadlines.worst_frames),
            behind_s: ending.deadlines.map(|deadlines| rounded(deadlines.behind.as_secs_f64())),
            max_error_mm: errors.max_mm(),
            rms_error_mm: errors.rms_mm(),
            mean_error_mm: errors.mean_mm(),
            cycle_error_mm: self
                .cycle_errors
                .mean_mm()
                .zip(self.cycle_errors.max_mm())
                .map(|(mean, max)| CycleError { mean, max }),
            sensing_rms_error_mm: self.sensing.rms_mm(),
            sensing_rms_error_at_rest_mm: self.sensing_at_rest.rms_mm(),
            path: self.paths.report(),
            prediction_error_mm: self
                .off_library
                .rms_mm()
                .zip(self.off_learning.rms_mm())
                .map(|(library, learned)| PredictionError { library, learned }),
            parts,
            timing_us: self.timings.report(),
            recording: None,
            warnings: Vec::new(),
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
    }

    fn pulse(&mut self, facts: &PulseFacts<'_>) {
        self.pulses += 1;
        let Some(positions) = facts.positions else { return };
        for (i, after_m) in positions.after_m.iter().enumerate() {
            let off_m = |forecast_m: &[Vec2]| forecast_m.get(i).map_or(0.0, |forecast_m| (after_m - forecast_m).norm());
            self.off_library.push(off_m(positions.by_library_m));
            self.off_learning.push(off_m(positions.by_learning_m));
        }
    }

    fn condition(&mut self, facts: &ConditionFacts<'_>) {
        let begins = facts.change == ConditionChange::Began && facts.condition.is_guard();
        if begins && self.guards.len() < MOST_GUARDS {
            let code = facts.condition.code().to_owned();
            self.guards.push(GuardReport { code, at_s: rounded(facts.at.secs()), text: facts.text.to_owned() });
        }
    }

    fn cycle(&mut self, facts: &CycleFacts<'_>) {
        self.cycles += 1;
        self.timings.plan.push(facts.plan_us);
        let Timings { plan_new, plan_correction, .. } = &mut self.timings;
        if facts.plan.continues { plan_correction } else { plan_new }.push(facts.plan_us);
        self.timings.cycle.push(facts.cycle_us);
        let mut off = Lengths::default();
        let steps = facts.result_m.iter().zip(&facts.wanted.subgoals_m);
        steps.for_each(|(at_m, subgoal_m)| off.push((at_m - subgoal_m).norm()));
        off.mean_m().into_iter().for_each(|error_m| self.cycle_errors.push(error_m));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::SelectedBy;
    use upm_fixtures::synthetic_run::SyntheticRun;

    fn ending(parts: Vec<PartEnd>) -> EndFacts {
        EndFacts {
            name: "test".into(),
            seed: 7,
            planner: None,
            outcome: Outcome::Completed,
            reason: "all parts in place".into(),
            cause: None,
            plate_time: PlateTime::from_secs(3.25),
            wall_time_s: 0.5,
            deadlines: None,
            laps: 0,
            lost_parts: 0,
            parts,
            faults: Vec::new(),
        }
    }

    fn part(target_m: Option<Vec2>, measured_m: Vec2) -> PartEnd {
        PartEnd { id: "penny-1".into(), kind: "penny".into(), target_m, measured_m: Some(measured_m) }
    }

    #[test]
    fn counts_and_figures() {
        let mut stats = RunStats::new(None);
        let mut run = SyntheticRun::new(2);
        run.wall_us = 50.0;
        run.localise(&mut stats);
        (0..4).for_each(|_| run.cycle(&mut stats));
        let target = Some(Vec2::zeros());
        let parts =
            vec![part(target, Vec2::new(0.0003, 0.0004)), part(target, Vec2::zeros()), part(None, Vec2::zeros())];
        let report = stats.report(ending(parts));
        assert_eq!((report.cycles, report.pulses, report.frames), (4, run.pulses_played, run.frames_taken));
        assert_eq!(
            (report.max_error_mm, report.rms_error_mm, report.mean_error_mm),
            (Some(0.5), Some(0.3536), Some(0.25))
        );
        let CycleError { mean, max } = report.cycle_error_mm.unwrap();
        assert!(0.0 < mean && mean <= max, "{mean} {max}");
        assert_eq!((report.collisions, report.sensing_rms_error_mm), (None, None));
        assert_eq!(report.parts[2].error_mm, None);
        assert_eq!(report.timing_us.track.max, 50.0);
    }

    #[test]
    fn measured_positions_are_compared_with_the_truth() {
        let mut run = SyntheticRun::new(2);
        run.sensing_offset_m = Vec2::new(3e-5, 4e-5);
        let mut stats = RunStats::new(Some(run.truth.clone()));
        (0..3).for_each(|_| run.cycle(&mut stats));
        let report = stats.report(ending(vec![part(Some(run.parts_m[0]), Vec2::zeros())]));
        assert_eq!(report.sensing_rms_error_mm, Some(0.05));
        assert_eq!(report.sensing_rms_error_at_rest_mm, Some(0.05));
        assert_eq!((report.max_error_mm, report.collisions), (Some(0.0), Some(0)), "truth, not measurement, counts");
    }

    #[test]
    fn observations_at_other_times_are_not_compared() {
        let mut run = SyntheticRun::new(1);
        let mut stats = RunStats::new(Some(Default::default()));
        run.cycle(&mut stats);
        assert_eq!(stats.report(ending(Vec::new())).sensing_rms_error_mm, None);
    }

    #[test]
    fn json_has_the_names_of_the_contract() {
        let report = RunStats::new(None).report(ending(vec![part(None, Vec2::zeros())]));
        let json = serde_json::to_value(&report).unwrap();
        for key in [
            "outcome",
            "reason",
            "plate_time_s",
            "wall_time_s",
            "frames",
            "cycles",
            "pulses",
            "laps",
            "collisions",
            "lost_parts",
            "max_error_mm",
            "rms_error_mm",
            "mean_error_mm",
            "sensing_rms_error_mm",
            "cross_track_rms_mm",
            "cross_track_max_mm",
            "travel_ratio",
            "speed_held_mm_s",
            "seed",
            "name",
            "version",
        ] {
            assert!(json.get(key).is_some(), "{key}");
        }
        for key in ["id", "kind", "target_mm", "measured_mm", "true_mm", "error_mm"] {
            assert!(json["parts"][0].get(key).is_some(), "parts: {key}");
        }
        for key in ["localise", "track", "plan", "plan_new", "plan_correction", "cycle"] {
            for figure in ["p50", "p99", "max"] {
                assert!(json["timing_us"][key][figure].is_number(), "{key}: {figure}");
            }
        }
        assert_eq!(json["outcome"], "completed");
        assert_eq!(serde_json::from_value::<Report>(json).unwrap(), report);
    }

    #[test]
    fn planner_of_the_run_is_reported_with_its_reason() {
        let planner = PlannerReport {
            name: "cor_sequence".into(),
            chosen: SelectedBy::Auto,
            code: "one_part".into(),
            why: "the job moves one part".into(),
            alternatives: vec!["pseudo_inverse".into()],
        };
        let report = RunStats::new(None).report(EndFacts { planner: Some(planner), ..ending(Vec::new()) });
        let json = serde_json::to_value(&report).unwrap();
        let expected = serde_json::json!({
            "name": "cor_sequence", "chosen": "auto", "code": "one_part", "why": "the job moves one part",
            "alternatives": ["pseudo_inverse"],
        });
        assert_eq!(json["planner"], expected);
        assert_eq!(serde_json::from_value::<Report>(json).unwrap(), report);
    }

    #[test]
    fn deadlines_are_reported_only_where_there_were_any() {
        let json = |deadlines| {
            let report = RunStats::new(None).report(EndFacts { deadlines, ..ending(Vec::new()) });
            let json = serde_json::to_value(&report).unwrap();
            assert_eq!(serde_json::from_value::<Report>(json.clone()).unwrap(), report);
            ["deadline_misses", "worst_late_frames", "behind_s"].map(|key| json.get(key).cloned())
        };
        assert_eq!(json(None), [None, None, None]);
        let late = Deadlines { misses: 3, worst_frames: 2, behind: Duration::from_millis(1250) };
        assert_eq!(json(Some(late)), [Some(3.into()), Some(2.into()), Some(1.25.into())]);
    }
}
