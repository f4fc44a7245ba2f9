use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;

use upm_core::job::{CameraMode, Outcome, StopCause};
use upm_recording::{PathReport, Report, Verdict};

/// Result of one run of a batch.
#[derive(Clone, Debug, Serialize)]
pub(super) struct SeedRun {
    pub seed: u64,
    pub outcome: Outcome,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub verdict: Option<Verdict>,
    /// Machine-readable cause of the end, where there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub code: Option<StopCause>,
    pub reason: String,
    /// `None` if the job cannot be run with this seed.
    #[serde(flatten)]
    pub figures: Option<RunFigures>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub folder: Option<String>,
    /// Exit status of `upm run` with this seed.
    pub status: u8,
}

/// Figures of one run, named as in `report.json`.
#[derive(Clone, Debug, Serialize)]
pub(super) struct RunFigures {
    pub plate_time_s: f64,
    pub wall_time_s: f64,
    pub cycles: u64,
    pub pulses: u64,
    pub collisions: Option<u64>,
    pub max_error_mm: Option<f64>,
    #[serde(flatten)]
    pub path: PathReport,
}

impl SeedRun {
    pub fn of(report: &Report, folder: &Path, status: u8) -> Self {
        Self {
            seed: report.seed,
            outcome: report.outcome,
            verdict: report.verdict,
            code: report.stop.as_ref().map(|stop| stop.code),
            reason: report.reason.clone(),
            figures: Some(RunFigures {
                plate_time_s: report.plate_time_s,
                wall_time_s: report.wall_time_s,
                cycles: report.cycles,
                pulses: report.pulses,
                collisions: report.collisions,
                max_error_mm: report.max_error_mm,
                path: report.path.clone(),
            }),
            folder: Some(folder.display().to_string()),
            status,
        }
    }

    /// Entry of a job that could not be run with `seed`, or whose run could not be written.
    pub fn not_run(seed: u64, reason: String, status: u8) -> Self {
        let outcome = Outcome::Failed;
        Self { seed, outcome, verdict: None, code: None, reason, figures: None, folder: None, status }
    }

    /// True if the run completed and the ground truth does not contradict it.
    pub fn is_done(&self) -> bool {
        self.outcome == Outcome::Completed && !self.is_false_success()
    }

    pub fn is_false_success(&self) -> bool {
        self.verdict == Some(Verdict::FalseSuccess)
    }
}

/// A figure that is summarised over the completed runs.
pub(super) struct BatchFigure {
    /// Key in `report.json`.
    pub key: &'static str,
    /// Label in the table, with the unit.
    pub name: &'static str,
    /// Decimals in the table.
    pub decimals: usize,
    of: fn(&RunFigures) -> Option<f64>,
}

/// All figures; smaller is better for each.
pub(super) const FIGURES: [BatchFigure; 7] = [
    BatchFigure { key: "plate_time_s", name: "plate time (s)", decimals: 1, of: |run| Some(run.plate_time_s) },
    BatchFigure { key: "cycles", name: "cycles", decimals: 0, of: |run| Some(run.cycles as f64) },
    BatchFigure { key: "pulses", name: "pulses", decimals: 0, of: |run| Some(run.pulses as f64) },
    BatchFigure { key: "max_error_mm", name: "final error (mm)", decimals: 2, of: |run| run.max_error_mm },
    BatchFigure {
        key: "cross_track_rms_mm",
        name: "cross-track (mm rms)",
        decimals: 2,
        of: |run| run.path.cross_track_rms_mm,
    },
    BatchFigure {
        key: "cross_track_max_mm",
        name: "cross-track (mm max)",
        decimals: 2,
        of: |run| run.path.cross_track_max_mm,
    },
    BatchFigure {
        key: "speed_short_mm_s",
        name: "short of speed (mm/s)",
        decimals: 2,
        of: |run| Some(run.path.speed_asked_mm_s? - run.path.speed_held_mm_s?),
    },
];

/// Median, best and worst value of a figure over the completed runs that have it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct FigureSpread {
    pub median: f64,
    pub best: f64,
    pub best_seed: u64,
    pub worst: f64,
    pub worst_seed: u64,
}

impl FigureSpread {
    /// Spread of pairs of value and seed; among equal values the first counts. `None` without values.
    fn of(mut values: Vec<(f64, u64)>) -> Option<Self> {
        // stable, so that the order of the seeds settles ties
        values.sort_by(|a, b| a.0.total_cmp(&b.0));
        let &(best, best_seed) = values.first()?;
        let &(worst, _) = values.last()?;
        let worst_seed = values.iter().find(|(value, _)| *value == worst).map_or(best_seed, |&(_, seed)| seed);
        let middle = values.len() / 2;
        let upper = values.get(middle)?.0;
        let median = if values.len().is_multiple_of(2) { 0.5 * (values.get(middle - 1)?.0 + upper) } else { upper };
        // reports have four decimals, so a mean of two has five
        Some(Self { median: (median * 1e5).round() / 1e5, best, best_seed, worst, worst_seed })
    }
}

