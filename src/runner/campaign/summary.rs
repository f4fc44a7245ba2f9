use std::collections::BTreeMap;

use serde::Serialize;

use super::folder::FolderFacts;
use super::line::{Figures, RunLine};
use super::statistics::Interval;

/// Most failures that are listed.
const MOST_FAILURES: usize = 1000;

/// Summary of a campaign: of the lines alone, whatever made them.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Summary {
    /// Its folder's facts.
    #[serde(flatten)]
    pub facts: FolderFacts,
    /// Runs that have a line.
    pub done: usize,
    /// Runs with success.
    pub successes: usize,
    /// Runs by how they ended: an outcome, or the code of its cause.
    pub ends: BTreeMap<String, usize>,
    /// Runs by findings.
    pub findings: BTreeMap<String, usize>,
    /// Violations by their first word, to a colon.
    pub violations: BTreeMap<String, usize>,
    /// Cells in their order; named by the values they have.
    pub of_cells: Vec<CellSummary>,
    /// The first runs without success, in the order of their numbers.
    pub failures: Vec<RunLine>,
}

/// Summary of the runs of a cell.
#[derive(Clone, Debug, Default, Serialize)]
pub struct CellSummary {
    /// The values of the cell.
    pub cell: String,
    /// Its runs that have a line.
    pub runs: usize,
    /// Share of successes; `None` without runs.
    pub success: Option<Interval>,
    /// Figures of the runs with success.
    pub figures: BTreeMap<&'static str, FigureSummary>,
    #[serde(skip)]
    successes: usize,
    /// Plate times of the successes, s, in ascending order once all lines are counted.
    #[serde(skip)]
    values: BTreeMap<&'static str, Vec<f64>>,
}

/// A figure over the runs with success.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FigureSummary {
    /// Least value.
    pub least: f64,
    /// Median, with its interval.
    pub median: Interval,
    /// Largest value.
    pub most: f64,
}

impl Summary {
    /// A summary without lines.
    pub fn new(facts: &FolderFacts) -> Self {
        let cell = |name: &String| CellSummary { cell: name.clone(), ..CellSummary::default() };
        Self { of_cells: facts.cells.iter().map(cell).collect(), facts: facts.clone(), ..Self::default() }
    }

    /// Counts a line; lines come in the order of their runs.
    pub fn add(&mut self, line: &RunLine) {
        self.done += 1;
        self.successes += usize::from(line.success);
        *self.ends.entry(line.code.as_ref().unwrap_or(&line.outcome).clone()).or_default() += 1;
        line.findings.iter().for_each(|code| *self.findings.entry(code.clone()).or_default() += 1);
        for violation in &line.violations {
            let rule = violation.split(':').next().unwrap_or_default();
            *self.violations.entry(rule.to_owned()).or_default() += 1;
        }
        if let Some(cell) = self.of_cells.get_mut(line.cell) {
            cell.runs += 1;
            cell.successes += usize::from(line.success);
            let values =
                Figures::NAMES.iter().zip(line.figures.values()).filter(|(name, _)| **name != Figures::OF_COMPUTERS);
            for (name, value) in values.filter(|_| line.success) {
                value.into_iter().for_each(|value| cell.values.entry(name).or_default().push(value));
            }
        }
        if !line.success && self.failures.len() < MOST_FAILURES {
            // which folders stay depends on the order in which runs end
            let mut line = RunLine { evidence: None, folder: None, ..line.clone() };
            line.figures.wall_time_s = None;
            self.failures.push(line);
        }
    }

    /// The summary of the lines so far.
    pub fn finish(mut self) -> Self {
        for cell in &mut self.of_cells {
            cell.success = Interval::of_share(cell.successes, cell.runs);
            for (name, values) in &mut cell.values {
                values.sort_unstable_by(f64::total_cmp);
                let (Some(&least), Some(&most)) = (values.first(), values.last()) else { continue };
                let median = Interval::of_median(values);
                cell.figures.extend(median.map(|median| (*name, FigureSummary { least, median, most })));
            }
        }
        self
    }

    /// Runs that have no line.
    pub fn missing(&self) -> usize {
        self.facts.runs.saturating_sub(self.done)
    }
}

impl CellSummary {
    /// Values of a figure of the runs with success, in ascending order.
    pub fn sorted(&self, figure: &str) -> &[f64] {
        self.values.get(figure).map_or(&[], Vec::as_slice)
    }
}
