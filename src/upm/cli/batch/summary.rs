use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;
use serde_json::{Map, Value, json};

use crate::cli::summary::median;
use upm_core::document::counted;
use upm_core::job::{CameraMode, Outcome, StopCause};
use upm_recording::{Report, Verdict};

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
    /// All numbers of the report; empty if the job cannot be run with this seed.
    #[serde(flatten)]
    pub figures: Map<String, Value>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub folder: Option<String>,
    /// Exit status of `upm run` with this seed.
    pub status: u8,
}

impl SeedRun {
    pub fn of(report: &Report, folder: &Path, status: u8) -> Self {
        let mut figures = json!(report).as_object().cloned().unwrap_or_default();
        figures.retain(|key, value| value.is_number() && key != "seed");
        Self {
            seed: report.seed,
            outcome: report.outcome,
            verdict: report.verdict,
            code: report.stop.as_ref().map(|stop| stop.code),
            reason: report.reason.clone(),
            figures,
            folder: Some(folder.display().to_string()),
            status,
        }
    }

    /// Entry of a job that could not be run with `seed`, or whose run could not be written.
    pub fn not_run(seed: u64, reason: String, status: u8) -> Self {
        let outcome = Outcome::Failed;
        Self { seed, outcome, verdict: None, code: None, reason, figures: Map::new(), folder: None, status }
    }

    /// True if the run completed and the ground truth does not contradict it.
    pub fn is_done(&self) -> bool {
        self.outcome == Outcome::Completed && !self.is_false_success()
    }

    pub fn is_false_success(&self) -> bool {
        self.verdict == Some(Verdict::FalseSuccess)
    }

    fn figure(&self, key: &str) -> Option<f64> {
        let value = |key| self.figures.get(key).and_then(Value::as_f64);
        if key == SPEED_SHORT { Some(value("speed_asked_mm_s")? - value("speed_held_mm_s")?) } else { value(key) }
    }
}

/// Key of the speed that a run is short of what its job asks for.
const SPEED_SHORT: &str = "speed_short_mm_s";

/// Figures summarised over the completed runs: the key, the label and the decimals in the table. Smaller is better for
/// each.
const FIGURES: [(&str, &str, usize); 7] = [
    ("plate_time_s", "plate time (s)", 1),
    ("cycles", "cycles", 0),
    ("pulses", "pulses", 0),
    ("max_error_mm", "final error (mm)", 2),
    ("cross_track_rms_mm", "cross-track (mm rms)", 2),
    ("cross_track_max_mm", "cross-track (mm max)", 2),
    (SPEED_SHORT, "short of speed (mm/s)", 2),
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
        let median = median(&values.iter().map(|(value, _)| *value).collect::<Vec<_>>())?;
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
    /// Pictures or positions from the simulated camera.
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
        let spread = |&(key, ..): &(&'static str, &str, usize)| Some((key, FigureSpread::of(values(&runs, key))?));
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

    /// Exit status of the first run that did not complete; `0` if all did.
    pub fn status(&self) -> u8 {
        self.runs.iter().map(|run| run.status).find(|&status| status != 0).unwrap_or(0)
    }
}

/// Value and seed of each completed run that has the figure.
fn values(runs: &[SeedRun], key: &str) -> Vec<(f64, u64)> {
    runs.iter().filter(|run| run.is_done()).filter_map(|run| Some((run.figure(key)?, run.seed))).collect()
}

/// Lines of the batch's table: counts, figures, and one line for each run that did not complete.
pub(super) fn lines(summary: &BatchSummary) -> Vec<String> {
    let mut lines = vec![headline(summary)];
    lines.extend(figures(summary));
    lines.extend(summary.runs.iter().filter(|run| !run.is_done()).map(failure));
    lines
}

fn headline(summary: &BatchSummary) -> String {
    let BatchSummary { name, rig, camera, seeds, completed, .. } = summary;
    let others = [
        (summary.failed, "failed"),
        (summary.false_success, "completed only as measured"),
        (summary.cancelled, "stopped"),
        (summary.not_started, "not started"),
    ];
    let others = others.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!(", {count} {what}"));
    let camera = if *camera == CameraMode::Positions { ", positions in place of pictures" } else { "" };
    let seeds = counted(*seeds, "seed");
    format!("{name} on {rig}, {seeds}{camera}: {completed} completed{}", others.collect::<String>())
}

