use super::output::Failure;
use super::progress::behind;
use upm_core::document::counted;
use upm_core::job::CameraMode;
use upm_recording::{
    AccuracyReport, CycleError, PacingReport, PathReport, PlannerReport, PredictionError, Report, Verdict, WorkReport,
};
use upm_runner::config::JobSpec;
use upm_runner::run::RunResult;

/// Prints the result of a run as text; [`rows`] explains `verbose`.
pub(super) fn print_summary(job: &JobSpec, result: &RunResult, verbose: bool) -> Result<(), Failure> {
    let Report { name, seed, outcome, reason, .. } = &result.report;
    outln!("{name} on {}, seed {seed}: {}: {reason}", job.rig.model.name, outcome.code())?;
    for (label, text) in rows(&result.report, verbose) {
        outln!("  {label:15} {text}")?;
    }
    outln!("  {:15} {}", "run folder", result.folder.display())?;
    if result.folder.join("run.rrd").exists() {
        outln!("  {:15} upm replay {}", "watch it", result.folder.display())?;
    }
    Ok(())
}

/// Figures of a run with their labels; `verbose` adds the errors of forecasts, cycles and sensing.
pub(super) fn rows(report: &Report, verbose: bool) -> Vec<(&'static str, String)> {
    let faster = report.plate_time_s / report.wall_time_s.max(1e-9);
    let WorkReport { frames, cycles, pulses, laps, collisions, lost_parts, ref tasks_from_s } = report.work;
    let mut rows = vec![
        (
            "plate time",
            format!("{:.1} s, run in {:.1} s ({faster:.1} times faster)", report.plate_time_s, report.wall_time_s),
        ),
        ("work", format!("{cycles} cycles, {pulses} pulses, {frames} frames")),
    ];
    if report.camera != CameraMode::Pixels {
        rows.push(("camera", "positions in place of pictures".into()));
    }
    if let Some(planner) = &report.planner {
        rows.push(("planner", planner_line(planner)));
    }
    if let Some(PacingReport { deadline_misses: misses, worst_late_frames: worst, behind_s }) = report.pacing {
        let missed = format!("{misses} missed, by up to {}{}", counted(worst as usize, "frame"), behind(behind_s));
        rows.push(("deadlines", if misses == 0 { "none missed".into() } else { missed }));
    }
    if !tasks_from_s.is_empty() {
        let from = tasks_from_s.iter().map(|from_s| format!("{from_s:.1}")).collect::<Vec<_>>().join(", ");
        rows.push(("tasks", format!("{} begun, at {from} s", tasks_from_s.len())));
    }
    if laps > 0 {
        rows.push(("laps", laps.to_string()));
    }
    let PathReport { cross_track_rms_mm, cross_track_max_mm, travel_ratio, .. } = report.path;
    if let (Some(rms), Some(max)) = (cross_track_rms_mm, cross_track_max_mm) {
        let travel = travel_ratio.map(|ratio| format!("; {ratio:.2} of the path's length gone")).unwrap_or_default();
        rows.push(("cross-track", format!("{rms:.2} mm rms, {max:.2} mm at most, over all frames{travel}")));
    }
    if let (Some(asked), Some(held)) = (report.path.speed_asked_mm_s, report.path.speed_held_mm_s) {
        rows.push(("speed", format!("{held:.1} mm/s held of {asked:.1} asked ({:.0} %)", 100.0 * held / asked)));
    }
    if let Some(most) = report.path.phase_error_max {
        rows.push(("phase error", format!("{:.1} % of a period at most", 100.0 * most)));
    }
    if verbose {
        rows.extend(loop_errors(&report.accuracy));
    }
    if report.verdict == Some(Verdict::FalseSuccess) {
        rows.push(("false success", "the truth says that a part is not at its place".to_owned()));
    }
    if let Some(error) = report.accuracy.max_error_mm {
        rows.push(("final error", format!("{error:.2} mm at most")));
    }
    if let Some(collisions) = collisions.filter(|&touches| touches > 0) {
        rows.push(("collisions", collisions.to_string()));
    }
    if lost_parts > 0 {
        rows.push(("lost parts", lost_parts.to_string()));
    }
    rows
}

/// Errors of forecasts, cycles and sensing.
fn loop_errors(accuracy: &AccuracyReport) -> impl Iterator<Item = (&'static str, String)> {
    let prediction = accuracy.prediction_error_mm.map(|PredictionError { library, learned }| {
        ("forecast error", format!("{library:.3} mm rms from calibration, {learned:.3} mm after learning"))
    });
    let cycle = accuracy.cycle_error_mm.map(|CycleError { mean, max }| {
        ("cycle error", format!("{mean:.2} mm off the subgoals, {max:.2} mm at most (E, mean of the parts)"))
    });
    let sensing =
        accuracy.sensing_rms_error_mm.map(|rms| ("sensing error", format!("{rms:.3} mm rms against the truth")));
    [prediction, cycle, sensing].into_iter().flatten()
}

/// The planner, the reason for it, and the alternatives on this rig.
pub(super) fn planner_line(PlannerReport { name, why, alternatives, .. }: &PlannerReport) -> String {
    format!("{name}: {why}; also possible: {}", alternatives.join(", "))
}
