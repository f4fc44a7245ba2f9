//! Composition of a run: from a validated job it builds rig, task, control loop and sinks, and leaves a run folder and
//! a report. The command line, the daemon and the tests all run jobs through this module.

mod calibrate;
mod controls;
mod coverage;
mod dry_run;
mod end_facts;
#[cfg(test)]
mod endless_tests;
mod error;
#[cfg(test)]
mod fault_tests;
mod folder;
mod in_memory;
#[cfg(test)]
mod journal_failure_tests;
mod knocks;
#[cfg(test)]
mod late_segment_tests;
mod library;
mod machine;
mod movie;
#[cfg(test)]
mod moving_stop_tests;
#[cfg(test)]
mod newcomer_tests;
mod paced;
mod path_warnings;
mod planner_selection;
#[cfg(test)]
mod recording_tests;
mod setup;
mod simulate;
#[cfg(test)]
mod stop_tests;
#[cfg(test)]
mod testing;
mod tolerance;
mod verify;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::config::{JobLayout, JobSpec};
use upm_control::{self as control, EventFacts, EventLevel, FinalState, RunEnd, RunIo, Sink};
use upm_core::rig::{Interlock, Rig};
use upm_core::time::Clock;
use upm_planning::cor_library::Library;
use upm_recording::{
    BackgroundWriter, Fanout, Journal, RecordingOptions, Report, RerunMode, RunStats, report_recording_end,
};
use upm_sim::faults::Faulty;
use upm_viewer::{RerunSink, RunContext};

use end_facts::{add_write_failure, ending, verdict};
use folder::TruthLog;
use paced::{PaceClock, RealTimeRig};

pub use calibrate::{calibrate, calibration_params};
pub use controls::{ExternalStop, RunControls};
pub use coverage::{Coverage, CoverageHole, PlaceReach};
pub use dry_run::{
    ClosestApproach, DryRun, DryRunRecord, DryRuns, Forecast, ForecastSummary, PartForecast, PlanVerdict, dry_run,
};
pub use error::RunError;
pub use folder::RunFolder;
pub use in_memory::InMemoryRun;
pub use library::{
    LibraryOutput, check_places, job_library, library_and_places, library_faults, load_library, rig_library,
};
pub use machine::{maker, maker_of, program};
pub use movie::movie;
pub use paced::PacingStats;
pub use path_warnings::job_warnings;
pub use planner_selection::PlannerSelection;
pub use setup::{OwnParts, RunSetup, TruthInJobOrder, planner_params};
pub(crate) use setup::{simulated_rig, task};
pub use simulate::{FirstFrame, TruePart, check_simulate, first_frame, simulate};
pub use upm_planning::planner::Reach;
pub use upm_sim::OpenLoopTrajectories;
pub use verify::{Extent, Verification, verify};

/// Options of a run besides the job.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// Parent of the run folder.
    pub out: PathBuf,
    /// Wall time of the start, for the folder's name: `20260101T000000Z`.
    pub started_utc: String,
    /// Destination of the recording.
    pub rerun: RerunMode,
    /// True to limit plate time to the speed of the clock.
    pub real_time: bool,
    /// Writers of the journal and the recording.
    pub recording_options: RecordingOptions,
}

/// Report of an ended run, with its folder.
#[derive(Clone, Debug)]
pub struct RunResult {
    /// The run folder.
    pub folder: PathBuf,
    /// Contents of `report.json`. Its warnings include that the file could not be written.
    pub report: Report,
}

/// Runs `job` with `library`, which fits its rig, to its end and writes a new run folder. `pacing` counts missed
/// deadlines of a run in real time; `watcher` receives all events and does not influence the run. For what the caller
/// brings in the place of the job's own, the report has a warning, and no verdict on a task or a rig of the caller's.
///
/// # Errors
/// The job cannot be run, or a file cannot be written.
pub fn run(
    job: &JobSpec,
    library: Arc<Library>,
    (options, own): (&RunOptions, OwnParts),
    clock: &dyn Clock,
    stop: &AtomicBool,
    pacing: &PacingStats,
    watcher: &mut dyn Sink,
) -> Result<RunResult, RunError> {
    check_mode(options)?;
    // a job that cannot be run leaves no folder
    let setup = RunSetup::new(job, &library)?.with_own(job, own)?;
    let folder = RunFolder::create(&options.out, job, &options.started_utc)?;
    let (interlock, give_way) = (Interlock::default(), AtomicBool::new(false));
    let is_broken = || interlock.tripped().is_some() || options.recording_options.journal.fault().is_some();
    let cause = || (!is_broken()).then(ExternalStop::by_operator);
    let controls = RunControls { stop, give_way: &give_way, interlock: &interlock, pacing, cause: &cause };
    let (result, written) = Session { job, library, folder, options, clock, controls }.run(setup, watcher)?;
    written.map(|()| result)
}

