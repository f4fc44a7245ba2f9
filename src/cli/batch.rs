//! `upm run --seeds`: runs one job with many seeds on all cores and summarises the figures of all runs.

mod histogram;
mod seeds;
mod summary;
mod table;
mod workers;

use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

use super::args::{Common, RunArgs};
use super::lab;
use super::output::{Failure, INTERRUPTED, print_json, stop_on_interrupt};
use super::progress::{LateProgress, ProgressMode};
use super::recording;
use super::run::{USUAL_OUT, load_job, utc_now};
use histogram::Histogram;
use seeds::Seeds;
use summary::BatchSummary;
use upm_control::EventLevel;
use upm_core::job::Pace;
use upm_core::time::{Clock, MonotonicClock};
use upm_recording::RerunMode;
use upm_runner::run::job_library;
use workers::{BatchProgress, SeedBatch};

/// Runs the job in `file` with each of the seeds that `--seeds` names.
pub(super) fn batch(file: &Path, seeds: &str, args: &RunArgs, common: Common) -> Result<u8, Failure> {
    let seeds: Seeds = seeds.parse().map_err(|error| Failure::bad_input(format!("--seeds: {error}")))?;
    let rerun = recording_mode(args)?;
    check_pace(args.pace)?;
    let job = load_job(file, args)?;
    // a library that does not fit is reported once, not for every seed
    job_library(&job).map_err(Failure::faults)?;
    let (clock, started_utc) = (MonotonicClock::new(), utc_now());
    let in_usual = || Path::new(USUAL_OUT).join(format!("{}-seeds-{started_utc}", job.name));
    let out = args.out.clone().unwrap_or_else(in_usual);
    let interrupted = stop_on_interrupt();
    let seeds = seeds.as_slice();
    let runs = {
        let batch =
            SeedBatch { job: &job, seeds, out: out.clone(), started_utc, rerun, clock, interrupted: &interrupted };
        let mut progress = BatchMeter::new(common, clock, seeds.len());
        let runs = batch.run(|update| progress.show(update));
        progress.shown.finish();
        runs
    };
    let summary = BatchSummary::new(
        [&job.name, &job.rig.model.name],
        job.camera,
        seeds.len(),
        clock.elapsed().as_secs_f64(),
        runs,
    );
    let files = write(&summary, &out)?;
    if common.json {
        print_json(&summary)?;
    } else {
        print(&summary, &out, &files)?;
    }
    Ok(if interrupted.load(Ordering::Relaxed) { INTERRUPTED } else { summary.status() })
}

/// Recording mode of a batch. Streaming to a viewer is refused: many runs at once would be unreadable in it.
fn recording_mode(args: &RunArgs) -> Result<RerunMode, Failure> {
    let Some(text) = &args.rerun else { return Ok(RerunMode::Off) };
    match recording::checked_mode(text)? {
        mode @ (RerunMode::Off | RerunMode::Save) => Ok(mode),
        mode => Err(Failure::bad_input(format!("--rerun: expected off or save (with --seeds), found {mode}"))),
    }
}

/// Refuses real-time pace: runs that share the cores cannot keep it.
fn check_pace(pace: Pace) -> Result<(), Failure> {
    match pace {
        Pace::Max => Ok(()),
        Pace::RealTime => {
            Err(Failure::bad_input(format!("--pace: expected max (with --seeds), found {}", pace.code())))
        }
    }
}

/// Progress bar of a batch on stderr, with the messages of its runs.
struct BatchMeter {
    shown: LateProgress<MonotonicClock>,
    seeds: usize,
}

impl BatchMeter {
    fn new(common: Common, clock: MonotonicClock, seeds: usize) -> Self {
        Self { shown: LateProgress::new(ProgressMode::on_stderr(common), clock), seeds }
    }

    fn show(&mut self, update: BatchProgress) {
        match update {
            BatchProgress::Progress { share, ended } => {
                let seeds = self.seeds;
                self.shown.show(share, || format!("{ended} of {seeds} runs have ended"));
            }
            BatchProgress::Note { seed, level, text } => self.shown.suspend(|| match level {
                EventLevel::Info => tracing::debug!(seed, "{text}"),
                EventLevel::Warning => tracing::info!(seed, "{text}"),
                EventLevel::Error => tracing::warn!(seed, "{text}"),
            }),
        }
    }
}

/// Writes `summary.json` and, where this build can draw, the chart of plate times; returns the paths in this order.
fn write(summary: &BatchSummary, out: &Path) -> Result<Vec<PathBuf>, Failure> {
    std::fs::create_dir_all(out).map_err(|error| Failure::write(out, error))?;
    let text = serde_json::to_string_pretty(summary).map_err(Failure::failed)? + "\n";
    let mut files = vec![(out.join("summary.json"), text)];
    let chart = Histogram::of(&summary.plate_times_s()).and_then(|histogram| {
        let median_s = summary.figures.get("plate_time_s")?.median;
        let (name, rig, completed) = (&summary.name, &summary.rig, summary.completed);
        Some(histogram.chart(&format!("{name} on {rig}: plate time of {completed} completed runs"), median_s))
    });
    if let Some(chart) = chart
        && let Ok(drawn) = lab::svg(&chart)
    {
        files.push((out.join(format!("{}.svg", chart.name)), drawn));
    }
    for (path, text) in &files {
        std::fs::write(path, text).map_err(|error| Failure::write(path, error))?;
    }
    Ok(files.into_iter().map(|(path, _)| path).collect())
}

/// Prints the table, on a terminal a histogram below it, and the paths of the files.
fn print(summary: &BatchSummary, out: &Path, files: &[PathBuf]) -> Result<(), Failure> {
    table::lines(summary).iter().try_for_each(|line| outln!("{line}"))?;
    let histogram = Histogram::of(&summary.plate_times_s()).filter(|_| std::io::stdout().is_terminal());
    if let Some(histogram) = histogram {
        outln!("  plate time (s)        runs")?;
        histogram.lines().iter().try_for_each(|line| outln!("  {line}"))?;
    }
    outln!("  {:15} {}", "run folders", out.display())?;
    files.iter().try_for_each(|path| outln!("  {:15} {}", "written", path.display()))
}
