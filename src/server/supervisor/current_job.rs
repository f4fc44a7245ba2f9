use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use parking_lot::Mutex;

use super::Observation;
use super::watchdog::Heartbeat;
use crate::store::JobId;
use upm_core::job::StopRequest;
use upm_recording::{RecordingHandle, WriterStatus};
use upm_runner::config::JobLayout;
use upm_runner::run::{ExternalStop, PacingStats};

/// The job on a plate, and the ends requested for it.
#[derive(Debug, Default)]
pub(crate) struct CurrentJob {
    turn: Mutex<JobSlot>,
    /// Set to end the run.
    pub end_run: Arc<AtomicBool>,
    pub(super) heartbeat: Heartbeat,
    pub pacing: Arc<PacingStats>,
    /// The newest observation of the parts, and when it was made.
    seen: Mutex<(Observation, Option<Duration>)>,
    /// The job's layout, once its text has been read.
    pub layout: Mutex<Option<JobLayout>>,
}

/// The plate's current job and its neighbours that matter to a cancel.
#[derive(Debug, Default)]
struct JobSlot {
    running: Option<RunningJob>,
    /// The previous job.
    last: Option<JobId>,
    /// A job that was cancelled before it began on the plate.
    unwanted: Option<JobId>,
}

#[derive(Clone, Debug)]
pub(crate) struct RunningJob {
    pub job: JobId,
    /// True for a run of the standing job.
    pub standing: bool,
    pub recording: RecordingHandle,
    pub journal: WriterStatus,
    /// Deadlines that the plate had missed before it.
    pub missed_before: u64,
    /// The requested end; `None` while none was requested.
    cause: Option<ExternalStop>,
}

impl CurrentJob {
    /// Begins a job on the plate. Its run ends at once when it was cancelled before.
    pub fn begin(&self, job: JobId, standing: bool, recording: RecordingHandle, journal: WriterStatus) {
        *self.seen.lock() = Default::default();
        *self.layout.lock() = None;
        self.heartbeat.clear();
        let missed_before = self.pacing.misses();
        let mut turn = self.turn.lock();
        let cause = (turn.unwanted.take() == Some(job)).then(cancelled);
        if cause.is_some() {
            self.end_run.store(true, Ordering::SeqCst);
        }
        turn.running = Some(RunningJob { job, standing, recording, journal, missed_before, cause });
    }

    /// True while `job` is on the plate, and after it until the next one begins.
    pub fn is_newest(&self, job: &JobId) -> bool {
        let turn = self.turn.lock();
        turn.running.as_ref().map(|running| running.job).or(turn.last) == Some(*job)
    }

    /// The job on the plate.
    pub fn running(&self) -> Option<RunningJob> {
        self.turn.lock().running.clone()
    }

    /// The job whose run is still under control, and its journal. `None` once only recording, journal and report remain
    /// to be written.
    pub fn driven(&self) -> Option<(JobId, WriterStatus)> {
        let turn = self.turn.lock();
        let running = turn.running.as_ref().filter(|_| self.heartbeat.is_driven())?;
        Some((running.job, running.journal.clone()))
    }

    /// The requested end of its run.
    pub fn cause(&self) -> Option<ExternalStop> {
        self.turn.lock().running.as_ref()?.cause.clone()
    }

    /// Ends the job; returns the end that was requested, if one was.
    pub fn end(&self) -> Option<ExternalStop> {
        let mut turn = self.turn.lock();
        let running = turn.running.take()?;
        turn.last = Some(running.job);
        running.cause
    }

    /// Ends the run of `job`, which is running according to the store: now, or as soon as it begins on the plate. False
    /// when its run is over.
    pub fn cancel(&self, job: &JobId) -> bool {
        let JobSlot { running, last, unwanted } = &mut *self.turn.lock();
        match running {
            Some(running) if running.job == *job => {
                running.cause.get_or_insert_with(cancelled);
                self.end_run.store(true, Ordering::SeqCst);
                true
            }
            None if *last != Some(*job) => {
                *unwanted = Some(*job);
                true
            }
            _ => false,
        }
    }

    /// Ends the run of `job` because of a fault and calls `cut`, if the run is still under control. A fault found later
    /// must not end the next job, nor stop an idle plate.
    pub fn fail(&self, job: &JobId, why: ExternalStop, cut: impl FnOnce()) {
        let mut turn = self.turn.lock();
        let driven = turn.running.as_mut().filter(|running| running.job == *job && self.heartbeat.is_driven());
        if let Some(running) = driven {
            running.cause.get_or_insert(why);
            self.end_run.store(true, Ordering::SeqCst);
            cut();
        }
    }

    /// Stores an observation of the parts; skipped while another thread reads the last one.
    pub fn set_observation(&self, observation: &Observation, now: Duration) {
        let Some(mut seen) = self.seen.try_lock() else { return };
        seen.0.clone_from(observation);
        seen.1 = Some(now);
    }

    /// The newest observation of the parts, and when it was made.
    pub fn seen(&self) -> (Observation, Option<Duration>) {
        self.seen.lock().clone()
    }
}

fn cancelled() -> ExternalStop {
    ExternalStop::of(StopRequest::Cancelled, "cancelled by request")
}
