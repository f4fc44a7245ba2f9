//! Forecast of a job, as text and as JSON.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::sync::Arc;

use serde_json::{Value, json};

use super::coverage::{degrees, place_json, shown, steps};
use crate::cli::progress::LateProgress;
use crate::cli::summary::{median, planner_line};
use upm_core::units::mm_from_m;
use upm_planning::cor_library::Library;
use upm_recording::{Report, rounded};
use upm_runner::config::{Diagnostic, JobSpec};
use upm_runner::run::{ClosestApproach, DryRun, Forecast, PartForecast, PlaceReach, dry_run};

pub(super) struct PlanReport<'a> {
    pub job: &'a JobSpec,
    pub forecast: Forecast,
}

impl<'a> PlanReport<'a> {
    /// Makes dry runs of `job` as [`dry_run`] does; shows progress on stderr if it takes long.
    pub fn of(
        job: &'a JobSpec,
        seeds: &[u64],
        library: &Arc<Library>,
        progress: &mut LateProgress,
    ) -> Result<Self, Diagnostic> {
        let forecast = dry_run(job, seeds, library, &mut |at, done| {
            progress.show(done, || format!("dry runs, plate {:6.1} s", at.secs()));
        });
        progress.finish();
        Ok(Self { job, forecast: forecast? })
    }

    /// Relative standard deviation of the parts' friction, from the rig's file.
    fn friction_spread(&self) -> f64 {
        self.job.rig.document.friction.spread
    }

    /// Verdict of the dry runs.
    pub fn verdict(&self) -> PlanVerdict {
        verdict(&self.forecast.dry_runs)
    }

    /// Text output.
    pub fn lines(&self) -> Vec<String> {
        let forecast = &self.forecast;
        let mut lines: Vec<String> =
            figures(forecast).into_iter().map(|(label, text)| format!("{label:16} {text}")).collect();
        if forecast.fields {
            lines.push("each part alone, by single rotations of the library:".into());
        }
        lines.extend(part_lines(&forecast.parts));
        lines.push(format!(
            "all of it predicted by runs on the simulated plate without pixels; friction drawn with {:.0} % spread",
            100.0 * self.friction_spread()
        ));
        lines
    }

    /// JSON output; lengths in millimetres.
    pub fn json(&self) -> Value {
        let forecast = &self.forecast;
        let id = |part: usize| forecast.parts.get(part).map(|part| part.id.as_str());
        let plate_time = bracket_s(&forecast.dry_runs).map(|[least, median, most]| {
            json!({ "least": rounded(least), "median": rounded(median), "most": rounded(most) })
        });
        let smallest_gap = nearest(&forecast.dry_runs).map(|ClosestApproach { gap_m, parts, at_s }| {
            json!({ "gap_mm": rounded(mm_from_m(gap_m)), "parts": parts.map(id), "at_s": rounded(at_s) })
        });
        let ending = |(reason, times): &(&str, usize)| json!({ "reason": reason, "times": times });
        let met = |(limit, cycles): &(&str, u64)| json!({ "limit": limit, "cycles": cycles });
        let dry_runs = forecast.dry_runs.iter().map(|dry_run| {
            let Report { seed, reason, plate_time_s, work, accuracy, .. } = &dry_run.report;
            json!({
                "seed": seed,
                "completed": dry_run.report.reached_goal(),
                "reason": reason,
                "plate_time_s": rounded(*plate_time_s),
                "cycles": work.cycles,
                "pulses": work.pulses,
                "prediction_error_mm": accuracy.prediction_error_mm.map(|error| error.learned),
            })
        });
        let parts = forecast.parts.iter().map(|part| {
            let mut object = json!({ "id": part.id });
            for (name, spot) in spots(part) {
                object[name] = place_json(spot);
                object[name]["singular_values"] = json!(spot.reach.singular_values.map(rounded));
            }
            object
        });
        json!({
            "planner": forecast.planner.report,
            "verdict": self.verdict().text().replace(' ', "_"),
            "can_be_done": self.verdict() == PlanVerdict::CanBeDone,
            "endings": endings(&forecast.dry_runs).iter().map(ending).collect::<Vec<_>>(),
            "predicted_plate_time_s": plate_time,
            "speed_mm_s": forecast.speed_mps.map(|[asked, held]| json!({ "asked": rounded(mm_from_m(asked)), "can_be_held": rounded(mm_from_m(held)) })),
            "smallest_gap": smallest_gap,
            "limits_met": limits_met(&forecast.dry_runs).iter().map(met).collect::<Vec<_>>(),
            "independence": {
                "of": if forecast.fields { "fields" } else { "rotations" },
                "singular_values": forecast.independence.singular_values.iter().map(|&s| rounded(s)).collect::<Vec<_>>(),
                "share": rounded(forecast.independence.share()),
                "weakest_part": forecast.independence.weakest.and_then(|(part, _)| id(part)),
                "weakest_direction_deg": forecast.independence.weakest.map(|(_, direction)| degrees(direction)),
            },
            "friction_spread": self.friction_spread(),
            "parts": parts.collect::<Vec<_>>(),
            "dry_runs": dry_runs.collect::<Vec<_>>(),
        })
    }
}

