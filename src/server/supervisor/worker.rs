//! The thread of a plate: takes its jobs one after another and runs them.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use serde_json::Value;

use super::PlateHandle;
use super::job_rules::Standing;
use super::run_observer::RunObserver;
use crate::states::PauseCause;
use crate::store::{Job, JobRow, JobState, Pace, RecordingStatus, StoreError, low_disk};
use upm_core::background::OverflowPolicy;
use upm_core::files::free_bytes;
use upm_core::job::{StopCause, StopRequest};
use upm_core::rig::Trip;
use upm_core::thread_priority::raise_thread_priority;
use upm_recording::{RecordingHandle, RecordingOptions, RecordingState, StopReport, WriterStatus};
use upm_runner::config::{DeadlinePolicy, JobLayout, JobSpec, Origin};
use upm_runner::run::{RunControls, RunFolder, RunOptions, RunResult, run_linked};

/// Interval at which an idle plate asks for work, unless it is woken.
const IDLE: Duration = Duration::from_secs(1);
/// Delay before the end of a job is stored again after a failure.
const STORED_AGAIN: Duration = Duration::from_millis(250);

/// Longest wait of a run without deadlines for a recorder that lags; the plate is at rest meanwhile.
const RECORDED_WITHIN: Duration = Duration::from_secs(2);

impl PlateHandle {
    /// Runs jobs until the daemon ends.
    pub(super) fn work(&self) {
        while !self.ending.load(Ordering::SeqCst) {
            self.job.end_run.store(false, Ordering::SeqCst);
            // before the store is asked: a job queued after its answer sets this again
            if let Some(standing) = &self.standing {
                standing.give_way.store(false, Ordering::SeqCst);
            }
            // a stop before this is seen here, a later one by the run
            let takes_no_job = !self.may_move() || !self.take_job();
            // a run may have used up the wake-up that the end brought
            if takes_no_job && !self.ending.load(Ordering::SeqCst) {
                #[cfg(test)]
                self.idled.fetch_add(1, Ordering::SeqCst);
                thread::park_timeout(IDLE);
            }
        }
    }

    /// Runs the next job. False when there is none, and after a standing job that ended by itself: one that is done at
    /// once must not begin again without a pause.
    fn take_job(&self) -> bool {
        match self.next_job() {
            Ok(Some(row)) => {
                let is_standing = row.standing;
                self.run(row);
                let gave_way = |standing: &Standing| standing.give_way.load(Ordering::SeqCst);
                !is_standing || self.standing.as_ref().is_some_and(gave_way)
            }
            Ok(None) => false,
            Err(fault) => {
                tracing::error!(plate = self.name(), "no job can be taken: {fault}");
                false
            }
        }
    }

    /// The oldest queued job, or the standing job when none is queued and it may run.
    fn next_job(&self) -> Result<Option<JobRow>, StoreError> {
        let store = &self.store;
        if let Some(row) = store.claim(self.name())? {
            return Ok(Some(row));
        }
        let Some(standing) = &self.standing else { return Ok(None) };
        let low = low_disk(free_bytes(store.runs()).ok(), self.min_free_bytes);
        if standing.hold(low.clone())
            && let Some(why) = &low
        {
            tracing::warn!(plate = self.name(), "the standing job waits: {why}");
        }
        if low.is_some() || standing.paused.lock().is_some() {
            return Ok(None);
        }
        store.begin_standing(&standing.job)
    }

    fn run(&self, mut row: JobRow) {
        let (recording, journal) = (RecordingHandle::default(), WriterStatus::default());
        self.preview.clear();
        let Job { id, name, seed, pace, standing, .. } = &row.job;
        self.job.begin(*id, *standing, recording.clone(), journal.clone());
        tracing::info!(plate = self.name(), job = %id, seed, pace = pace.code(), "begins: {name}");
        let done = self.play(&row, &recording, journal);
        let cause = self.job.end();
        let lost_parts = done.as_ref().map_or(0, |run| run.report.work.lost_parts);
        let stop = done.as_ref().ok().and_then(|run| run.report.stop.clone());
        let stopped_by_guard = stop.as_ref().is_some_and(|stop| stop.code.pauses_plate());
        let is_cancelled = cause.is_some_and(|stop| stop.cause == StopCause::Asked(StopRequest::Cancelled));
        self.set_end(&mut row.job, done, is_cancelled);
        let (kept, why) = recording_status(recording.state());
        if !matches!(kept, RecordingStatus::None | RecordingStatus::Whole) {
            tracing::warn!(plate = self.name(), job = %row.id, "the recording is {}: {why}", kept.code());
        }
        (row.job.recording, row.job.progress) = (kept, self.job.seen().0.progress);
        if lost_parts > 0 || stopped_by_guard {
            // an operator puts the part back, removes it, or checks what is wrong
            self.pause(PauseCause::after(stop.as_ref(), &row.reason));
        } else if self.waits_after_jobs {
            let remedy = "make the plate ready for the next job, then resume";
            self.pause(PauseCause::new("between_jobs", "waits for a person between two jobs", remedy));
        }
        self.settle_interlock(stop.as_ref(), &row.reason);
        if row.standing {
            self.settle_standing(&row, is_cancelled);
        }
        let (plate, state, reason) = (self.name(), row.state.code(), &row.reason);
        match row.state {
            JobState::Failed | JobState::Interrupted => tracing::warn!(plate, job = %row.id, "{state}: {reason}"),
            _ => tracing::info!(plate, job = %row.id, "{state}: {reason}"),
        }
        self.store_end(&row);
    }

