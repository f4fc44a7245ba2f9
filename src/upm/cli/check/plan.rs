//! Forecast of a job, as text and as JSON.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use serde_json::{Value, json};

use super::coverage::{degrees, place_json, shown, steps};
use crate::cli::progress::LateProgress;
use crate::cli::summary::planner_line;
use upm_core::units::mm_from_m;
use upm_planning::cor_library::Library;
use upm_recording::{Report, rounded};
use upm_runner::config::{Diagnostic, JobSpec};
use upm_runner::run::{ClosestApproach, Forecast, PartForecast, PlaceReach, PlanVerdict, dry_run};

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
        let forecast = dry_run(job, seeds, library, &AtomicBool::new(false), &mut |at, done| {
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
        self.forecast.dry_runs.verdict()
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
        let plate_time = forecast.dry_runs.bracket_s().map(|[least, median, most]| {
            json!({ "least": rounded(least), "median": rounded(median), "most": rounded(most) })
        });
        let smallest_gap = forecast.dry_runs.nearest().map(|ClosestApproach { gap_m, parts, at_s }| {
            json!({ "gap_mm": rounded(mm_from_m(gap_m)), "parts": parts.map(id), "at_s": rounded(at_s) })
        });
        let ending = |(reason, times): &(&str, usize)| json!({ "reason": reason, "times": times });
        let met = |(limit, cycles): &(&str, u64)| json!({ "limit": limit, "cycles": cycles });
        let dry_runs = forecast.dry_runs.0.iter().map(|dry_run| {
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
            "endings": forecast.dry_runs.endings().iter().map(ending).collect::<Vec<_>>(),
            "predicted_plate_time_s": plate_time,
            "speed_mm_s": forecast.speed_mps.map(|[asked, held]| json!({ "asked": rounded(mm_from_m(asked)), "can_be_held": rounded(mm_from_m(held)) })),
            "smallest_gap": smallest_gap,
            "limits_met": forecast.dry_runs.limits_met().iter().map(met).collect::<Vec<_>>(),
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
    let (completed, all) = (forecast.dry_runs.completed().count(), forecast.dry_runs.0.len());
    let verdict = forecast.dry_runs.verdict().text();
    let mut figures = vec![(verdict, format!("{completed} of {all} dry runs reach the goal"))];
    for (reason, times) in forecast.dry_runs.endings() {
        figures.push(("", format!("{times} of {all}: {reason}")));
    }
    figures.push(("planner", planner_line(&forecast.planner.report)));
    if let Some([least, middle, most]) = forecast.dry_runs.bracket_s() {
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
    if let Some(ClosestApproach { gap_m, parts: [a, b], at_s }) = forecast.dry_runs.nearest() {
        let gap = if gap_m < 0.0 { "none, they touch".into() } else { format!("{:.1} mm", mm_from_m(gap_m)) };
        figures.push(("smallest gap", format!("{} and {} at {at_s:.1} s: {gap}", id(a), id(b))));
    }
    for (limit, cycles) in forecast.dry_runs.limits_met() {
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