/// Start and, where there is one, target of a part.
fn spots(part: &PartForecast) -> impl Iterator<Item = (&'static str, &PlaceReach)> {
    std::iter::once(("start", &part.start)).chain(part.target.iter().map(|spot| ("target", spot)))
}

/// A line for each start and target: what one pulse does there in the weakest direction.
fn part_lines(parts: &[PartForecast]) -> Vec<String> {
    let wide = parts.iter().map(|part| part.id.len()).max().unwrap_or(0);
    let line = |part: &PartForecast, name: &str, place: &PlaceReach| {
        let (at, direction, share) =
            (shown(place.position_m), degrees(place.reach.weakest_direction), place.reach.weakest_projection);
        let (id, steps) = (&part.id, steps(place));
        format!("{id:wide$}  {name:6}  {at:16}  weakest {direction:3} deg, {share:.2} of the best: {steps}")
    };
    parts.iter().flat_map(|part| spots(part).map(|(name, spot)| line(part, name, spot)).collect::<Vec<_>>()).collect()
}

fn figures(forecast: &Forecast) -> Vec<(&'static str, String)> {
    let (completed, all) = (completed(&forecast.dry_runs).count(), forecast.dry_runs.len());
    let verdict = verdict(&forecast.dry_runs).text();
    let mut figures = vec![(verdict, format!("{completed} of {all} dry runs reach the goal"))];
    for (reason, times) in endings(&forecast.dry_runs) {
        figures.push(("", format!("{times} of {all}: {reason}")));
    }
    figures.push(("planner", planner_line(&forecast.planner.report)));
    if let Some([least, middle, most]) = bracket_s(&forecast.dry_runs) {
        let text = format!("{middle:.1} s of plate time ({least:.1} to {most:.1})");
        figures.push(("predicted", text));
    }
    if let Some([asked_mps, held_mps]) = forecast.speed_mps {
        let late = if asked_mps > held_mps { ", laps will be late" } else { "" };
        let text =
            format!("up to {:.1} mm/s can be held, {:.1} asked{late}", mm_from_m(held_mps), mm_from_m(asked_mps));
        figures.push(("speed", text));
    }
    let id = |part: usize| forecast.parts.get(part).map_or("?", |part| part.id.as_str());
    if let Some(ClosestApproach { gap_m, parts: [a, b], at_s }) = nearest(&forecast.dry_runs) {
        let gap = if gap_m < 0.0 { "none, they touch".into() } else { format!("{:.1} mm", mm_from_m(gap_m)) };
        figures.push(("smallest gap", format!("{} and {} at {at_s:.1} s: {gap}", id(a), id(b))));
    }
    for (limit, cycles) in limits_met(&forecast.dry_runs) {
        figures.push(("limit met", format!("{limit}, in {cycles} cycles")));
    }
    if let Some((part, direction)) = forecast.independence.weakest {
        let share = forecast.independence.share();
        let by = if forecast.fields { "fields" } else { "rotations" };
        let (id, direction) = (id(part), degrees(direction));
        let text = format!("by {by}, weakest: {id} towards {direction:.0} deg, {share:.3} of the best");
        figures.push(("all together", text));
    }
    figures
}

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
fn verdict(dry_runs: &[DryRun]) -> PlanVerdict {
    match (completed(dry_runs).count(), dry_runs.len()) {
        (completed, all) if completed == all => PlanVerdict::CanBeDone,
        (0, _) => PlanVerdict::CannotBeDone,
        (completed, all) if 2 * completed >= all => PlanVerdict::Likely,
        _ => PlanVerdict::Unlikely,
    }
}

/// Those that reach the goal.
fn completed(dry_runs: &[DryRun]) -> impl Iterator<Item = &DryRun> {
    dry_runs.iter().filter(|dry_run| dry_run.report.reached_goal())
}

