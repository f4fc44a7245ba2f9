use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use super::end_facts::{ending, verdict};
use super::error::RunError;
use super::library::job_library;
use super::setup::{RunSetup, TruthInJobOrder, simulated_rig};
use crate::config::{Diagnostic, JobSpec};
use upm_control::{ControlParams, Sink};
use upm_core::ground_truth::GroundTruthHandle;
use upm_core::rig::Rig;
use upm_core::time::StoppedClock;
use upm_planning::cor_library::Library;
use upm_planning::task::Task;
use upm_recording::{Fanout, Report, RunStats};
use upm_sim::SimRig;

/// A run without files: a job with its simulated rig, its task and its library, built in memory.
///
/// It reads no clock and starts no thread, so equal jobs have equal reports; wall times in them are zero.
pub struct InMemoryRun<'a> {
    job: &'a JobSpec,
    library: Arc<Library>,
    setup: RunSetup,
}

impl<'a> InMemoryRun<'a> {
    /// Reads the library of `job` and places its parts.
    ///
    /// # Errors
    /// No library of its rig, or no places for the parts.
    pub fn new(job: &'a JobSpec) -> Result<Self, RunError> {
        Ok(Self::with_library(job, job_library(job)?)?)
    }

    /// A run of `job` with `library`. `Err` if the parts find no places.
    pub(crate) fn with_library(job: &'a JobSpec, library: Arc<Library>) -> Result<Self, Diagnostic> {
        let setup = RunSetup::new(job, &library)?;
        Ok(Self { job, library, setup })
    }

    /// Replaces the task of the job by `task`, which receives the parts in the order of the job and ends the run by
    /// [`done`](upm_planning::task::Setpoints::done). The report then has no verdict, which would be about the
    /// job's task.
    pub fn with_task(mut self, task: impl Task + 'static) -> Self {
        self.setup.take_task(Box::new(task));
        self
    }

    /// COR library of the run.
    pub fn library(&self) -> &Arc<Library> {
        &self.library
    }

    /// True state of the simulated rig, as of each frame.
    pub fn truth(&self) -> GroundTruthHandle {
        self.setup.truth.clone()
    }

    /// Parts, tolerance and limits of the control loop.
    pub fn params(&self) -> &ControlParams {
        &self.setup.params
    }

    /// Runs to the end on the simulated rig, with the job's faults.
    pub fn run(self) -> Report {
        self.run_until(&AtomicBool::new(false), &mut Fanout::default())
    }

    /// As [`Self::run`], and ends after the next frame once `stop` is set; `watcher` receives all facts.
    pub fn run_until(mut self, stop: &AtomicBool, watcher: &mut dyn Sink) -> Report {
        self.finish(None, stop, watcher)
    }

    /// Runs to the end on the rig that `make` returns for the simulated one, and returns that rig with the report: a
    /// rig that logs, delays or checks the calls to it. Truth in the report is the simulated rig's.
    ///
    /// # Errors
    /// A job with faults, since only the simulated rig has them.
    pub fn run_on<R: Rig>(mut self, make: impl FnOnce(SimRig) -> R) -> Result<(Report, R), RunError> {
        self.setup.refuse_faults(self.job)?;
        let (simulated, _) = simulated_rig(self.job)?;
        self.setup.truth = simulated.probe();
        let mut rig = make(simulated);
        if !rig.takes_over() {
            self.setup.fall_back();
        }
        let report = self.finish(Some(&mut rig), &AtomicBool::new(false), &mut Fanout::default());
        Ok((report, rig))
    }

    fn finish(&mut self, own: Option<&mut dyn Rig>, stop: &AtomicBool, watcher: &mut dyn Sink) -> Report {
        let Self { job, library, setup } = self;
        let (mut named, mut stats) = (TruthInJobOrder(setup.truth.clone()), RunStats::new(Some(setup.truth.clone())));
        let mut sinks = Fanout { sinks: vec![&mut named, &mut stats, watcher], after_frame: None };
        let finish = setup.play(library, own, None, &mut sinks, &StoppedClock, (stop, &AtomicBool::new(false)));
        let mut report = stats.report(ending(job, Some(setup), finish, 0.0));
        report.verdict = if setup.has_own_task { None } else { verdict(job, &report) };
        report
    }
}

#[cfg(test)]
mod tests {
    use std::sync::LazyLock;

    use serde_json::{Value, json};

    use super::*;
    use crate::config::PlannerChoice;
    use crate::run::testing::{job_in_configs, played};
    use crate::run::{Verification, verify};
    use upm_core::geometry::Vec2;
    use upm_core::job::{CameraMode, Finding, Outcome, StopCause};
    use upm_core::time::PlateTime;
    use upm_planning::task::Setpoints;
    use upm_recording::Verdict;

    fn job(faults: Value) -> JobSpec {
        let text = json!({
            "name": "made", "seed": 11, "rig": "rigs/upm-2.json", "faults": faults,
            "parts": [{"kind": "penny", "position_mm": [-30, 0]}, {"kind": "dime", "position_mm": [30, 0]}],
            "task": {"type": "arrange", "targets_mm": [[-24, 6], [28, -3]]},
        });
        job_in_configs(&text)
    }

    /// Report of a run in memory of the job without faults.
    static PLAIN: LazyLock<Report> = LazyLock::new(|| InMemoryRun::new(&job(json!([]))).unwrap().run());

