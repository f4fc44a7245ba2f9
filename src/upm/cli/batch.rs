//! `upm run --seeds`: runs one job with many seeds on all cores and summarises the figures of all runs.

mod seeds;
mod summary;
mod workers;

use std::path::Path;
use std::sync::atomic::Ordering;

use parking_lot::Mutex;

use super::args::{Common, RunArgs};
use super::output::{Failure, INTERRUPTED, print, stop_on_interrupt};
use super::progress::LateProgress;
use super::run::{USUAL_OUT, load_job, utc_now};
pub use seeds::Seeds;
use summary::BatchSummary;
use upm_core::job::Pace;
use upm_core::time::{Clock, MonotonicClock};
use upm_recording::RerunMode;
use upm_runner::run::library_and_places;
use workers::{BatchProgress, SeedBatch};

/// Runs the job in `file` with each of the seeds that `--seeds` names.
pub(super) fn batch(file: &Path, seeds: &Seeds, args: &RunArgs, common: Common) -> Result<u8, Failure> {
    let rerun = args.rerun.clone().unwrap_or(RerunMode::Off);
    if !matches!(rerun, RerunMode::Off | RerunMode::Save) {
        // many runs at once would be unreadable in a viewer
        return Err(Failure::bad_input(format!("--rerun: expected off or save (with --seeds), found {rerun}")));
    }
    if args.pace == Pace::RealTime {
        // runs that share the cores cannot keep it
        let found = args.pace.code();
        return Err(Failure::bad_input(format!("--pace: expected max (with --seeds), found {found}")));
    }
    let job = load_job(file, args)?;
    let library = library_and_places(&job).map_err(Failure::faults)?;
    let (clock, started_utc) = (MonotonicClock::new(), utc_now());
    let name = &job.name[..job.name.floor_char_boundary(200)];
    let in_usual = || Path::new(USUAL_OUT).join(format!("{name}-seeds-{started_utc}"));
    let out = args.out.clone().unwrap_or_else(in_usual);
    let interrupted = stop_on_interrupt();
    let seeds = seeds.as_slice();
    let progress = Mutex::new(BatchProgress::new(seeds.len(), LateProgress::new(common)));
    let (job, out_of_runs, interrupted) = (&job, out.clone(), &interrupted);
    let batch = SeedBatch { job, library, seeds, out: out_of_runs, started_utc, rerun, clock, interrupted, progress };
    let runs = batch.run();
    let (names, wall_time_s) = ([job.name.as_str(), &job.rig.model.name], clock.elapsed().as_secs_f64());
    let summary = BatchSummary::new(names, job.camera, seeds.len(), wall_time_s, runs);
    let file = out.join("summary.json");
    std::fs::create_dir_all(&out).map_err(|error| Failure::write(&out, error))?;
    let text = serde_json::to_string_pretty(&summary).map_err(Failure::failed)? + "\n";
    std::fs::write(&file, text).map_err(|error| Failure::write(&file, error))?;
    print(common.json, &summary, || {
        summary::lines(&summary).iter().try_for_each(|line| outln!("{line}"))?;
        outln!("  {:15} {}", "run folders", out.display())?;
        outln!("  {:15} {}", "written", file.display())
    })?;
    Ok(if interrupted.load(Ordering::Relaxed) { INTERRUPTED } else { summary.status() })
}
