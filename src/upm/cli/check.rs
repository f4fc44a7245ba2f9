mod coverage_report;
mod picture;
mod plan;
mod plan_picture;
mod plan_statistics;
mod plan_table;

use std::path::Path;

use serde_json::{Value, json};

use super::args::{CheckArgs, Common};
use super::output::{BAD_INPUT, Failure, NOT_REACHED, print_json};
use super::progress::ProgressMode;
use coverage_report::CoverageReport;
use plan::PlanReport;
use upm_planning::cor_library::Library;
use upm_runner::config::{self, DaemonSpec, Diagnostic, Document, JobSpec, PlateSpec, RigSpec, SimulateSpec, text_of};
use upm_runner::run::{PlannerSelection, check_simulate, job_library, library_faults, load_library, tolerance_warning};

/// Contents of a valid file.
struct ValidFile {
    /// Description on one line.
    says: String,
    /// Coverage of a library, or the forecast of a job, if requested.
    report: Option<FileReport>,
    /// Warnings of tolerances tighter than the rig can hold. A job with warnings is valid.
    warnings: Vec<String>,
}

enum FileReport {
    Coverage(CoverageReport),
    Plan(PlanReport),
}

/// Contents of a file, or its faults.
type CheckFinding = Result<ValidFile, Vec<String>>;

pub(super) fn check(args: &CheckArgs, common: Common) -> Result<u8, Failure> {
    if let Some(path) = &args.picture {
        check_picture_name(path, args.files.len())?;
    }
    let rig = args.rig.as_deref().map(RigSpec::load).transpose().map_err(Failure::of_files)?;
    let asked = CheckRequest { rig: rig.as_ref(), plan: args.plan, progress: ProgressMode::on_stderr(common) };
    let findings: Vec<(&Path, CheckFinding)> =
        args.files.iter().map(|path| (path.as_path(), check_file(path, asked))).collect();
    for (file, finding) in &findings {
        let Ok(ValidFile { says, report, .. }) = finding else { continue };
        let file = file.display();
        if args.plan && !matches!(report, Some(FileReport::Plan(_))) {
            return Err(Failure::bad_input(format!("--plan: expected jobs alone, found {file}, a {says}")));
        }
        if let Some(picture) = &args.picture {
            let line = format!("--picture: expected one library or, with --plan, one job, found {file}, a {says}");
            let chart = match report.as_ref().ok_or_else(|| Failure::bad_input(line))? {
                FileReport::Coverage(covered) => picture::coverage_chart(&covered.coverage, &covered.rig_name),
                FileReport::Plan(planned) => plan_picture::plan_chart(planned),
            };
            std::fs::write(picture, upm_chart::svg(&chart)).map_err(|error| Failure::write(picture, error))?;
        }
    }
    if common.json {
        print_json(&findings.iter().map(|(path, finding)| row(path, finding)).collect::<Vec<_>>())?;
    } else {
        findings.iter().try_for_each(|(path, finding)| print(path, finding))?;
    }
    Ok(findings.iter().map(|(_, finding)| status(finding)).max().unwrap_or(0))
}

/// Exit status for the finding of a file.
fn status(finding: &CheckFinding) -> u8 {
    match finding {
        Err(_) => BAD_INPUT,
        Ok(ValidFile { report: Some(FileReport::Plan(plan)), .. }) if plan.verdict().is_failure() => NOT_REACHED,
        Ok(_) => 0,
    }
}

/// Checks requested besides validity.
#[derive(Clone, Copy)]
struct CheckRequest<'a> {
    /// Rig that replaces that of jobs, and that libraries must have been measured on.
    rig: Option<&'a RigSpec>,
    /// True to make dry runs of jobs.
    plan: bool,
    progress: ProgressMode,
}

fn check_picture_name(path: &Path, files: usize) -> Result<(), Failure> {
    if files != 1 {
        return Err(Failure::bad_input(format!(
            "--picture: expected one library or, with --plan, one job, found {files} files to check"
        )));
    }
    if !path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("svg")) {
        return Err(Failure::bad_input(format!("--picture: expected a name ending in svg, found {}", path.display())));
    }
    Ok(())
}

fn row(path: &Path, finding: &CheckFinding) -> Value {
    let found = finding.as_ref().ok();
    let mut row = json!({
        "file": path.display().to_string(),
        "valid": finding.is_ok(),
        "says": found.map(|found| &found.says),
        "faults": finding.as_ref().err(),
    });
    match found.and_then(|found| found.report.as_ref()) {
        Some(FileReport::Coverage(covered)) => row["coverage"] = covered.json(),
        Some(FileReport::Plan(planned)) => row["plan"] = planned.json(),
        None => {}
    }
    if let Some(found) = found.filter(|found| !found.warnings.is_empty()) {
        row["warnings"] = json!(found.warnings);
    }
    row
}