/// Runs `job` with `library`, which fits its rig, to its end and writes `folder`; `controls` let the caller observe and
/// stop the run. The folder in `options` is not used. On return the rig is dropped and the interlock free. A run whose
/// journal could not be written ends as failed, unless it was stopped from outside; its report is in the result. If
/// only `report.json` cannot be written, the run still succeeds, with a warning.
pub fn run_linked(
    job: &JobSpec,
    library: Arc<Library>,
    folder: RunFolder,
    options: &RunOptions,
    clock: &dyn Clock,
    controls: RunControls<'_>,
    watcher: &mut dyn Sink,
) -> Result<RunResult, RunError> {
    let session = Session { job, library, folder, options, clock, controls };
    match check_mode(options).and_then(|()| Ok(RunSetup::new(job, &session.library)?)) {
        Ok(setup) => session.run(setup, watcher).map(|(result, _)| result),
        Err(error) => {
            session.leave_reason(None, &error);
            Err(error)
        }
    }
}

fn check_mode(options: &RunOptions) -> Result<(), RunError> {
    RerunSink::check(&options.rerun).map_err(|error| RunError::RerunMode(error.to_string()))
}

/// A run that has ended, and whether its files were written.
type Done = (RunResult, Result<(), RunError>);

/// Everything needed for one run of a job.
struct Session<'a> {
    job: &'a JobSpec,
    library: Arc<Library>,
    folder: RunFolder,
    options: &'a RunOptions,
    clock: &'a dyn Clock,
    controls: RunControls<'a>,
}

