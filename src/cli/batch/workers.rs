use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread;
use std::time::Duration;

use super::summary::SeedRun;
use crate::cli::output::NOT_REACHED;
use crate::cli::progress::FULL;
use crate::cli::run::{run_failure, status_of};
use upm_control::{CycleFacts, EventLevel, FrameFacts, Sink};
use upm_core::time::{MonotonicClock, PlateTime};
use upm_recording::{RecordingOptions, RerunMode};
use upm_runner::config::JobSpec;
use upm_runner::run::{PacingStats, RunOptions, run as run_job};

/// Capacity of the queue of messages to be shown; workers block while it is full.
const WAITING: usize = 64;

/// Interval at which progress is polled.
const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// Runs of one job with several seeds.
pub(super) struct SeedBatch<'a> {
    pub job: &'a JobSpec,
    pub seeds: &'a [u64],
    pub out: PathBuf,
    /// Wall time in the names of the run folders.
    pub started_utc: String,
    pub rerun: RerunMode,
    pub clock: MonotonicClock,
    /// Set by Ctrl-C: runs in progress end, and no further run starts.
    pub interrupted: &'a AtomicBool,
}

/// Progress report of a batch.
pub(super) enum BatchProgress {
    /// Share of the total work that is done, and number of runs that have ended.
    Progress { share: f64, ended: usize },
    /// A line about the run with this seed.
    Note { seed: u64, level: EventLevel, text: String },
}

/// Message from a worker thread.
enum WorkerMessage {
    Note { seed: u64, level: EventLevel, text: String },
    Ended { index: usize, run: Box<SeedRun> },
}

impl SeedBatch<'_> {
    /// Runs the seeds in turn on all cores and calls `show` on this thread. Returns the runs that were started, in the
    /// order of the seeds.
    pub fn run(&self, mut show: impl FnMut(BatchProgress)) -> Vec<SeedRun> {
        let turns = Turns { next: AtomicUsize::new(0), shares: self.seeds.iter().map(|_| AtomicU64::new(0)).collect() };
        let threads = thread::available_parallelism().map_or(1, |cores| cores.get()).min(self.seeds.len());
        let (sender, receiver) = sync_channel(WAITING);
        let mut runs = thread::scope(|scope| {
            for _ in 0..threads {
                let (sender, turns) = (sender.clone(), &turns);
                scope.spawn(move || self.take_turns(turns, &sender));
            }
            drop(sender);
            collect(&receiver, &turns, &mut show)
        });
        runs.sort_by_key(|(index, _)| *index);
        runs.into_iter().map(|(_, run)| run).collect()
    }

    fn take_turns(&self, turns: &Turns, sender: &SyncSender<WorkerMessage>) {
        while !self.interrupted.load(Ordering::Relaxed) {
            let index = turns.next.fetch_add(1, Ordering::Relaxed);
            let (Some(&seed), Some(share)) = (self.seeds.get(index), turns.shares.get(index)) else { break };
            let run = Box::new(self.run_one(seed, share, sender));
            share.store(FULL, Ordering::Relaxed);
            if sender.send(WorkerMessage::Ended { index, run }).is_err() {
                break;
            }
        }
    }

    /// Runs one seed as `upm run --seed SEED` does.
    fn run_one(&self, seed: u64, share: &AtomicU64, sender: &SyncSender<WorkerMessage>) -> SeedRun {
        let options = RunOptions {
            out: self.out.clone(),
            started_utc: self.started_utc.clone(),
            rerun: self.rerun.clone(),
            real_time: false,
            recording_options: RecordingOptions::lossless(self.clock),
            live: None,
        };
        let stop = AtomicBool::new(false);
        let mut watcher = BatchWatcher { seed, interrupted: self.interrupted, stop: &stop, share, sender };
        let job = self.job.clone().with_seed(seed);
        match run_job(&job, &options, &self.clock, &stop, &PacingStats::default(), &mut watcher) {
            Ok(result) => {
                result.warnings.iter().for_each(|warning| watcher.note(EventLevel::Error, warning));
                SeedRun::of(&result.report, &result.folder, status_of(&result.report))
            }
            Err(error) => {
                let failure = run_failure(&error);
                SeedRun::not_run(seed, failure.lines.join("; "), failure.status.max(NOT_REACHED))
            }
        }
    }
}

/// Index of the next seed, and the progress of each run in thousandths.
struct Turns {
    next: AtomicUsize,
    shares: Vec<AtomicU64>,
}

impl Turns {
    fn share(&self) -> f64 {
        let done: u64 = self.shares.iter().map(|share| share.load(Ordering::Relaxed)).sum();
        done as f64 / (FULL * self.shares.len().max(1) as u64) as f64
    }
}

/// Shows the workers' messages until all of them have ended.
fn collect(
    receiver: &Receiver<WorkerMessage>,
    turns: &Turns,
    show: &mut impl FnMut(BatchProgress),
) -> Vec<(usize, SeedRun)> {
    let mut runs = Vec::new();
    loop {
        match receiver.recv_timeout(POLL_INTERVAL) {
            Ok(WorkerMessage::Note { seed, level, text }) => show(BatchProgress::Note { seed, level, text }),
            Ok(WorkerMessage::Ended { index, run }) => runs.push((index, *run)),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return runs,
        }
        show(BatchProgress::Progress { share: turns.share(), ended: runs.len() });
    }
}

/// Forwards a run's events to the batch, and Ctrl-C to the run.
struct BatchWatcher<'a> {
    seed: u64,
    interrupted: &'a AtomicBool,
    stop: &'a AtomicBool,
    share: &'a AtomicU64,
    sender: &'a SyncSender<WorkerMessage>,
}

impl BatchWatcher<'_> {
    fn note(&self, level: EventLevel, text: &str) {
        self.sender.send(WorkerMessage::Note { seed: self.seed, level, text: text.to_owned() }).ok();
    }
}

impl Sink for BatchWatcher<'_> {
    fn frame(&mut self, _: &FrameFacts<'_>) {
        if self.interrupted.load(Ordering::Relaxed) {
            self.stop.store(true, Ordering::SeqCst);
        }
    }

    fn cycle(&mut self, facts: &CycleFacts<'_>) {
        self.share.store((facts.wanted.progress.clamp(0.0, 1.0) * FULL as f64) as u64, Ordering::Relaxed);
    }

    fn event(&mut self, at: PlateTime, level: EventLevel, text: &str) {
        // the table lists how each run ended
        if level != EventLevel::Error {
            self.note(level, &format!("plate {at}: {text}"));
        }
    }
}