/// Reasons of the dry runs' endings, failures first, with the number of each.
fn endings(dry_runs: &[DryRun]) -> Vec<(&str, usize)> {
    let mut endings: Vec<(&str, usize)> = Vec::new();
    let failed = dry_runs.iter().filter(|dry_run| !dry_run.report.reached_goal());
    for DryRun { report, .. } in failed.chain(completed(dry_runs)) {
        match endings.iter_mut().find(|(reason, _)| *reason == report.reason) {
            Some((_, times)) => *times += 1,
            None => endings.push((&report.reason, 1)),
        }
    }
    endings
}

/// Student's t that nine of ten values are below, for 1 to 4 degrees of freedom.
const T_90: [f64; 4] = [3.078, 1.886, 1.638, 1.533];

/// The same for any number of degrees of freedom, 0 for none: beyond the table by the expansion about the normal law,
/// to 0.003.
fn t_90(freedom: usize) -> f64 {
    let beyond = 1.2816 + 0.8466 / freedom as f64 + 0.571 / (freedom * freedom) as f64;
    freedom.checked_sub(1).map_or(0.0, |i| T_90.get(i).copied().unwrap_or(beyond))
}

/// Median plate time of the completed dry runs, s, and about it the interval that holds one more run four times of
/// five: by Student's t on logarithms, and a cycle wide on either side at least, since a run ends with one. `None` if
/// none completed.
fn bracket_s(dry_runs: &[DryRun]) -> Option<[f64; 3]> {
    let mut times_s: Vec<f64> = completed(dry_runs).map(|dry_run| dry_run.report.plate_time_s).collect();
    times_s.sort_by(f64::total_cmp);
    let cycles_s = completed(dry_runs).map(|dry_run| dry_run.report.plate_time_s / dry_run.report.work.cycles as f64);
    let cycle_s = cycles_s.filter(|cycle_s| cycle_s.is_finite()).fold(0.0, f64::max);
    let (count, middle_s) = (times_s.len() as f64, median(&times_s)?);
    let mean = times_s.iter().map(|time_s| libm::log(*time_s)).sum::<f64>() / count;
    let squares: f64 = times_s.iter().map(|time_s| (libm::log(*time_s) - mean).powi(2)).sum();
    let off = t_90(times_s.len().saturating_sub(1)) * (squares / (count - 1.0).max(1.0) * (1.0 + 1.0 / count)).sqrt();
    let [least_s, most_s] = [-off, off].map(|off| libm::exp(mean + off));
    Some([least_s.min(middle_s - cycle_s), middle_s, most_s.max(middle_s + cycle_s)])
}

/// Least gap between two parts in any dry run.
fn nearest(dry_runs: &[DryRun]) -> Option<ClosestApproach> {
    dry_runs.iter().filter_map(|dry_run| dry_run.record.nearest).min_by(|a, b| a.gap_m.total_cmp(&b.gap_m))
}

/// Limits that cut steps short, with the number of cycles in all dry runs, the most frequent first.
fn limits_met(dry_runs: &[DryRun]) -> Vec<(&str, u64)> {
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
        assert_eq!(verdict(&dry_runs), PlanVerdict::CanBeDone);
        // the mean of the logarithms is ln 5.646, their standard deviation 0.4185
        assert!((t_90(5) - 1.476).abs() < 0.003 && (t_90(19) - 1.328).abs() < 0.001);
        let off = 1.886 * 0.418_5 * (4.0f64 / 3.0).sqrt();
        let [least_s, middle_s, most_s] = bracket_s(&dry_runs).unwrap();
        assert!(middle_s == 5.0 && (most_s / 5.646 - libm::exp(off)).abs() < 0.01, "{most_s}");
        assert!((least_s / 5.646 - libm::exp(-off)).abs() < 0.01, "{least_s}");
        assert_eq!(nearest(&dry_runs), closest(0.001));
        assert_eq!(limits_met(&dry_runs), [("b", 4), ("a", 2)]);
        dry_runs[2].report = ended(Outcome::Failed, "stalled", 5.0);
        assert_eq!(verdict(&dry_runs), PlanVerdict::Likely);
        assert_eq!(endings(&dry_runs), [("stalled", 1), ("there", 2)]);
        assert_eq!(bracket_s(&dry_runs).unwrap()[1], 6.5);
        dry_runs[1].report.verdict = Some(Verdict::FalseSuccess);
        assert_eq!(verdict(&dry_runs), PlanVerdict::Unlikely, "the truth says otherwise");
        dry_runs[0].report = ended(Outcome::Failed, "stalled", 5.0);
        assert_eq!((verdict(&dry_runs), verdict(&dry_runs).is_failure()), (PlanVerdict::CannotBeDone, true));
        assert_eq!(bracket_s(&dry_runs), None);
    }
}