fn figures(summary: &BatchSummary) -> Vec<String> {
    if summary.figures.is_empty() {
        return Vec::new();
    }
    let heads = format!("  {:20} {:>9} {:>9}  {:12} {:>9}  {}", "of the completed", "median", "best", "", "worst", "");
    let row = |&(key, name, decimals): &(&str, &str, usize)| {
        let spread = summary.figures.get(key)?;
        let shown = |value: f64| format!("{value:.decimals$}");
        let [best, worst] = [spread.best, spread.worst].map(shown);
        let median = if decimals == 0 { spread.median.to_string() } else { shown(spread.median) };
        let [best_seed, worst_seed] = [spread.best_seed, spread.worst_seed].map(|seed| format!("seed {seed}"));
        Some(format!("  {name:20} {median:>9} {best:>9}  {best_seed:12} {worst:>9}  {worst_seed}"))
    };
    std::iter::once(heads.trim_end().to_owned()).chain(FIGURES.iter().filter_map(row)).collect()
}

fn failure(run: &SeedRun) -> String {
    let SeedRun { seed, reason, .. } = run;
    match run.outcome {
        Outcome::Completed => {
            format!("  seed {seed} is a false success: the truth says that a part is not at its place")
        }
        outcome => format!("  seed {seed} {}: {reason}", outcome.code()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Test data: a run as its report describes it.
    fn run(seed: u64, outcome: Outcome, plate_time_s: f64) -> SeedRun {
        let max_error_mm = seed.is_multiple_of(2).then_some(0.1 * seed as f64);
        let figures = json!({
            "plate_time_s": plate_time_s, "cycles": 10 * seed, "pulses": 3, "max_error_mm": max_error_mm,
        });
        let (reason, figures) = (format!("as seed {seed} has it"), figures.as_object().cloned().unwrap());
        let status = u8::from(outcome != Outcome::Completed);
        SeedRun { seed, outcome, verdict: None, code: None, reason, figures, folder: None, status }
    }

    fn summary(runs: Vec<SeedRun>) -> BatchSummary {
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
        assert_eq!(summary.figures["plate_time_s"].median, 25.0);
        assert_eq!(summary.figures["max_error_mm"].worst_seed, 4);
        assert!(!summary.figures.contains_key("cross_track_rms_mm"), "no run has one");
        assert_eq!(summary.status(), 1);
    }

    #[test]
    fn table_has_counts_figures_and_a_line_for_each_failure() {
        let mut believed = run(8, Outcome::Completed, 12.0);
        believed.verdict = Some(Verdict::FalseSuccess);
        let runs = vec![
            run(2, Outcome::Completed, 30.04),
            run(3, Outcome::Failed, 600.0),
            run(4, Outcome::Completed, 20.0),
            believed,
        ];
        assert_eq!(
            lines(&summary(runs)),
            [
                "ring on upm-2, 5 seeds: 2 completed, 1 failed, 1 completed only as measured, 1 not started",
                "  of the completed        median      best                   worst",
                "  plate time (s)            25.0      20.0  seed 4            30.0  seed 2",
                "  cycles                      30        20  seed 2              40  seed 4",
                "  pulses                       3         3  seed 2               3  seed 2",
                "  final error (mm)          0.30      0.20  seed 2            0.40  seed 4",
                "  seed 3 failed: as seed 3 has it",
                "  seed 8 is a false success: the truth says that a part is not at its place",
            ]
        );
        let runs = vec![run(1, Outcome::Completed, 1.0)];
        let alone = BatchSummary::new(["one", "upm-2"], CameraMode::Positions, 1, 2.0, runs);
        assert_eq!(lines(&alone)[0], "one on upm-2, 1 seed, positions in place of pictures: 1 completed");
    }
}
