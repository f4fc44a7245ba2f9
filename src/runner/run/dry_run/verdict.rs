//! Verdict of the dry runs of a job, and the figures over all of them.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::Serialize;

use super::{ClosestApproach, DryRun, Forecast};
use upm_core::units::mm_from_m;

/// Dry runs of a job.
#[derive(Clone, Debug)]
pub struct DryRuns(pub Vec<DryRun>);

/// Prediction from the dry runs of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PlanVerdict {
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

/// Student's t that nine of ten values are below, for 1 to 4 degrees of freedom.
const T_90: [f64; 4] = [3.078, 1.886, 1.638, 1.533];

/// The same for any number of degrees of freedom, 0 for none: beyond the table by the expansion about the normal law,
/// to 0.003.
fn t_90(freedom: usize) -> f64 {
    let beyond = 1.2816 + 0.8466 / freedom as f64 + 0.571 / (freedom * freedom) as f64;
    freedom.checked_sub(1).map_or(0.0, |i| T_90.get(i).copied().unwrap_or(beyond))
}

impl DryRuns {
    /// Verdict of them all.
    pub fn verdict(&self) -> PlanVerdict {
        match (self.completed().count(), self.0.len()) {
            (completed, all) if completed == all => PlanVerdict::CanBeDone,
            (0, _) => PlanVerdict::CannotBeDone,
            (completed, all) if 2 * completed >= all => PlanVerdict::Likely,
            _ => PlanVerdict::Unlikely,
        }
    }

    /// Those that reach the goal.
    pub fn completed(&self) -> impl Iterator<Item = &DryRun> {
        self.0.iter().filter(|dry_run| dry_run.report.reached_goal())
    }

    /// Reasons of their endings, failures first, with the number of each.
    pub fn endings(&self) -> Vec<(&str, usize)> {
        let mut endings: Vec<(&str, usize)> = Vec::new();
        let failed = self.0.iter().filter(|dry_run| !dry_run.report.reached_goal());
        for DryRun { report, .. } in failed.chain(self.completed()) {
            match endings.iter_mut().find(|(reason, _)| *reason == report.reason) {
                Some((_, times)) => *times += 1,
                None => endings.push((&report.reason, 1)),
            }
        }
        endings
    }

    /// Median plate time of the completed ones, s, and about it the interval that holds one more run four times of
    /// five: by Student's t on logarithms, and a cycle wide on either side at least, since a run ends with one. `None`
    /// if none completed.
    pub fn bracket_s(&self) -> Option<[f64; 3]> {
        let mut times_s: Vec<f64> = self.completed().map(|dry_run| dry_run.report.plate_time_s).collect();
        times_s.sort_by(f64::total_cmp);
        let cycles_s = self.completed().map(|DryRun { report, .. }| report.plate_time_s / report.work.cycles as f64);
        let cycle_s = cycles_s.filter(|cycle_s| cycle_s.is_finite()).fold(0.0, f64::max);
        let (upper_s, lower_s) = (times_s.get(times_s.len() / 2)?, times_s.get(times_s.len().saturating_sub(1) / 2)?);
        let (count, middle_s) = (times_s.len() as f64, 0.5 * (upper_s + lower_s));
        let mean = times_s.iter().map(|time_s| libm::log(*time_s)).sum::<f64>() / count;
        let squares: f64 = times_s.iter().map(|time_s| (libm::log(*time_s) - mean).powi(2)).sum();
        let off =
            t_90(times_s.len().saturating_sub(1)) * (squares / (count - 1.0).max(1.0) * (1.0 + 1.0 / count)).sqrt();
        let [least_s, most_s] = [-off, off].map(|off| libm::exp(mean + off));
        Some([least_s.min(middle_s - cycle_s), middle_s, most_s.max(middle_s + cycle_s)])
    }