    fn dropped_frames() -> Value {
        json!([{"component": "camera", "kind": "drop", "value": 0.3, "from_s": 0.2}])
    }

    #[test]
    fn tasks_of_a_list_begin_where_the_one_before_has_ended() {
        let mut text = job(json!([])).effective();
        text["task"] = Value::Null;
        text["tasks"] = json!([
            {"type": "arrange", "targets_mm": [[-24, 6], [28, -3]]}, {"type": "hold", "duration_s": 0.5},
            {"type": "arrange", "targets_mm": [[24, 6], [-28, -3]]},
        ]);
        text["repeat"] = 2.into();
        let report = InMemoryRun::new(&job_in_configs(&text).with_camera(CameraMode::Positions)).unwrap().run();
        assert_eq!((report.outcome, report.work.tasks_from_s.len()), (Outcome::Completed, 6), "{}", report.reason);
        assert!(report.work.tasks_from_s.is_sorted() && report.accuracy.max_error_mm < Some(0.5), "{report:?}");
        assert_eq!(report.verdict, Some(Verdict::True));
    }

    #[test]
    fn report_of_a_run_in_memory_is_that_of_a_run_with_a_folder() {
        for job in [job(json!([])), job(dropped_frames()), job(dropped_frames()).with_camera(CameraMode::Positions)] {
            let has_faults = !job.faults.is_empty();
            let report = if has_faults { InMemoryRun::new(&job).unwrap().run() } else { PLAIN.clone() };
            assert_eq!((report.outcome, report.camera), (Outcome::Completed, job.camera), "{}", report.reason);
            let (_out, done) = played(&job);
            assert_eq!(report, done.report);
            let verified = verify(&done.folder, &AtomicBool::new(false), &mut Fanout::default()).unwrap();
            assert!(matches!(verified, Verification::Equal { extent: crate::run::Extent::Whole, .. }), "{verified:?}");
        }
    }

    #[test]
    fn run_without_pixels_takes_the_same_time_and_sees_what_is_hidden_as_hidden() {
        let run = |job: JobSpec| InMemoryRun::new(&job).unwrap().run();
        let (pixels, positions) = (&*PLAIN, run(job(json!([])).with_camera(CameraMode::Positions)));
        assert_eq!(pixels.work.pulses, positions.work.pulses);
        assert!((pixels.plate_time_s - positions.plate_time_s).abs() < 0.5, "{}", positions.plate_time_s);
        let [off, seen_off] = [&positions, pixels].map(|report| report.accuracy.sensing_rms_error_at_rest_mm.unwrap());
        assert!((0.5..2.0).contains(&(off / seen_off)), "{off} mm, in pictures {seen_off} mm");
        let covered = |to_s: f64| {
            let fault = json!([{"component": "view", "kind": "hand", "value": 0.5, "from_s": 0.5, "to_s": to_s}]);
            let report = run(job(fault).with_camera(CameraMode::Positions));
            (report.outcome, report.stop.map(|stop| stop.code))
        };
        assert_eq!(covered(2.0).0, Outcome::Completed, "a hand that goes away");
        assert_eq!(covered(60.0), (Outcome::Failed, Some(StopCause::Found(Finding::ViewHidden))));
        let dark = run(
            job(json!([{"component": "camera", "kind": "dark", "from_s": 0.5}])).with_camera(CameraMode::Positions)
        );
        assert_eq!(dark.stop.map(|stop| stop.code), Some(StopCause::Found(Finding::CameraDark)));
    }

    #[test]
    fn run_on_the_simulated_rig_itself_is_the_same_run() {
        let job = job(json!([]));
        let (report, rig) = InMemoryRun::new(&job).unwrap().run_on(|rig| rig).unwrap();
        assert_eq!(report, *PLAIN);
        assert!((rig.now().secs() - report.plate_time_s).abs() < 1e-4, "{} s", rig.now().secs());
    }

    #[test]
    fn job_with_faults_is_not_run_on_a_rig_of_the_callers() {
        let job = job(dropped_frames());
        let error = InMemoryRun::new(&job).unwrap().run_on(|rig| rig).map(|_| ()).unwrap_err();
        assert!(error.to_string().contains("faults: expected none on a rig of the caller's, found 1 fault"), "{error}");
    }

    /// Task that holds every part for this many observations.
    struct HoldForFrames(u32);

    impl Task for HoldForFrames {
        fn next(&mut self, _: PlateTime, parts_in_table_m: &[Vec2]) -> Setpoints {
            self.0 = self.0.saturating_sub(1);
            let (subgoals_m, targets_m) = (parts_in_table_m.to_vec(), parts_in_table_m.to_vec());
            Setpoints { subgoals_m, targets_m, phase: "looking".into(), done: self.0 == 0, ..Setpoints::default() }
        }
    }

    #[test]
    fn callers_task_replaces_the_jobs_and_has_no_verdict() {
        let mut job = job(json!([]));
        job.document.planner = PlannerChoice::SynthesizedField;
        let report = InMemoryRun::new(&job).unwrap().with_task(HoldForFrames(3)).run();
        // the probe is the first pulse of every run
        assert_eq!((report.outcome, report.work.pulses), (Outcome::Completed, 1), "{}", report.reason);
        assert_eq!(report.verdict, None);
    }
}
