use std::fs;
use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use serde_json::Value;

use super::PlateHandle;
use super::job_rules::Standing;
use super::run_observer::RunObserver;
use crate::states::PauseCause;
use crate::store::{Job, JobEnd, JobId, JobRow, JobState, JobWithSpec, Pace, RecordingStatus, StoreError, low_disk};
use upm_core::background::OverflowPolicy;
use upm_core::files::free_bytes;
use upm_core::job::{StopCause, StopRequest};
use upm_core::rig::Trip;
use upm_core::thread_priority::raise_thread_priority;
use upm_recording::{RecordingHandle, RecordingOptions, RecordingState, RerunMode, StopReport, WriterStatus};
use upm_runner::config::{DeadlinePolicy, JobLayout, JobSpec, Origin};
use upm_runner::run::{RunControls, RunFolder, RunOptions, RunResult, run_linked};

/// Interval at which an idle plate asks for work, unless it is woken.
const IDLE: Duration = Duration::from_secs(1);
/// Delay before the end of a job is stored again after a failure.
const STORED_AGAIN: Duration = Duration::from_millis(250);

/// Longest wait of a run without deadlines for a recorder that lags; the plate is at rest meanwhile.
const RECORDED_WITHIN: Duration = Duration::from_secs(2);

/// The thread of one plate: takes its jobs one after another and runs them.
pub(super) struct PlateWorker {
    pub shared: Arc<PlateHandle>,
    /// Destination of the runs' recordings.
    pub rerun: RerunMode,
    /// Free bytes below which the standing job waits.
    pub min_free_bytes: u64,
    /// True if the plate pauses after each job.
    pub waits_after_jobs: bool,
}

impl PlateWorker {
    /// Runs jobs until the daemon ends.
    pub fn work(&self) {
        let shared = &*self.shared;
        while !shared.ending.load(Ordering::SeqCst) {
            shared.job.end_run.store(false, Ordering::SeqCst);
            // before the store is asked: a job queued after its answer sets this again
            if let Some(standing) = &shared.standing {
                standing.give_way.store(false, Ordering::SeqCst);
            }
            // a stop before this is seen here, a later one by the run
            let takes_no_job = !shared.may_move() || !self.take_job();
            // a run may have used up the wake-up that the end brought
            if takes_no_job && !shared.ending.load(Ordering::SeqCst) {
                #[cfg(test)]
                shared.idled.fetch_add(1, Ordering::SeqCst);
                thread::park_timeout(IDLE);
            }
        }
    }

    /// Runs the next job. False when there is none, and after a standing job that ended by itself: one that is done at
    /// once must not begin again without a pause.
    fn take_job(&self) -> bool {
        match self.next_job() {
            Ok(Some(claimed)) => {
                self.run(&claimed);
                let gave_way = |standing: &Standing| standing.give_way.load(Ordering::SeqCst);
                !claimed.row.standing || self.shared.standing.as_ref().is_some_and(gave_way)
            }
            Ok(None) => false,
            Err(fault) => {
                tracing::error!(plate = self.shared.name, "no job can be taken: {fault}");
                false
            }
        }
    }

    /// The oldest queued job, or the standing job when none is queued and it may run.
    fn next_job(&self) -> Result<Option<JobWithSpec>, StoreError> {
        let store = &self.shared.store;
        let folder = |row: &JobRow| make_folder(store.runs(), row);
        if let Some(claimed) = store.claim(&self.shared.name, &folder)? {
            return Ok(Some(claimed));
        }
        let Some(standing) = &self.shared.standing else { return Ok(None) };
        let low = low_disk(free_bytes(store.runs()).ok(), self.min_free_bytes);
        if standing.hold(low.clone())
            && let Some(why) = &low
        {
            tracing::warn!(plate = self.shared.name, "the standing job waits: {why}");
        }
        if low.is_some() || standing.paused().is_some() {
            return Ok(None);
        }
        store.begin_standing(&standing.job, &folder)
    }

    fn run(&self, claimed: &JobWithSpec) {
        let id = claimed.row.id;
        let (recording, journal) = (RecordingHandle::default(), WriterStatus::default());
        self.shared.preview.clear();
        self.shared.job.begin(id, claimed.row.standing, recording.clone(), journal.clone());
        let Job { name, seed, pace, .. } = &claimed.row.job;
        tracing::info!(plate = self.shared.name, job = %id, seed, pace = pace.code(), "begins: {name}");
        let folder = self.shared.store.runs().join(claimed.row.folder.as_deref().unwrap_or_default());
        let done = self.play(claimed, &folder, &recording, journal);
        let cause = self.shared.job.end();
        let lost_parts = done.as_ref().map_or(0, |run| run.report.work.lost_parts);
        let stop = done.as_ref().ok().and_then(|run| run.report.stop.clone());
        let stopped_by_guard = stop.as_ref().is_some_and(|stop| stop.code.pauses_plate());
        let is_cancelled = cause.is_some_and(|stop| stop.cause == StopCause::Asked(StopRequest::Cancelled));
        let mut end = self.end_of(done, is_cancelled);
        let (kept, why) = recording_status(recording.state());
        if !matches!(kept, RecordingStatus::None | RecordingStatus::Whole) {
            tracing::warn!(plate = self.shared.name, job = %id, "the recording is {}: {why}", kept.code());
        }
        (end.recording, end.progress) = (kept, self.shared.job.seen().0.progress);
        if lost_parts > 0 || stopped_by_guard {
            // an operator puts the part back, removes it, or checks what is wrong
            self.shared.pause(PauseCause::after(stop.as_ref(), &end.reason));
        } else if self.waits_after_jobs {
            let remedy = "make the plate ready for the next job, then resume";
            self.shared.pause(PauseCause::new("between_jobs", "waits for a person between two jobs", remedy));
        }
        self.settle_interlock(stop.as_ref(), &end.reason);
        if claimed.row.standing {
            self.settle_standing(&end, is_cancelled);
        }
        let (plate, state, reason) = (&self.shared.name, end.state.code(), &end.reason);
        match end.state {
            JobState::Failed | JobState::Interrupted => tracing::warn!(plate, job = %id, "{state}: {reason}"),
            _ => tracing::info!(plate, job = %id, "{state}: {reason}"),
        }
        self.store(&id, &end);
    }

