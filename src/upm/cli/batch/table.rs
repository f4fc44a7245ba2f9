use super::summary::{BatchSummary, FIGURES, SeedRun};
use upm_core::job::{CameraMode, Outcome};

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
    let seeds = if *seeds == 1 { "1 seed".to_owned() } else { format!("{seeds} seeds") };
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
    use super::super::summary::tests::{run, summary};
    use super::*;
    use upm_recording::Verdict;

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
    }
}
