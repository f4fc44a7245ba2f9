use std::path::Path;

use super::args::{Common, RunArgs};
use super::output::{BAD_INPUT, Failure, INTERRUPTED, NOT_REACHED, check_ending, print_json, stop_on_interrupt};
use super::progress::RunProgress;
use super::shipped::is_shipped;
use super::summary::print_summary;
use super::{job_changes, job_list};
use upm_control::Sink;
use upm_core::job::{CameraMode, Outcome, Pace};
use upm_core::time::MonotonicClock;
use upm_recording::{Fanout, RecordingOptions, Report, Verdict};
use upm_runner::config::{Diagnostic, DiagnosticClass, JobSpec};
use upm_runner::run::{self, OwnParts, PacingStats, RunError, RunOptions, job_warnings, library_and_places};
use upm_viewer::USUAL_MODE;

/// Default folder for run folders.
pub(super) const USUAL_OUT: &str = "runs";

pub(super) fn run(args: &RunArgs, common: Common) -> Result<u8, Failure> {
    let Some(file) = &args.job else { return job_list::list(common) };
    let rerun = args.rerun.clone().unwrap_or(USUAL_MODE);
    if let Some(path) = &args.movie {
        check_ending("--movie", path, &["gif"])?;
        if args.camera == CameraMode::Positions {
            return Err(Failure::bad_input("--camera: expected pixels (with --movie), found positions"));
        }
    }
    let job = load_job(file, args)?;
    let library = library_and_places(&job).map_err(Failure::faults)?;
    let warnings: Vec<String> = job_warnings(&job, &library).iter().map(ToString::to_string).collect();
    warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
    let mut movie = args.movie.as_deref().map(|path| run::movie(&job, path)).transpose()?;
    let clock = MonotonicClock::new();
    let real_time = args.pace == Pace::RealTime;
    let options = RunOptions {
        out: args.out.clone().unwrap_or_else(|| USUAL_OUT.into()),
        started_utc: utc_now(),
        rerun,
        real_time,
        recording_options: RecordingOptions { has_clock: real_time, ..RecordingOptions::lossless(clock) },
    };
    let stop = stop_on_interrupt();
    let pacing = PacingStats::default();
    let mut progress = RunProgress::new(common, &pacing);
    let mut sinks = Fanout { sinks: vec![&mut progress], after_frame: None };
    sinks.sinks.extend(movie.as_mut().map(|movie| movie as &mut dyn Sink));
    let result = run::run(&job, library, (&options, OwnParts::default()), &clock, &stop, &pacing, &mut sinks);
    progress.finish();
    let result = result?;
    for warning in result.report.incidents.warnings.iter().filter(|warning| !warnings.contains(warning)) {
        tracing::warn!("{warning}");
    }
    if common.json {
        print_json(&result.report)?;
    } else {
        print_summary(&job, &result, common.verbose > 0)?;
    }
    if let (Some(movie), Some(path)) = (movie, &args.movie) {
        movie.finish().map_err(|error| Failure::write(path, error))?;
    }
    Ok(status_of(&result.report))
}

/// The job in `file` with the changes of the command line.
pub(super) fn load_job(file: &Path, args: &RunArgs) -> Result<JobSpec, Failure> {
    job_changes::read_dash([file])?;
    let job = job_changes::load(file, &args.changes)?;
    let mut job = job.map_err(|faults| read_failed(file, faults))?;
    if let Some(seed) = args.seed {
        job = job.with_seed(seed);
    }
    job = job.with_camera(args.camera).with_faults(&args.faults).map_err(Failure::faults)?;
    #[cfg(feature = "mutants")]
    {
        job.without_guard = args.without_guard;
    }
    Ok(job)
}

/// Exit status of a run with this report.
pub(super) fn status_of(report: &Report) -> u8 {
    match report.outcome {
        Outcome::Completed if report.verdict == Some(Verdict::FalseSuccess) => NOT_REACHED,
        Outcome::Completed => 0,
        Outcome::Failed => NOT_REACHED,
        Outcome::Cancelled => INTERRUPTED,
    }
}

/// Failure by the faults of the job in `file`; if it cannot be read, with a hint where to find jobs.
fn read_failed(file: &Path, faults: Vec<Diagnostic>) -> Failure {
    let is_read = !faults.iter().any(|fault| fault.class == DiagnosticClass::Unreadable && fault.named_by.is_none());
    let mut failure = Failure::of_files(faults);
    if !is_read && !is_shipped(&file.display().to_string()) {
        failure.lines.iter_mut().for_each(|line| line.push_str("; `upm run` lists the jobs there are"));
    }
    failure
}

impl From<RunError> for Failure {
    fn from(error: RunError) -> Self {
        Self { status: if error.is_bad_input() { BAD_INPUT } else { NOT_REACHED }, lines: error.lines() }
    }
}

/// Wall time in folder names, `20260101T000000Z`.
pub(super) fn utc_now() -> String {
    jiff::Timestamp::now().strftime("%Y%m%dT%H%M%SZ").to_string()
}
