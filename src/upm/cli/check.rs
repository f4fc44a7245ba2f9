mod coverage;
mod plan;
mod plan_picture;

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::args::{CheckArgs, Common};
use super::job_changes::read_dash;
use super::output::{BAD_INPUT, Failure, NOT_REACHED, check_ending, print_json};
use super::progress::LateProgress;
use plan::PlanReport;
use upm_chart::Chart;
use upm_core::document::counted;
use upm_planning::cor_library::Library;
use upm_runner::campaign::{Campaign, Seeds};
use upm_runner::config::{self, DaemonSpec, Document, JobSpec, PlateSpec, RigSpec, SimulateSpec, text_of};
use upm_runner::run::{
    Coverage, PlannerSelection, check_simulate, job_warnings, library_and_places, library_faults, load_library,
};
use upm_viewer::RerunSink;

/// Largest number of dry runs of a job, which run at the same time.
const MOST_DRY_RUNS: usize = 32;

/// Beginning of a refusal of `--picture`.
const PICTURE: &str = "--picture: expected one library or, with --plan, one job";

/// Contents of a valid file.
pub(super) struct ValidFile {
    /// Description on one line.
    says: String,
    /// Coverage of a library, or the forecast of a job, if requested.
    report: Option<FileReport>,
    /// Warnings of drawings, and of tolerances, speeds and limits that the rig cannot hold. A job with warnings is
    /// valid.
    warnings: Vec<String>,
}

impl ValidFile {
    pub fn new(says: String) -> Self {
        Self { says, report: None, warnings: Vec::new() }
    }
}

/// Coverage of a library or forecast of a job, in the forms in which it is shown.
struct FileReport {
    /// Its key in the JSON output: `coverage` or `plan`.
    key: &'static str,
    lines: Vec<String>,
    json: Value,
    chart: Chart,
    /// True if the job is predicted to fail.
    is_failure: bool,
}

/// A valid file, or its faults.
pub(super) type CheckResult = Result<ValidFile, Vec<String>>;

pub(super) fn check(args: &CheckArgs, common: Common) -> Result<u8, Failure> {
    let refusal = |line: String| Err(Failure::bad_input(line));
    let files = args.files.len();
    if args.picture.is_some() && files != 1 {
        return refusal(format!("{PICTURE}, found {files} files to check"));
    }
    args.picture.iter().try_for_each(|path| check_ending("--picture", path, &["svg"]))?;
    let seeds = args.seeds.as_ref().map_or(0, |seeds| seeds.as_slice().len());
    if seeds > MOST_DRY_RUNS {
        return refusal(format!("--seeds: expected up to {MOST_DRY_RUNS} (with --plan), found {seeds}"));
    }
    read_dash(args.files.iter().map(PathBuf::as_path))?;
    let rig = args.rig.as_deref().map(RigSpec::load).transpose().map_err(Failure::of_files)?;
    let results: Vec<(&Path, CheckResult)> =
        args.files.iter().map(|path| (path.as_path(), check_file(path, rig.as_ref(), args, common))).collect();
    for (file, result) in &results {
        let Ok(ValidFile { says, report, .. }) = result else { continue };
        let file = file.display();
        if args.plan && report.as_ref().is_none_or(|report| report.key != "plan") {
            return refusal(format!("--plan: expected jobs alone, found {file}, a {says}"));
        }
        if let Some(picture) = &args.picture {
            let other = || Failure::bad_input(format!("{PICTURE}, found {file}, a {says}"));
            let chart = &report.as_ref().ok_or_else(other)?.chart;
            std::fs::write(picture, upm_chart::svg(chart)).map_err(|error| Failure::write(picture, error))?;
        }
    }
    show(&results, common)?;
    Ok(results.iter().map(|(_, result)| status(result)).max().unwrap_or(0))
}

/// Prints the results of files.
pub(super) fn show(results: &[(&Path, CheckResult)], common: Common) -> Result<(), Failure> {
    if common.json {
        print_json(&results.iter().map(|(path, result)| row(path, result)).collect::<Vec<_>>())
    } else {
        results.iter().try_for_each(|(path, result)| print(path, result))
    }
}

/// Exit status for the result of a file.
fn status(result: &CheckResult) -> u8 {
    match result {
        Err(_) => BAD_INPUT,
        Ok(ValidFile { report: Some(report), .. }) if report.is_failure => NOT_REACHED,
        Ok(_) => 0,
    }
}

fn row(path: &Path, result: &CheckResult) -> Value {
    let valid = result.as_ref().ok();
    let mut row = json!({
        "file": path.display().to_string(),
        "valid": result.is_ok(),
        "says": valid.map(|file| &file.says),
        "faults": result.as_ref().err(),
    });
    if let Some(report) = valid.and_then(|file| file.report.as_ref()) {
        row[report.key] = report.json.clone();
    }
    if let Some(file) = valid.filter(|file| !file.warnings.is_empty()) {
        row["warnings"] = json!(file.warnings);
    }
    row
}

