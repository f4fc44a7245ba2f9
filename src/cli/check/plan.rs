//! Forecast of a job, as text and as JSON.

use std::sync::Arc;

use serde_json::{Value, json};

use super::coverage_report::{degrees, mm, place_json, rounded};
use super::plan_table::{self, spots};
use crate::cli::progress::{LateProgress, ProgressMode};
use crate::cli::summary::planner_line;
use upm_control::{ClosestApproach, DryRun, LimitMet};
use upm_cor_library::Library;
use upm_core::job::Outcome;
use upm_core::time::MonotonicClock;
use upm_runner::config::{Diagnostic, JobLayout, JobSpec};
use upm_runner::run::{Forecast, PlanVerdict, dry_run};

pub(super) struct PlanReport {
    pub job: String,
    pub rig: String,
    /// Bins, paths and kinds in the job's file.
    pub layout: JobLayout,
    /// True if the job's rig is knocked, which dry runs leave out.
    pub is_knocked: bool,
    pub forecast: Forecast,
}

impl PlanReport {
    /// Makes dry runs of `job` with `library`; shows progress on stderr if it takes long.
    pub fn of(job: &JobSpec, library: &Arc<Library>, progress: ProgressMode) -> Result<Self, Diagnostic> {
        let mut progress = LateProgress::new(progress, MonotonicClock::new());
        let forecast = dry_run(job, library, &mut |at| {
            progress.show(at.done, || format!("dry run {} of {}, plate {:6.1} s", at.dry_run, at.of, at.at.secs()));
        });
        progress.finish();
        Ok(Self {
            job: job.name.clone(),
            rig: job.rig.model.name.clone(),
            layout: JobLayout::of(job),
            is_knocked: job.rig.document.simulation.knocks.is_some(),
            forecast: forecast?,
        })
    }

    /// Text output.
    pub fn lines(&self) -> Vec<String> {
        let forecast = &self.forecast;
        let mut lines: Vec<String> =
            figures(forecast).into_iter().map(|(label, text)| format!("{label:16} {text}")).collect();
        if forecast.fields {
            lines.push("each part alone, by single rotations of the library:".into());
        }
        lines.extend(plan_table::lines(&forecast.parts));
        lines.push(format!(
            "all of it predicted by the planner's own forecasts; friction drawn with {:.0} % spread",
            100.0 * forecast.friction_spread
        ));
        if self.is_knocked {
            lines.push("dry runs leave out the knocks of the rig (simulation.knocks)".into());
        }
        lines
    }

    /// JSON output; lengths in millimetres.
    pub fn json(&self) -> Value {
        let forecast = &self.forecast;
        let id = |part: usize| forecast.parts.get(part).map(|part| part.id.as_str());
        let range = forecast.range(|dry_run| dry_run.plate_time_s).map(|[least, median, most]| {
            json!({ "least": rounded(least), "median": rounded(median), "most": rounded(most) })
        });
        let nearest = forecast.nearest().map(|ClosestApproach { gap_m, parts, at_s }| {
            json!({ "gap_mm": rounded(mm(gap_m)), "parts": parts.map(id), "at_s": rounded(at_s) })
        });
        let ending = |(reason, times): &(&str, usize)| json!({ "reason": reason, "times": times });
        let met = |LimitMet { limit, times }: &LimitMet| json!({ "limit": limit, "plans": times });
        let dry_runs = forecast.dry_runs.iter().map(|dry_run| {
            json!({
                "completed": dry_run.ending.outcome == Outcome::Completed,
                "left_off": dry_run.left_off,
                "reason": dry_run.ending.reason,
                "plate_time_s": rounded(dry_run.plate_time_s),
                "cycles": dry_run.cycles,
                "pulses": dry_run.pulses,
                "prediction_error_mm": dry_run.prediction_error_m.map(|error_m| rounded(mm(error_m))),
            })
        });
        let parts = forecast.parts.iter().map(|part| {
            let mut object = json!({ "id": part.id });
            for (name, spot) in spots(part) {
                object[name] = place_json(&spot.place);
                object[name]["singular_values"] = json!(spot.singular_values.map(rounded));
            }
            object
        });
        json!({
            "planner": forecast.planner.report(),
            "verdict": forecast.verdict().code(),
            "can_be_done": match forecast.verdict() {
                PlanVerdict::CanBeDone => json!(true),
                PlanVerdict::Undecided => Value::Null,
                PlanVerdict::Likely | PlanVerdict::Unlikely | PlanVerdict::CannotBeDone => json!(false),
            },
            "endings": forecast.endings().iter().map(ending).collect::<Vec<_>>(),
            "predicted_plate_time_s": range,
            "speed_mm_s": forecast.speed_mps.map(|[asked, held]| json!({ "asked": rounded(mm(asked)), "can_be_held": rounded(mm(held)) })),
            "smallest_gap": nearest,
            "limits_met": forecast.limits_met().iter().map(met).collect::<Vec<_>>(),
            "independence": {
                "of": if forecast.fields { "fields" } else { "rotations" },
                "singular_values": forecast.independence.singular_values.iter().map(|&s| rounded(s)).collect::<Vec<_>>(),
                "share": rounded(forecast.independence.share()),
                "weakest_part": forecast.independence.weakest.and_then(|(part, _)| id(part)),
                "weakest_direction_deg": forecast.independence.weakest.map(|(_, direction)| degrees(direction)),
            },
            "friction_spread": forecast.friction_spread,
            "parts": parts.collect::<Vec<_>>(),
            "dry_runs": dry_runs.collect::<Vec<_>>(),
        })
    }
}