    fn play(
        &self,
        JobWithSpec { row, spec_json }: &JobWithSpec,
        folder: &Path,
        recording: &RecordingHandle,
        journal: WriterStatus,
    ) -> Result<RunResult, Vec<String>> {
        let shared = &*self.shared;
        let job = JobSpec::from_json(spec_json, &Origin::of_request("job"), Some(&shared.rules.rig))
            .map_err(|faults| faults.iter().map(ToString::to_string).collect::<Vec<_>>())?;
        if row.rig_fingerprint != shared.rules.rig.fingerprint {
            return Err(vec!["the plate has another rig than when the job was accepted".to_owned()]);
        }
        let layout = JobLayout::of(&job);
        let radii_m = layout.parts.iter().map(|part| part.radius_m).collect();
        *shared.job.layout.lock() = Some(layout);
        let folder = RunFolder::reopen(folder).ok_or_else(|| vec!["its run folder is gone".to_owned()])?;
        if !folder.files().is_empty() {
            return Err(vec!["its run folder holds a run: it had begun before, and is not run again".to_owned()]);
        }
        let real_time = row.pace == Pace::RealTime;
        let is_strict = job.deadlines == DeadlinePolicy::Strict;
        raise_thread_priority(real_time);
        let options = RunOptions {
            out: shared.store.runs().to_owned(),
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
                clock: shared.clock,
            },
        };
        let (stop, interlock, pacing) = (&shared.job.end_run, &shared.emergency_stop.interlock, &shared.job.pacing);
        let never = AtomicBool::new(false);
        let standing = shared.standing.as_ref().filter(|_| row.standing);
        let give_way = standing.map_or(&never, |standing| &standing.give_way);
        let controls = RunControls { stop, give_way, interlock, pacing, cause: &|| shared.cause() };
        let clock = shared.clock;
        let mut observer = RunObserver::new(shared, &clock, radii_m, &options.recording_options);
        observer.begin_again = standing.filter(|_| job.is_endless()).map(|standing| &standing.give_way);
        run_linked(&job, Arc::clone(&shared.rules.library), folder, &options, &clock, controls, &mut observer)
            .map_err(|error| error.lines())
    }

    /// The end of a job from the result of its run.
    fn end_of(&self, done: Result<RunResult, Vec<String>>, is_cancelled: bool) -> JobEnd {
        let report = match done {
            Ok(result) => result.report,
            // the stop is the cause, even when it could not be written to the run's files
            Err(lines) if self.shared.emergency_stop.holds() || is_cancelled => {
                return JobEnd::of(JobState::Cancelled, format!("stopped; {}", lines.join("; ")));
            }
            Err(lines) => return JobEnd::of(JobState::Failed, lines.join("; ")),
        };
        let state = JobState::of_end(report.outcome, report.stop.as_ref().map(|stop| stop.code));
        let json = serde_json::to_value(&report).ok();
        JobEnd { report: json.as_ref().and_then(Value::as_object).cloned(), ..JobEnd::of(state, report.reason) }
    }

    /// Releases an interlock that tripped for any reason except an emergency stop; it ends with the run it stopped.
    /// Pauses the plate, except after a shutdown.
    fn settle_interlock(&self, stop: Option<&StopReport>, reason: &str) {
        let shared = &*self.shared;
        match shared.emergency_stop.interlock.tripped() {
            None | Some(Trip::EStop) => {}
            Some(trip) => {
                if trip != Trip::Shutdown {
                    shared.pause(PauseCause::after(stop, reason));
                }
                shared.emergency_stop.interlock.release(trip);
            }
        }
    }

    /// Pauses the standing job after a failure or a requested cancel: it would only do the same again.
    fn settle_standing(&self, end: &JobEnd, is_cancelled: bool) {
        let Some(standing) = &self.shared.standing else { return };
        if is_cancelled {
            standing.pause(Some("its last run was cancelled by request".to_owned()));
        } else if end.state == JobState::Failed {
            standing.pause(Some(format!("its last run failed: {}", end.reason)));
        }
    }

    /// Waits until the end of a job is on the disk, or the daemon ends; the plate does nothing else meanwhile.
    fn store(&self, id: &JobId, end: &JobEnd) {
        let mut is_reported = false;
        while let Err(fault) = self.shared.store.finish(id, end) {
            if !std::mem::replace(&mut is_reported, true) {
                tracing::error!(plate = self.shared.name, job = %id, "the end of the job cannot be stored: {fault}");
            }
            if self.shared.ending.load(Ordering::SeqCst) {
                return;
            }
            thread::park_timeout(STORED_AGAIN);
        }
    }
}

/// Creates the job's own folder, named after it, before the job is claimed, so that no job is ever without one. An
/// existing folder does not prevent the claim: the run checks its contents before anything is written.
fn make_folder(runs: &Path, row: &JobRow) -> io::Result<String> {
    let name = row.run_folder();
    fs::create_dir_all(runs)?;
    match fs::create_dir(runs.join(&name)) {
        Err(error) if error.kind() != io::ErrorKind::AlreadyExists => Err(error),
        _ => Ok(name),
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