    /// Least gap between two parts in any of them.
    pub fn nearest(&self) -> Option<ClosestApproach> {
        self.0.iter().filter_map(|dry_run| dry_run.record.nearest).min_by(|a, b| a.gap_m.total_cmp(&b.gap_m))
    }

    /// Limits that cut steps short, with the number of cycles in all of them, the most frequent first.
    pub fn limits_met(&self) -> Vec<(&str, u64)> {
        let mut all: BTreeMap<&str, u64> = BTreeMap::new();
        for (limit, cycles) in self.0.iter().flat_map(|dry_run| &dry_run.record.limits_met) {
            *all.entry(limit).or_default() += cycles;
        }
        let mut all: Vec<_> = all.into_iter().collect();
        all.sort_by_key(|&(_, cycles)| Reverse(cycles));
        all
    }
}

/// A forecast in short, for clients.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct ForecastSummary {
    /// Verdict of the dry runs.
    pub verdict: PlanVerdict,
    /// Number of dry runs that reach the goal, and of all.
    pub completed_of: [usize; 2],
    /// Reasons of their endings, failures first.
    pub endings: Vec<String>,
    /// Predicted plate time, s: least, median and most; null when no dry run reaches the goal.
    pub plate_time_s: Option<[f64; 3]>,
    /// Speed asked of parts on paths, and the speed that can be held, mm/s.
    pub speed_mm_s: Option<[f64; 2]>,
}

impl From<&Forecast> for ForecastSummary {
    fn from(forecast: &Forecast) -> Self {
        let dry_runs = &forecast.dry_runs;
        Self {
            verdict: dry_runs.verdict(),
            completed_of: [dry_runs.completed().count(), dry_runs.0.len()],
            endings: dry_runs.endings().into_iter().map(|(reason, _)| reason.to_owned()).collect(),
            plate_time_s: dry_runs.bracket_s(),
            speed_mm_s: forecast.speed_mps.map(|speeds| speeds.map(mm_from_m)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::DryRunRecord;
    use upm_core::job::Outcome;
    use upm_recording::{Report, Verdict};

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
            DryRuns(vec![one(9.0, 0.003, &[("a", 2), ("b", 1)]), one(4.0, 0.001, &[]), one(5.0, 0.002, &[("b", 3)])]);
        assert_eq!(dry_runs.verdict(), PlanVerdict::CanBeDone);
        // the mean of the logarithms is ln 5.646, their standard deviation 0.4185
        assert!((t_90(5) - 1.476).abs() < 0.003 && (t_90(19) - 1.328).abs() < 0.001);
        let off = 1.886 * 0.418_5 * (4.0f64 / 3.0).sqrt();
        let [least_s, middle_s, most_s] = dry_runs.bracket_s().unwrap();
        assert!(middle_s == 5.0 && (most_s / 5.646 - libm::exp(off)).abs() < 0.01, "{most_s}");
        assert!((least_s / 5.646 - libm::exp(-off)).abs() < 0.01, "{least_s}");
        assert_eq!(dry_runs.nearest(), closest(0.001));
        assert_eq!(dry_runs.limits_met(), [("b", 4), ("a", 2)]);
        dry_runs.0[2].report = ended(Outcome::Failed, "stalled", 5.0);
        assert_eq!(dry_runs.verdict(), PlanVerdict::Likely);
        assert_eq!(dry_runs.endings(), [("stalled", 1), ("there", 2)]);
        assert_eq!(dry_runs.bracket_s().unwrap()[1], 6.5);
        dry_runs.0[1].report.verdict = Some(Verdict::FalseSuccess);
        assert_eq!(dry_runs.verdict(), PlanVerdict::Unlikely, "the truth says otherwise");
        dry_runs.0[0].report = ended(Outcome::Failed, "stalled", 5.0);
        assert_eq!((dry_runs.verdict(), dry_runs.verdict().is_failure()), (PlanVerdict::CannotBeDone, true));
        assert_eq!(dry_runs.bracket_s(), None);
    }
}
