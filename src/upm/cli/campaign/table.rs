//! The summary of a campaign as lines of text, and as a plot.

use upm_chart::{Chart, Color, text_table};
use upm_runner::campaign::{CellSummary, Interval, RunLine, Summary};

/// Failures that the table names.
const MOST_FAILURES: usize = 12;
/// Cells of a plot.
const MOST_LINES: usize = 8;
/// Points of a line of a plot.
const MOST_POINTS: usize = 400;
/// Figures of the table after plate time: name, heading, decimals, and whether the largest counts, not the median.
const FIGURES: [(&str, &str, usize, bool); 8] = [
    ("cycles", "cycles", 0, false),
    ("pulses", "pulses", 0, false),
    ("max_error_mm", "most error mm", 2, true),
    ("collisions", "most touches", 0, true),
    ("lost_parts", "most lost", 0, true),
    ("cross_track_rms_mm", "rms mm", 2, false),
    ("cross_track_max_mm", "most off mm", 2, true),
    ("speed_held_mm_s", "held mm/s", 1, false),
];

/// Indented lines with their columns under each other; the first is flush left.
pub(super) fn aligned(rows: &[Vec<String>]) -> impl Iterator<Item = String> {
    text_table(rows, |column| column > 0).into_iter().map(|line| format!("  {line}"))
}

/// The lines of a summary; `file` is the campaign's, for commands that repeat failures.
pub(super) fn lines(summary: &Summary) -> Vec<String> {
    let Summary { facts, done, successes, .. } = summary;
    let missing =
        if summary.missing() > 0 { format!(", {} of them missing", summary.missing()) } else { String::new() };
    let mut lines = vec![format!("{}: {} runs{missing}, {successes} of {done} with success", facts.name, facts.runs)];
    let has = |cell: &CellSummary, figure: &str| cell.figures.contains_key(figure);
    let figures: Vec<_> =
        FIGURES.iter().filter(|(name, ..)| summary.of_cells.iter().any(|cell| has(cell, name))).collect();
    let mut heads = ["", "runs", "success %", "95 %", "median s", "95 %", "most s"].map(str::to_owned).to_vec();
    heads.extend(figures.iter().map(|(_, head, ..)| (*head).to_owned()));
    let row = |cell: &CellSummary| {
        let range = |interval: Option<Interval>, scale: f64, digits: usize| {
            let [low, high] = interval.map(|i| [i.low * scale, i.high * scale]).unwrap_or([f64::NAN; 2]);
            if interval.is_some() { format!("{low:.digits$}-{high:.digits$}") } else { "-".into() }
        };
        let number = |value: Option<f64>, digits: usize| value.map_or("-".into(), |value| format!("{value:.digits$}"));
        let time = cell.figures.get("plate_time_s");
        let mut row = vec![
            cell.cell.clone(),
            cell.runs.to_string(),
            number(cell.success.map(|share| 100.0 * share.value), 1),
            range(cell.success, 100.0, 1),
            number(time.map(|time| time.median.value), 2),
            range(time.map(|time| time.median), 1.0, 2),
            number(time.map(|time| time.most), 2),
        ];
        row.extend(figures.iter().map(|(name, _, digits, is_most)| {
            let figure = cell.figures.get(name);
            number(figure.map(|figure| if *is_most { figure.most } else { figure.median.value }), *digits)
        }));
        row
    };
    let rows: Vec<_> = std::iter::once(heads).chain(summary.of_cells.iter().map(row)).collect();
    lines.extend(aligned(&rows));
    if *done > *successes {
        let counted = summary.ends.iter().map(|(end, count)| format!("{end} {count}"));
        lines.push(format!("  ends: {}", counted.collect::<Vec<_>>().join(", ")));
        let counted = summary.violations.iter().map(|(rule, count)| format!("{rule} {count}"));
        let broken = counted.collect::<Vec<_>>().join(", ");
        lines.extend((!broken.is_empty()).then(|| format!("  violations: {broken}")));
    }
    lines.extend(summary.failures.iter().take(MOST_FAILURES).map(failure));
    if let Some(first) = summary.failures.first() {
        let more = done - successes - summary.failures.len().min(MOST_FAILURES);
        lines.extend((more > 0).then(|| format!("  and {more} more, in summary.json")));
        let (name, run) = (&facts.name, first.run);
        lines.push(format!("  to see one: upm campaign {name}.json --runs {run} --keep all --out {name}-again"));
    }
    lines
}

fn failure(line: &RunLine) -> String {
    let RunLine { run, seed, outcome, code, reason, .. } = line;
    let why = line.violations.first().unwrap_or(reason);
    let why = why.split("; ").next().unwrap_or_default();
    format!("  run {run}, seed {seed}: {}: {why}", code.as_ref().unwrap_or(outcome))
}

/// Share of the runs of each cell that have succeeded, over plate time.
pub(super) fn plot(summary: &Summary) -> Chart {
    let title = format!("{}: share of runs that have succeeded", summary.facts.name);
    let chart = Chart::plot("plate_time_s", title, ["plate time, s", "share of runs"]);
    summary.of_cells.iter().take(MOST_LINES).enumerate().fold(chart, |chart, (i, cell)| {
        let times_s = cell.sorted("plate_time_s");
        let step = times_s.len().div_ceil(MOST_POINTS).max(1);
        let points = times_s.iter().enumerate().filter(|(n, _)| n % step == 0 || n + 1 == times_s.len());
        let points = points.map(|(n, &time_s)| [time_s, (n + 1) as f64 / cell.runs as f64]);
        let label = if cell.cell.is_empty() { &summary.facts.name } else { &cell.cell };
        // colours repeat after four
        if i < 4 { chart.line(label, Color::nth(i), points) } else { chart.dashes(label, Color::nth(i), points) }
    })
}