    fn play(&self, row: &JobRow, recording: &RecordingHandle, journal: WriterStatus) -> Result<RunResult, Vec<String>> {
        let job = JobSpec::from_json(&row.spec_json, &Origin::of_request("job"), Some(&self.rules.rig))
            .map_err(|faults| faults.iter().map(ToString::to_string).collect::<Vec<_>>())?;
        if row.rig_fingerprint != self.rules.rig.fingerprint {
            return Err(vec!["the plate has another rig than when the job was accepted".to_owned()]);
        }
        let layout = JobLayout::of(&job);
        let radii_m = layout.parts.iter().map(|part| part.radius_m).collect();
        *self.job.layout.lock() = Some(layout);
        let folder = self.store.runs().join(row.folder.as_deref().unwrap_or_default());
        let folder = RunFolder::reopen(&folder).ok_or_else(|| vec!["its run folder is gone".to_owned()])?;
        if !folder.files().is_empty() {
            return Err(vec!["its run folder holds a run: it had begun before, and is not run again".to_owned()]);
        }
        let real_time = row.pace == Pace::RealTime;
        let is_strict = job.deadlines == DeadlinePolicy::Strict;
        raise_thread_priority(real_time);
        let options = RunOptions {
            out: self.store.runs().to_owned(),
            started_utc: String::new(),
            rerun: self.rerun.clone(),
            real_time,
            // a plate with deadlines to meet does not wait for a slow disk: its recording ends and the run goes on;
            // when the journal cannot keep up, the run ends
            recording_options: RecordingOptions {
                journal_overflow: OverflowPolicy::GiveUp,
                journal,
                recording_overflow: if real_time && is_strict {
                    OverflowPolicy::GiveUp
                } else {
                    OverflowPolicy::WaitAtMost(RECORDED_WITHIN)
                },
                recording: recording.clone(),
                has_clock: real_time,
                clock: self.clock,
            },
        };
        let (stop, interlock, pacing) = (&self.job.end_run, &self.emergency_stop.interlock, &self.job.pacing);
        let never = AtomicBool::new(false);
        let standing = self.standing.as_ref().filter(|_| row.standing);
        let give_way = standing.map_or(&never, |standing| &standing.give_way);
        let controls = RunControls { stop, give_way, interlock, pacing, cause: &|| self.cause() };
        let mut observer = RunObserver::new(self, radii_m, &options.recording_options);
        observer.begin_again = standing.filter(|_| job.is_endless()).map(|standing| &standing.give_way);
        run_linked(&job, Arc::clone(&self.rules.library), folder, &options, &self.clock, controls, &mut observer)
            .map_err(|error| error.lines())
    }

    /// Ends a job by the result of its run.
    fn set_end(&self, job: &mut Job, done: Result<RunResult, Vec<String>>, is_cancelled: bool) {
        match done {
            Ok(RunResult { report, .. }) => {
                let state = JobState::of_end(report.outcome, report.stop.as_ref().map(|stop| stop.code));
                job.report = serde_json::to_value(&report).ok().as_ref().and_then(Value::as_object).cloned();
                job.set_end(state, report.reason);
            }
            // the stop is the cause, even when it could not be written to the run's files
            Err(lines) if self.emergency_stop.holds() || is_cancelled => {
                job.set_end(JobState::Cancelled, format!("stopped; {}", lines.join("; ")));
            }
            Err(lines) => job.set_end(JobState::Failed, lines.join("; ")),
        }
    }

    /// Releases an interlock that tripped for any reason except an emergency stop; it ends with the run it stopped.
    /// Pauses the plate, except after a shutdown.
    fn settle_interlock(&self, stop: Option<&StopReport>, reason: &str) {
        match self.emergency_stop.interlock.tripped() {
            None | Some(Trip::EStop) => {}
            Some(trip) => {
                if trip != Trip::Shutdown {
                    self.pause(PauseCause::after(stop, reason));
                }
                self.emergency_stop.interlock.release(trip);
            }
        }
    }

    /// Pauses the standing job after a failure or a requested cancel: it would only do the same again.
    fn settle_standing(&self, ended: &Job, is_cancelled: bool) {
        let Some(standing) = &self.standing else { return };
        if is_cancelled {
            *standing.paused.lock() = Some("its last run was cancelled by request".to_owned());
        } else if ended.state == JobState::Failed {
            *standing.paused.lock() = Some(format!("its last run failed: {}", ended.reason));
        }
    }

    /// Waits until the end of a job is on the disk, or the daemon ends; the plate does nothing else meanwhile.
    fn store_end(&self, row: &JobRow) {
        let mut is_reported = false;
        while let Err(fault) = self.store.finish(row) {
            if !std::mem::replace(&mut is_reported, true) {
                tracing::error!(plate = self.name(), job = %row.id, "the end of the job cannot be stored: {fault}");
            }
            if self.ending.load(Ordering::SeqCst) {
                return;
            }
            thread::park_timeout(STORED_AGAIN);
        }
    }
}

/// State of a recording after the run, and why it is not complete.
fn recording_status(state: RecordingState) -> (RecordingStatus, String) {
    match state {
        RecordingState::Off => (RecordingStatus::None, String::new()),
        RecordingState::Writing { .. } => (RecordingStatus::Partial, "it was not closed".to_owned()),
        RecordingState::Failed(why) => (RecordingStatus::Failed, why),
        RecordingState::Whole => (RecordingStatus::Whole, String::new()),
    }
}
