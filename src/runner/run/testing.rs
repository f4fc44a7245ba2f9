//! Shared parts of the tests of runs.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use serde_json::Value;
use tempfile::TempDir;

use super::{OwnParts, PacingStats, RunOptions, RunResult, job_library, run};
use crate::config::{JobSpec, Origin};
use upm_core::time::{MonotonicClock, StoppedClock};
use upm_recording::{Fanout, RecordingOptions, RerunMode};

/// Options of a run below `out` without a recording, at full speed.
pub(super) fn options(out: &TempDir) -> RunOptions {
    RunOptions {
        out: out.path().to_owned(),
        started_utc: "20260101T000000Z".into(),
        rerun: RerunMode::Off,
        real_time: false,
        recording_options: RecordingOptions::lossless(MonotonicClock::new()),
    }
}

/// The job under a camera with a quarter of the pixels, for runs that are not repeated from their folder.
pub(super) fn with_small_pictures(mut job: JobSpec) -> JobSpec {
    let camera = &mut job.rig.sim.camera;
    camera.focal_px *= 0.5;
    camera.principal_px = camera.principal_px.map(|px| px.map(|px| 0.5 * px));
    camera.size_px = camera.size_px.map(|side| side / 2);
    (job.rig.model.lens, job.rig.model.frame_size_px) = (camera.lens(), camera.size_px);
    job
}

/// The job in `document`, as a file in `configs/`.
pub(super) fn job_in_configs(document: &Value) -> JobSpec {
    let origin = Origin::of_file(&Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("configs/job.json"));
    JobSpec::from_json(&document.to_string(), &origin, None).unwrap()
}

/// The run of a job without pacing, and its folder.
pub(super) fn played(job: &JobSpec) -> (TempDir, RunResult) {
    let (out, stop, library) = (TempDir::new().unwrap(), AtomicBool::new(false), job_library(job).unwrap());
    let (pacing, mut watcher) = (PacingStats::default(), Fanout::default());
    let how = (&options(&out), OwnParts::default());
    let done = run(job, library, how, &StoppedClock, &stop, &pacing, &mut watcher).unwrap();
    (out, done)
}

/// Calls of a rig in a test that go to its field `rig` as they are.
macro_rules! as_its_rig {
    (now) => { fn now(&self) -> PlateTime { self.rig.now() } };
    (takes_over) => { fn takes_over(&self) -> bool { self.rig.takes_over() } };
    (settled_at) => { fn settled_at(&self) -> PlateTime { self.rig.settled_at() } };
    (capture) => { fn capture(&mut self, frame: &mut Frame) -> Result<(), RigError> { self.rig.capture(frame) } };
    (trace) => { fn trace(&self) -> AccelTrace { self.rig.trace() } };
    (stop) => { fn stop(&mut self) { self.rig.stop() } };
    ($($call:ident)+) => { $(as_its_rig!($call);)+ };
}
pub(super) use as_its_rig;
