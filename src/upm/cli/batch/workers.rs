use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use parking_lot::Mutex;

use super::summary::SeedRun;
use crate::cli::output::NOT_REACHED;
use crate::cli::progress::LateProgress;
use crate::cli::run::{run_failure, status_of};
use upm_control::{CycleFacts, EventFacts, EventLevel, FrameFacts, Sink};
use upm_core::background::on_all_cores;
use upm_core::time::MonotonicClock;
use upm_planning::cor_library::Library;
use upm_recording::{RecordingOptions, RerunMode};
use upm_runner::config::JobSpec;
use upm_runner::run::{PacingStats, RunOptions, run as run_job};

/// Runs of one job with several seeds.
pub(super) struct SeedBatch<'a> {
    pub job: &'a JobSpec,
    /// Its library, which fits its rig.
    pub library: Arc<Library>,
    pub seeds: &'a [u64],
    pub out: PathBuf,
    /// Wall time in the names of the run folders.
    pub started_utc: String,
    pub rerun: RerunMode,
    pub clock: MonotonicClock,
    /// Set by Ctrl-C: runs in progress end, and no further run starts.
    pub interrupted: &'a AtomicBool,
    pub progress: Mutex<BatchProgress>,
}

/// Progress of all runs together.
pub(super) struct BatchProgress {
    shown: LateProgress,
    /// Progress of each run, 0 to 1.
    shares: Vec<f64>,
    ended: usize,
}

impl BatchProgress {
    pub fn new(seeds: usize, shown: LateProgress) -> Self {
        Self { shown, shares: vec![0.0; seeds], ended: 0 }
    }

    fn show(&mut self, index: usize, share: f64) {
        self.shares[index] = share.clamp(0.0, 1.0);
        let (ended, all) = (self.ended, self.shares.len());
        let share = self.shares.iter().sum::<f64>() / all as f64;
        self.shown.show(share, || format!("{ended} of {all} runs have ended"));
    }
}

impl SeedBatch<'_> {
    /// Runs the seeds in turn on all cores. Returns the runs that were started, in the order of the seeds.
    pub fn run(&self) -> Vec<SeedRun> {
        let seeds: Vec<(usize, u64)> = self.seeds.iter().copied().enumerate().collect();
        let runs = on_all_cores(&seeds, &|_| (), |&(index, seed)| {
            let run = (!self.interrupted.load(Ordering::Relaxed)).then(|| self.run_one(index, seed))?;
            let mut progress = self.progress.lock();
            progress.ended += 1;
            progress.show(index, 1.0);
            Some(run)
        });
        self.progress.lock().shown.finish();
        runs.into_iter().flatten().collect()
    }

    /// Runs one seed as `upm run --seed SEED` does.
    fn run_one(&self, index: usize, seed: u64) -> SeedRun {
        let options = RunOptions {
            out: self.out.clone(),
            started_utc: self.started_utc.clone(),
            rerun: self.rerun.clone(),
            real_time: false,
            recording_options: RecordingOptions::lossless(self.clock),
        };
        let stop = AtomicBool::new(false);
        let mut watcher = BatchWatcher { batch: self, index, seed, stop: &stop };
        let job = self.job.clone().with_seed(seed);
        let (library, pacing) = (Arc::clone(&self.library), PacingStats::default());
        match run_job(&job, library, &options, &self.clock, &stop, &pacing, &mut watcher) {
            Ok(result) => {
                result.report.incidents.warnings.iter().for_each(|warning| self.note(seed, EventLevel::Error, warning));
                SeedRun::of(&result.report, &result.folder, status_of(&result.report))
            }
            Err(error) => {
                let failure = run_failure(&error);
                SeedRun::not_run(seed, failure.lines.join("; "), failure.status.max(NOT_REACHED))
            }
        }
    }

    fn note(&self, seed: u64, level: EventLevel, text: &str) {
        self.progress.lock().shown.suspend(|| match level {
            EventLevel::Info => tracing::debug!(seed, "{text}"),
            EventLevel::Warning => tracing::info!(seed, "{text}"),
            EventLevel::Error => tracing::warn!(seed, "{text}"),
        });
    }
}

/// Shows a run's events, and passes Ctrl-C to the run.
struct BatchWatcher<'a> {
    batch: &'a SeedBatch<'a>,
    index: usize,
    seed: u64,
    stop: &'a AtomicBool,
}

impl Sink for BatchWatcher<'_> {
    fn frame(&mut self, _: &FrameFacts<'_>) {
        if self.batch.interrupted.load(Ordering::Relaxed) {
            self.stop.store(true, Ordering::SeqCst);
        }
    }

    fn cycle(&mut self, facts: &CycleFacts) {
        self.batch.progress.lock().show(self.index, facts.wanted.progress);
    }

    fn event(&mut self, event: &EventFacts) {
        // the table lists how each run ended
        if event.level != EventLevel::Error {
            self.batch.note(self.seed, event.level, &format!("plate {}: {}", event.at, event.text));
        }
    }
}