fn print(path: &Path, result: &CheckResult) -> Result<(), Failure> {
    match result {
        Ok(file) => {
            outln!("{}: ok, {}", path.display(), file.says)?;
            let mut lines = file.report.iter().flat_map(|report| &report.lines);
            lines.try_for_each(|line| outln!("  {line}"))?;
            file.warnings.iter().for_each(|warning| errln!("upm: warning: {warning}"));
        }
        Err(faults) => faults.iter().for_each(|fault| errln!("upm: {fault}")),
    }
    Ok(())
}

/// Validates a file as the kind that its keys indicate; a library also against the rig given. Makes dry runs of a job
/// that is to be planned.
fn check_file(path: &Path, rig: Option<&RigSpec>, args: &CheckArgs, common: Common) -> CheckResult {
    let value = text_of(path).ok().and_then(|text| serde_json::from_str::<Value>(&text).ok());
    let says = match value.as_ref().and_then(Document::of) {
        Some(Document::Library) => return check_library(path, rig),
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
        Some(Document::Campaign) => {
            let campaign = Campaign::load(path).map_err(lines)?;
            let (runs, cells) = (counted(campaign.runs(), "run"), counted(campaign.cells(), "cell"));
            format!("campaign {}, {runs} in {cells}", campaign.name)
        }
        Some(Document::Coins) => format!("coins, {} kinds", config::load_coins(path).map_err(lines)?.len()),
        Some(Document::Job) | None => return check_job(path, rig, args, common),
    };
    Ok(ValidFile::new(says))
}

/// Validates a daemon file with the rigs it names and their libraries.
fn check_daemon(path: &Path) -> Result<String, Vec<String>> {
    let daemon = DaemonSpec::load(path).map_err(lines)?;
    let fitting = |plate: &PlateSpec| load_library(&plate.library, &plate.library_key, &plate.rig);
    let mut faults: Vec<String> =
        daemon.plates.iter().filter_map(|plate| fitting(plate).err()).flat_map(lines).collect();
    let rerun = daemon.rerun.iter().filter_map(|mode| RerunSink::check(mode).err());
    faults.extend(rerun.map(|error| format!("{}: rerun: {error}", path.display())));
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

fn check_job(path: &Path, rig: Option<&RigSpec>, args: &CheckArgs, common: Common) -> CheckResult {
    let loaded = rig.map_or_else(|| JobSpec::load(path), |rig| JobSpec::load_on(path, rig));
    let mut job = loaded.map_err(lines)?;
    let seeds = args.seeds.as_ref().map(Seeds::as_slice).unwrap_or_default();
    if let Some(&seed) = args.seed.as_ref().or(seeds.first()) {
        job = job.with_seed(seed);
    }
    let library = library_and_places(&job).map_err(lines)?;
    let (rig, parts, planner) = (&job.rig.model.name, job.kinds_of_parts().len(), PlannerSelection::of(&job));
    let says = format!("job {} on {rig}, parts: {parts}, planner: {}", job.name, planner.report.name);
    let mut report = None;
    if args.plan {
        let mut progress = LateProgress::new(common);
        let plan = PlanReport::of(&job, seeds, &library, &mut progress).map_err(|fault| vec![fault.to_string()])?;
        let (chart, is_failure) = (plan_picture::plan_chart(&plan), plan.verdict().is_failure());
        report = Some(FileReport { key: "plan", lines: plan.lines(), json: plan.json(), chart, is_failure });
    }
    let warnings = lines(job_warnings(&job, &library));
    Ok(ValidFile { says, report, warnings })
}

fn check_library(path: &Path, rig: Option<&RigSpec>) -> CheckResult {
    let library = Library::load(path).map_err(lines)?;
    let faults = rig.map(|rig| library_faults(&library, &path.display().to_string(), rig)).unwrap_or_default();
    if !faults.is_empty() {
        return Err(lines(faults));
    }
    let says = format!("library of {}, {} motions", library.rig, library.entries.len());
    let coverage = Coverage::of(&library);
    let (lines, json) = (coverage::lines(&coverage), coverage::json(&coverage));
    let chart = coverage::coverage_chart(&coverage, &library.rig);
    let report = Some(FileReport { key: "coverage", lines, json, chart, is_failure: false });
    Ok(ValidFile { says, report, warnings: Vec::new() })
}

fn lines<F: std::fmt::Display>(faults: Vec<F>) -> Vec<String> {
    faults.iter().map(ToString::to_string).collect()
}