fn print(path: &Path, finding: &CheckFinding) -> Result<(), Failure> {
    match finding {
        Ok(found) => {
            outln!("{}: ok, {}", path.display(), found.says)?;
            let lines = match &found.report {
                Some(FileReport::Coverage(covered)) => covered.lines(),
                Some(FileReport::Plan(planned)) => planned.lines(),
                None => Vec::new(),
            };
            lines.iter().try_for_each(|line| outln!("  {line}"))?;
            found.warnings.iter().for_each(|warning| errln!("upm: warning: {warning}"));
        }
        Err(faults) => faults.iter().for_each(|fault| errln!("upm: {fault}")),
    }
    Ok(())
}

/// Validates a file as the kind that its keys indicate; a library also against the rig given.
fn check_file(path: &Path, asked: CheckRequest<'_>) -> CheckFinding {
    let value = text_of(path).ok().and_then(|text| serde_json::from_str::<Value>(&text).ok());
    let says = match value.as_ref().and_then(Document::of) {
        Some(Document::Library) => return check_library(path, asked.rig),
        Some(Document::Experiment) => {
            let experiment = SimulateSpec::load(path).map_err(lines)?;
            check_simulate(&experiment).map_err(|error| vec![format!("{}: {error}", path.display())])?;
            format!("experiment, {} pulses on {} parts", experiment.pulses.len(), experiment.parts.len())
        }
        Some(Document::Trace) => {
            let trace = config::load_trace(path).map_err(lines)?.trace;
            format!("trace, 4 channels of {} samples at {:.0} Hz", trace.len(), trace.sample_hz)
        }
        Some(Document::Daemon) => check_daemon(path)?,
        Some(Document::Rig) => check_rig(path)?,
        Some(Document::Job) | None => return check_job(path, asked),
    };
    Ok(ValidFile { says, report: None, warnings: Vec::new() })
}

/// Validates a daemon file with the rigs it names and their libraries.
fn check_daemon(path: &Path) -> Result<String, Vec<String>> {
    let daemon = DaemonSpec::load(path).map_err(lines)?;
    let fitting = |plate: &PlateSpec| load_library(&plate.library, &plate.library_key, &plate.rig);
    let faults: Vec<String> = daemon.plates.iter().filter_map(|plate| fitting(plate).err()).flat_map(lines).collect();
    let says = format!("daemon on {}, plates: {}", daemon.listen, daemon.plate_names().join(", "));
    if faults.is_empty() { Ok(says) } else { Err(faults) }
}

/// Validates a rig file with the library it names.
fn check_rig(path: &Path) -> Result<String, Vec<String>> {
    let rig = RigSpec::load(path).map_err(lines)?;
    let library = match &rig.library {
        Some(library) => {
            let library = load_library(library, &rig.library_key, &rig).map_err(lines)?;
            format!("library of {} motions", library.entries.len())
        }
        None => "no library (`upm calibrate` makes one)".to_owned(),
    };
    Ok(format!("rig {}, {:.0} mm plate, {library}", rig.model.name, rig.model.plate_side_m * 1e3))
}

fn check_job(path: &Path, asked: CheckRequest<'_>) -> CheckFinding {
    let job = match asked.rig {
        Some(rig) => JobSpec::load_on(path, rig),
        None => JobSpec::load(path),
    };
    let job = job.map_err(lines)?;
    let lines_of = |fault: Diagnostic| vec![fault.to_string()];
    let library = job_library(&job).map_err(lines)?;
    let (rig, parts, planner) =
        (&job.rig.model.name, job.kinds_of_parts().len(), PlannerSelection::with_forecast(&job, &library));
    let says = format!("job {} on {rig}, parts: {parts}, planner: {}", job.name, planner.name());
    let planned =
        asked.plan.then(|| PlanReport::of(&job, &library, planner, asked.progress)).transpose().map_err(lines_of)?;
    let warnings = lines(tolerance_warning(&job, &library).into_iter().collect());
    Ok(ValidFile { says, report: planned.map(FileReport::Plan), warnings })
}

fn check_library(path: &Path, rig: Option<&RigSpec>) -> CheckFinding {
    let library = Library::load(path).map_err(lines)?;
    let faults = rig.map(|rig| library_faults(&library, &path.display().to_string(), rig)).unwrap_or_default();
    if !faults.is_empty() {
        return Err(lines(faults));
    }
    let says = format!("library of {}, {} motions", library.rig, library.entries.len());
    let report = Some(FileReport::Coverage(CoverageReport::by(&library)));
    Ok(ValidFile { says, report, warnings: Vec::new() })
}

fn lines<F: std::fmt::Display>(faults: Vec<F>) -> Vec<String> {
    faults.iter().map(ToString::to_string).collect()
}