impl Session<'_> {
    fn run(&self, mut setup: RunSetup, watcher: &mut dyn Sink) -> Result<Done, RunError> {
        let _span = tracing::trace_span!("job", name = self.job.name, seed = self.job.seed()).entered();
        let attached = setup.rig.attach(self.controls.interlock.clone()).map_err(RunError::Rig);
        let done = attached.and_then(|()| self.run_into(&mut setup, watcher));
        if let Err(error) = &done {
            self.leave_reason(Some(&setup), error);
        }
        done
    }

    /// Writes a report with the reason of a failure, so that every run folder has one if it can be written at all.
    fn leave_reason(&self, setup: Option<&RunSetup>, error: &RunError) {
        if !self.folder.files().contains(&folder::REPORT_FILE) {
            let failed = FinalState { ending: RunEnd::failed(error.to_string()), ..FinalState::default() };
            let report = RunStats::default().report(ending(self.job, setup, failed, 0.0));
            self.folder.write_json(folder::REPORT_FILE, &report).ok();
        }
    }

    /// Runs to the end and writes all files of the folder.
    fn run_into(&self, setup: &mut RunSetup, watcher: &mut dyn Sink) -> Result<Done, RunError> {
        let Self { job, library, folder, options, clock, controls } = self;
        folder.write_effective(job, library)?;
        let owned = setup.owned();
        let started = clock.elapsed();
        let mut journal = Journal::new(folder.journal(&options.recording_options)?, Arc::clone(library));
        let mut stats = RunStats::new(setup.known_truth());
        let mut recorder = self.start_recording(setup)?;
        let mut truth_log = TruthLog::of(setup, folder)?;
        let mut named = TruthInJobOrder(setup.truth.clone());
        let mut is_lost = false;
        let mut report_end = |sinks: &mut dyn Sink, at| {
            // no motion goes unrecorded
            if let (Some(fault), false) = (options.recording_options.journal.fault(), is_lost) {
                is_lost = true;
                controls.stop.store(true, Ordering::SeqCst);
                let text = format!("the journal cannot be written: {fault}");
                sinks.event(&EventFacts::note(at, EventLevel::Error, text));
            }
            report_recording_end(&options.recording_options.recording, sinks, at);
        };
        let mut sinks = Fanout {
            sinks: vec![&mut named, &mut journal, &mut stats, &mut truth_log, &mut recorder, &mut *watcher],
            after_frame: Some(&mut report_end),
        };
        let missed_before = controls.pacing.start_run();
        let pace = options.real_time.then_some(PaceClock {
            clock: *clock,
            sleep: &std::thread::park_timeout,
            stats: controls.pacing,
            interlock: controls.interlock,
            frame_hz: setup.model.frame_hz,
            deadlines: job.deadlines,
        });
        let stop = (controls.stop, controls.give_way);
        let mut finish = setup.play(library, None, pace, &mut sinks, *clock, stop);
        controls.explain(&mut finish, &mut sinks, setup.ended_at);
        let wall_time_s = (clock.elapsed() - started).as_secs_f64();

        let warning = finish_recording(recorder, options);
        let mut sinks = Fanout { sinks: vec![&mut journal, &mut stats, watcher], after_frame: None };
        report_recording_end(&options.recording_options.recording, &mut sinks, setup.ended_at);
        let written = journal.finish().and_then(BackgroundWriter::finish);
        let written = written.map_err(|error| folder.write_error("journal.jsonl", &error));
        let written = written.and(truth_log.finish().map_err(|error| folder.write_error(folder::TRUTH_FILE, &error)));
        if let Err(error) = &written {
            add_write_failure(&mut finish.ending, error);
        }
        let mut report = stats.report(ending(job, Some(setup), finish, wall_time_s));
        report.incidents.recording = options.recording_options.recording.ended_early();
        report.incidents.warnings =
            job_warnings(job, library).iter().map(ToString::to_string).chain(warning).chain(owned.clone()).collect();
        report.pacing = options.real_time.then(|| controls.pacing.report(missed_before));
        let is_judged = !setup.has_own_task && setup.own_rig.is_none();
        report.verdict = if is_judged { verdict(job, &report) } else { None };
        let reported = folder.write_json(folder::REPORT_FILE, &report);
        report.incidents.warnings.extend(reported.as_ref().err().map(ToString::to_string));
        Ok((RunResult { folder: folder.path().to_owned(), report }, written.and(reported)))
    }

    /// Starts the Rerun recording of the run.
    fn start_recording(&self, setup: &RunSetup) -> Result<RerunSink, RunError> {
        let Self { job, library, folder, options, .. } = self;
        let layout = JobLayout::of(job);
        let context = RunContext {
            name: job.name.clone(),
            seed: job.seed(),
            library: Arc::clone(library),
            model: setup.model.clone(),
            method: setup.params.method,
            parts: layout.parts,
            bins: layout.bins,
            paths: layout.paths,
            truth: setup.known_truth(),
        };
        let path = folder.path().join("run.rrd");
        let sink = RerunSink::start(&options.rerun, &path, context, &options.recording_options);
        sink.map_err(|error| RunError::Recording(error.to_string()))
    }
}

impl RunSetup {
    /// Runs the control loop on the rig, or on `own`, at `pace` or at full speed, until one of the flags is set.
    fn play(
        &mut self,
        library: &Arc<Library>,
        own: Option<&mut dyn Rig>,
        pace: Option<PaceClock<'_>>,
        sink: &mut dyn Sink,
        clock: &dyn Clock,
        (stop, give_way): (&AtomicBool, &AtomicBool),
    ) -> FinalState {
        let Self { rig, model, task, params, faults, streams, own_rig, own_planner, ended_at, .. } = self;
        let (mut faulty, mut paced);
        let mut rig: &mut dyn Rig = if let Some(own) = own {
            own
        } else if let Some(own) = own_rig {
            own.as_mut()
        } else if faults.is_empty() {
            rig
        } else {
            faulty = Faulty::new(rig, faults, *streams, &std::thread::sleep);
            &mut faulty
        };
        if let Some(pace) = pace {
            paced = RealTimeRig::new(rig, pace);
            rig = &mut paced;
        }
        let io = RunIo { rig: &mut *rig, model, sink, clock, stop, give_way, planner: own_planner.take() };
        let finish = control::run(io, library, task.as_mut(), params);
        *ended_at = rig.now();
        finish
    }
}

/// Closes the recording; returns a message if it is incomplete.
fn finish_recording(sink: RerunSink, options: &RunOptions) -> Option<String> {
    let has_viewer = matches!(options.rerun, RerunMode::Connect { .. } | RerunMode::Spawn);
    let finished = sink.finish();
    match (finished, options.recording_options.recording.ended_early()) {
        (_, Some(text)) => Some(text),
        (Err(error), None) => Some(error.to_string()),
        (Ok(false), None) if has_viewer => {
            Some("the viewer did not take the whole run; the recording in the run folder is whole".into())
        }
        (Ok(_), None) => None,
    }
}