fn figures(forecast: &Forecast) -> Vec<(&'static str, String)> {
    let (completed, all) = (forecast.completed(), forecast.dry_runs.len());
    let verdict = match forecast.verdict() {
        PlanVerdict::CanBeDone => "can be done",
        PlanVerdict::Likely => "likely done",
        PlanVerdict::Unlikely => "unlikely",
        PlanVerdict::CannotBeDone => "cannot be done",
        PlanVerdict::Undecided => "undecided",
    };
    let mut figures = vec![(verdict, format!("{completed} of {all} dry runs reach the goal"))];
    for (reason, times) in forecast.endings() {
        figures.push(("", format!("{times} of {all}: {reason}")));
    }
    figures.push(("planner", planner_line(&forecast.planner.report())));
    let median = |figure: fn(&DryRun) -> f64| forecast.range(figure).map_or(0.0, |[_, median, _]| median);
    if let Some([least, middle, most]) = forecast.range(|dry_run| dry_run.plate_time_s) {
        let cycles = median(|dry_run| dry_run.cycles as f64);
        let pulses = median(|dry_run| dry_run.pulses as f64);
        let text =
            format!("{middle:.1} s of plate time ({least:.1} to {most:.1}), {cycles:.0} cycles, {pulses:.0} pulses");
        figures.push(("predicted", text));
    }
    if let Some([asked_mps, held_mps]) = forecast.speed_mps {
        let late = if asked_mps > held_mps { ", laps will be late" } else { "" };
        let text = format!("up to {:.1} mm/s can be held, {:.1} asked{late}", mm(held_mps), mm(asked_mps));
        figures.push(("speed", text));
    }
    let id = |part: usize| forecast.parts.get(part).map_or("?", |part| part.id.as_str());
    if let Some(ClosestApproach { gap_m, parts: [a, b], at_s }) = forecast.nearest() {
        let gap = if gap_m < 0.0 { "none, they touch".into() } else { format!("{:.1} mm", mm(gap_m)) };
        figures.push(("smallest gap", format!("{} and {} at {at_s:.1} s: {gap}", id(a), id(b))));
    }
    for LimitMet { limit, times } in forecast.limits_met() {
        figures.push(("limit met", format!("{limit}, in {times} plans")));
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;
    use upm_runner::run::job_library;

    #[test]
    fn plan_on_a_knocked_rig_reports_that_dry_runs_leave_out_knocks() {
        let said = |job: &str| {
            let job = JobSpec::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("configs").join(job)).unwrap();
            let library = job_library(&job).unwrap();
            let lines = PlanReport::of(&job, &library, ProgressMode::Hidden).unwrap().lines();
            lines.iter().filter(|line| line.contains("dry runs leave out the knocks")).count()
        };
        assert_eq!([said("hold-4.json"), said("arrange-2.json")], [1, 0]);
    }
}