/// Contents of `summary.json`.
#[derive(Debug, Serialize)]
pub(super) struct BatchSummary {
    pub name: String,
    pub rig: String,
    pub version: &'static str,
    /// What the simulated camera delivered.
    pub camera: CameraMode,
    /// Number of seeds requested.
    pub seeds: usize,
    pub completed: usize,
    /// Runs that completed by their report although the ground truth contradicts it.
    pub false_success: usize,
    pub failed: usize,
    pub cancelled: usize,
    /// Seeds whose run was not started.
    pub not_started: usize,
    pub wall_time_s: f64,
    /// Spread over the completed runs, by figure name.
    pub figures: BTreeMap<&'static str, FigureSpread>,
    /// Runs in the order of the seeds.
    pub runs: Vec<SeedRun>,
}

impl BatchSummary {
    /// Summary of a batch of `seeds` seeds, of which `runs` were started.
    pub fn new([name, rig]: [&str; 2], camera: CameraMode, seeds: usize, wall_time_s: f64, runs: Vec<SeedRun>) -> Self {
        let count = |is: fn(&SeedRun) -> bool| runs.iter().filter(|&run| is(run)).count();
        let spread = |figure: &BatchFigure| Some((figure.key, FigureSpread::of(values(&runs, figure))?));
        Self {
            name: name.to_owned(),
            rig: rig.to_owned(),
            version: env!("CARGO_PKG_VERSION"),
            camera,
            seeds,
            completed: count(SeedRun::is_done),
            false_success: count(SeedRun::is_false_success),
            failed: count(|run| run.outcome == Outcome::Failed),
            cancelled: count(|run| run.outcome == Outcome::Cancelled),
            not_started: seeds - runs.len(),
            wall_time_s,
            figures: FIGURES.iter().filter_map(spread).collect(),
            runs,
        }
    }

    /// Plate times of the completed runs, s, in the order of the seeds.
    pub fn plate_times_s(&self) -> Vec<f64> {
        values(&self.runs, &FIGURES[0]).into_iter().map(|(time_s, _)| time_s).collect()
    }

    /// Exit status of the first run that did not complete; `0` if all did.
    pub fn status(&self) -> u8 {
        self.runs.iter().map(|run| run.status).find(|&status| status != 0).unwrap_or(0)
    }
}

/// Value and seed of each completed run that has the figure.
fn values(runs: &[SeedRun], figure: &BatchFigure) -> Vec<(f64, u64)> {
    let done = runs.iter().filter(|run| run.is_done());
    done.filter_map(|run| Some(((figure.of)(run.figures.as_ref()?)?, run.seed))).collect()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Test data: a run as its report describes it.
    pub fn run(seed: u64, outcome: Outcome, plate_time_s: f64) -> SeedRun {
        let figures = RunFigures {
            plate_time_s,
            wall_time_s: 1.0,
            cycles: 10 * seed,
            pulses: 3,
            collisions: Some(0),
            max_error_mm: seed.is_multiple_of(2).then_some(0.1 * seed as f64),
            path: PathReport::default(),
        };
        let (reason, figures) = (format!("as seed {seed} has it"), Some(figures));
        let status = u8::from(outcome != Outcome::Completed);
        SeedRun { seed, outcome, verdict: None, code: None, reason, figures, folder: None, status }
    }

    pub fn summary(runs: Vec<SeedRun>) -> BatchSummary {
        BatchSummary::new(["ring", "upm-2"], CameraMode::Pixels, runs.len() + 1, 2.0, runs)
    }

    #[test]
    fn spread_names_the_first_seed_of_equal_values() {
        assert_eq!(FigureSpread::of(Vec::new()), None);
        let odd = FigureSpread::of(vec![(3.0, 1), (1.0, 2), (3.0, 3), (2.0, 4), (1.0, 5)]).unwrap();
        assert_eq!(odd, FigureSpread { median: 2.0, best: 1.0, best_seed: 2, worst: 3.0, worst_seed: 1 });
        let even = FigureSpread::of(vec![(4.0, 1), (1.0, 2)]).unwrap();
        assert_eq!((even.median, even.best_seed, even.worst_seed), (2.5, 2, 1));
        let one = FigureSpread::of(vec![(4.0, 9)]).unwrap();
        assert_eq!((one.median, one.best_seed, one.worst_seed), (4.0, 9, 9));
    }

    #[test]
    fn figures_are_of_completed_runs_alone_and_false_success_is_not_one() {
        let mut believed = run(5, Outcome::Completed, 1.0);
        (believed.verdict, believed.status) = (Some(Verdict::FalseSuccess), 1);
        let summary = summary(vec![
            run(2, Outcome::Completed, 30.0),
            run(3, Outcome::Failed, 600.0),
            run(4, Outcome::Completed, 20.0),
            believed,
            run(6, Outcome::Cancelled, 5.0),
        ]);
        let counts = [summary.completed, summary.false_success, summary.failed, summary.cancelled, summary.not_started];
        assert_eq!(counts, [2, 1, 1, 1, 1]);
        assert_eq!(summary.plate_times_s(), [30.0, 20.0]);
        assert_eq!(summary.figures["plate_time_s"].median, 25.0);
        assert_eq!(summary.figures["max_error_mm"].worst_seed, 4);
        assert!(!summary.figures.contains_key("cross_track_rms_mm"), "no run has one");
        assert_eq!(summary.status(), 1);
    }
}
