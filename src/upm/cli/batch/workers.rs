use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;

use super::summary::SeedRun;
use crate::cli::output::NOT_REACHED;
use crate::cli::progress::{FULL, LateProgress};
use crate::cli::run::{run_failure, status_of};
use upm_control::{CycleFacts, EventLevel, FrameFacts, Sink};
use upm_core::time::{MonotonicClock, PlateTime};
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
    pub turns: Turns,
}

/// State that the workers of a batch share.
pub(super) struct Turns {
    progress: Mutex<LateProgress<MonotonicClock>>,
    /// Index of the next seed.
    next: AtomicUsize,
    /// Progress of each run in thousandths.
    shares: Vec<AtomicU64>,
    /// Ended runs with the indices of their seeds.
    ended: Mutex<Vec<(usize, SeedRun)>>,
}

impl Turns {
    pub fn new(seeds: usize, progress: LateProgress<MonotonicClock>) -> Self {
        let shares = (0..seeds).map(|_| AtomicU64::new(0)).collect();
        Self { progress: Mutex::new(progress), next: AtomicUsize::new(0), shares, ended: Mutex::default() }
    }

    fn set_share(&self, index: usize, share: f64) {
        if let Some(own) = self.shares.get(index) {
            own.store((share.clamp(0.0, 1.0) * FULL as f64) as u64, Ordering::Relaxed);
        }
        let (ended, seeds) = (locked(&self.ended).len(), self.shares.len());
        let done: u64 = self.shares.iter().map(|share| share.load(Ordering::Relaxed)).sum();
        let share = done as f64 / (FULL * seeds.max(1) as u64) as f64;
        locked(&self.progress).show(share, || format!("{ended} of {seeds} runs have ended"));
    }

    fn note(&self, seed: u64, level: EventLevel, text: &str) {
        locked(&self.progress).suspend(|| match level {
            EventLevel::Info => tracing::debug!(seed, "{text}"),
            EventLevel::Warning => tracing::info!(seed, "{text}"),
            EventLevel::Error => tracing::warn!(seed, "{text}"),
        });
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl SeedBatch<'_> {
    /// Runs the seeds in turn on all cores. Returns the runs that were started, in the order of the seeds.
    pub fn run(&self) -> Vec<SeedRun> {
        let threads = thread::available_parallelism().map_or(1, |cores| cores.get()).min(self.seeds.len());
        thread::scope(|scope| (0..threads).for_each(|_| drop(scope.spawn(|| self.take_turns()))));
        locked(&self.turns.progress).finish();
        let mut runs = std::mem::take(&mut *locked(&self.turns.ended));
        runs.sort_by_key(|(index, _)| *index);
        runs.into_iter().map(|(_, run)| run).collect()
    }

    fn take_turns(&self) {
        while !self.interrupted.load(Ordering::Relaxed) {
            let index = self.turns.next.fetch_add(1, Ordering::Relaxed);
            let Some(&seed) = self.seeds.get(index) else { break };
            let run = self.run_one(index, seed);
            locked(&self.turns.ended).push((index, run));
            self.turns.set_share(index, 1.0);
        }
    }

    /// Runs one seed as `upm run --seed SEED` does.
    fn run_one(&self, index: usize, seed: u64) -> SeedRun {
        let options = RunOptions {
            out: self.out.clone(),
            started_utc: self.started_utc.clone(),
            rerun: self.rerun.clone(),
            real_time: false,
            recording_options: RecordingOptions::lossless(self.clock),
            live: None,
        };
        let stop = AtomicBool::new(false);
        let mut watcher = BatchWatcher { batch: self, index, seed, stop: &stop };
        let job = self.job.clone().with_seed(seed);
        match run_job(
            &job,
            Arc::clone(&self.library),
            &options,
            &self.clock,
            &stop,
            &PacingStats::default(),
            &mut watcher,
        ) {
            Ok(result) => {
                result.report.warnings.iter().for_each(|warning| self.turns.note(seed, EventLevel::Error, warning));
                SeedRun::of(&result.report, &result.folder, status_of(&result.report))
            }
            Err(error) => {
                let failure = run_failure(&error);
                SeedRun::not_run(seed, failure.lines.join("; "), failure.status.max(NOT_REACHED))
            }
        }
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

    fn cycle(&mut self, facts: &CycleFacts<'_>) {
        self.batch.turns.set_share(self.index, facts.wanted.progress);
    }

    fn event(&mut self, at: PlateTime, level: EventLevel, text: &str) {
        // the table lists how each run ended
        if level != EventLevel::Error {
            self.batch.turns.note(self.seed, level, &format!("plate {at}: {text}"));
        }
    }
}
