//! Runs of jobs into run folders.

use std::path::PathBuf;

use pyo3::prelude::*;

use super::job::Job;
use super::own::{Own, Raised};
use super::refusal::{refusal, said};
use super::waiting;
use upm::recording::{Fanout, RecordingOptions, RerunMode};
use upm::run::{self as runs, PacingStats, RunOptions, RunResult, library_and_places};
use upm::time::MonotonicClock;

/// Runs `job` into a new folder of `out`, named after `started_utc`, with what the caller brings; returns that folder
/// and its report, JSON.
#[pyfunction]
pub fn run(py: Python<'_>, job: &Job, out: PathBuf, started_utc: String, own: Own) -> PyResult<(PathBuf, String)> {
    let (job, raised) = (&job.0, Raised::default());
    let result = waiting::until_done(py, |stop| {
        let library = library_and_places(job)?;
        let clock = MonotonicClock::new();
        let recording_options = RecordingOptions::lossless(clock);
        let options = RunOptions { out, started_utc, rerun: RerunMode::Off, real_time: false, recording_options };
        let own = own.parts(&library, stop, &raised);
        let (pacing, mut watcher) = (PacingStats::default(), Fanout::default());
        runs::run(job, library, (&options, own), &clock, stop, &pacing, &mut watcher)
    })?;
    if let Some(error) = raised.lock().ok().and_then(|mut raised| raised.take()) {
        return Err(error);
    }
    let RunResult { folder, report } = result.map_err(said)?;
    let report = serde_json::to_string(&report).map_err(|error| refusal(vec![error.to_string()]))?;
    Ok((folder, report))
}
