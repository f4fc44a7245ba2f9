//! Figures over all dry runs of a job.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use upm_recording::Report;
use upm_runner::run::{ClosestApproach, DryRun};

/// Prediction from the dry runs of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PlanVerdict {
    /// All dry runs reach the goal.
    CanBeDone,
    /// At least half of them reach the goal, but not all.
    Likely,
    /// Fewer than half of them reach the goal, but at least one.
    Unlikely,
    /// None of them reaches the goal.
    CannotBeDone,
}

impl PlanVerdict {
    /// The verdict in words; its stable code has `_` in place of spaces.
    pub fn text(self) -> &'static str {
        match self {
            Self::CanBeDone => "can be done",
            Self::Likely => "likely",
            Self::Unlikely => "unlikely",
            Self::CannotBeDone => "cannot be done",
        }
    }

    /// True if the job is predicted to fail.
    pub fn is_failure(self) -> bool {
        matches!(self, Self::Unlikely | Self::CannotBeDone)
    }
}

/// Verdict of `dry_runs`.
pub(super) fn verdict(dry_runs: &[DryRun]) -> PlanVerdict {
    match (completed(dry_runs).count(), dry_runs.len()) {
        (completed, all) if completed == all => PlanVerdict::CanBeDone,
        (0, _) => PlanVerdict::CannotBeDone,
        (completed, all) if 2 * completed >= all => PlanVerdict::Likely,
        _ => PlanVerdict::Unlikely,
    }
}

/// Those that reach the goal.
pub(super) fn completed(dry_runs: &[DryRun]) -> impl Iterator<Item = &DryRun> {
    dry_runs.iter().filter(|dry_run| dry_run.is_completed())
}

/// Reasons of the dry runs' endings, failures first, with the number of each.
pub(super) fn endings(dry_runs: &[DryRun]) -> Vec<(&str, usize)> {
    let mut endings: Vec<(&str, usize)> = Vec::new();
    let failed = dry_runs.iter().filter(|dry_run| !dry_run.is_completed());
    for DryRun { report, .. } in failed.chain(completed(dry_runs)) {
        match endings.iter_mut().find(|(reason, _)| *reason == report.reason) {
            Some((_, times)) => *times += 1,
            None => endings.push((&report.reason, 1)),
        }
    }
    endings
}

/// Least, median and largest value of a figure over the completed dry runs; `None` if none completed.
pub(super) fn range(dry_runs: &[DryRun], figure: impl Fn(&Report) -> f64) -> Option<[f64; 3]> {
    let mut figures: Vec<f64> = completed(dry_runs).map(|dry_run| figure(&dry_run.report)).collect();
    figures.sort_by(f64::total_cmp);
    let middle = figures.len() / 2;
    let median = if figures.len() % 2 == 1 {
        *figures.get(middle)?
    } else {
        0.5 * (figures.get(middle.checked_sub(1)?)? + figures.get(middle)?)
    };
    Some([*figures.first()?, median, *figures.last()?])
}

/// Least gap between two parts in any dry run.
pub(super) fn nearest(dry_runs: &[DryRun]) -> Option<ClosestApproach> {
    dry_runs.iter().filter_map(|dry_run| dry_run.record.nearest).min_by(|a, b| a.gap_m.total_cmp(&b.gap_m))
}

/// Limits that cut steps short, with the number of cycles in all dry runs, the most frequent first.
pub(super) fn limits_met(dry_runs: &[DryRun]) -> Vec<(&str, u64)> {
    let mut all: BTreeMap<&str, u64> = BTreeMap::new();
    for (limit, cycles) in dry_runs.iter().flat_map(|dry_run| &dry_run.record.limits_met) {
        *all.entry(limit).or_default() += cycles;
    }
    let mut all: Vec<_> = all.into_iter().collect();
    all.sort_by_key(|&(_, cycles)| Reverse(cycles));
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use upm_core::job::Outcome;
    use upm_recording::Verdict;
    use upm_runner::run::DryRunRecord;

    #[test]
    fn figures_are_over_all_dry_runs() {
        let closest = |gap_m| Some(ClosestApproach { gap_m, parts: [0, 1], at_s: 1.0 });
        let ended = |outcome, reason: &str, plate_time_s| Report {
            outcome,
            reason: reason.into(),
            plate_time_s,
            ..Report::default()
        };
        let one = |plate_time_s, gap_m, limits: &[(&str, u64)]| {
            let mut record = DryRunRecord::default();
            record.nearest = closest(gap_m);
            record.limits_met = limits.iter().map(|&(limit, cycles)| (limit.to_owned(), cycles)).collect();
            DryRun { report: ended(Outcome::Completed, "there", plate_time_s), record }
        };
        let mut dry_runs =
            vec![one(9.0, 0.003, &[("a", 2), ("b", 1)]), one(4.0, 0.001, &[]), one(5.0, 0.002, &[("b", 3)])];
        let time = |report: &Report| report.plate_time_s;
        assert_eq!(verdict(&dry_runs), PlanVerdict::CanBeDone);
        assert_eq!(range(&dry_runs, time), Some([4.0, 5.0, 9.0]));
        assert_eq!(nearest(&dry_runs), closest(0.001));
        assert_eq!(limits_met(&dry_runs), [("b", 4), ("a", 2)]);
        dry_runs[2].report = ended(Outcome::Failed, "stalled", 5.0);
        assert_eq!(verdict(&dry_runs), PlanVerdict::Likely);
        assert_eq!(endings(&dry_runs), [("stalled", 1), ("there", 2)]);
        assert_eq!(range(&dry_runs, time), Some([4.0, 6.5, 9.0]));
        dry_runs[1].report.verdict = Some(Verdict::FalseSuccess);
        assert_eq!(verdict(&dry_runs), PlanVerdict::Unlikely, "the truth says otherwise");
        dry_runs[0].report = ended(Outcome::Failed, "stalled", 5.0);
        assert_eq!((verdict(&dry_runs), verdict(&dry_runs).is_failure()), (PlanVerdict::CannotBeDone, true));
        assert_eq!(range(&dry_runs, time), None);
    }
}
