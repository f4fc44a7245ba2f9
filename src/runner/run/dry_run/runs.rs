//! Runs without pixels, several at the same time, and their records.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use parking_lot::Mutex;

use crate::config::{Diagnostic, JobSpec};
use crate::run::in_memory::InMemoryRun;
use upm_control::{EventFacts, EventKind, FrameFacts, Sink};
use upm_core::background::on_threads;
use upm_core::geometry::Vec2;
use upm_core::job::Finding;
use upm_core::time::PlateTime;
use upm_planning::cor_library::Library;
use upm_planning::task::Setpoints;
use upm_recording::{Fanout, Report};

/// Distance between two points of a recorded path, m.
const PATH_STEP_M: f64 = 0.3e-3;

/// A run of a job without pixels.
#[derive(Clone, Debug)]
pub struct DryRun {
    /// Its report.
    pub report: Report,
    /// Its further figures.
    pub record: DryRunRecord,
}

/// Figures of a dry run that its report does not have.
#[derive(Clone, Debug, Default)]
pub struct DryRunRecord {
    /// Path of each part as measured, m.
    pub paths_m: Vec<Vec<Vec2>>,
    /// Least gap between two parts.
    pub nearest: Option<ClosestApproach>,
    /// Limits that cut the steps of cycles short, with the number of these cycles.
    pub limits_met: BTreeMap<String, u64>,
    radii_m: Vec<f64>,
    /// Time of the last observation before the task advanced, and of the last one.
    pub(super) advanced: [PlateTime; 2],
}

/// Least gap between two parts in a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClosestApproach {
    /// Distance between their rims, m; 0 or less where they touch.
    pub gap_m: f64,
    /// Indices of the two.
    pub parts: [usize; 2],
    /// Plate time, s.
    pub at_s: f64,
}

impl Sink for DryRunRecord {
    fn setpoints(&mut self, at: PlateTime, wanted: &Setpoints) {
        let moves = wanted.done || wanted.paths.iter().flatten().any(|path| path.reference_m > 0.0);
        self.advanced = [if moves { self.advanced[0] } else { at }, at];
    }

    fn frame(&mut self, facts: &FrameFacts<'_>) {
        let places_m: Vec<Vec2> = facts.tracks.iter().map(|track| track.seen.position_m).collect();
        self.paths_m.resize(places_m.len(), Vec::new());
        for (path_m, &place_m) in self.paths_m.iter_mut().zip(&places_m) {
            if path_m.last().is_none_or(|last_m| (place_m - last_m).norm() > PATH_STEP_M) {
                path_m.push(place_m);
            }
        }
        for (b, (place_m, radius_m)) in places_m.iter().zip(&self.radii_m).enumerate() {
            for (a, other_m) in places_m[..b].iter().enumerate() {
                let gap_m = (other_m - place_m).norm() - self.radii_m[a] - radius_m;
                if self.nearest.is_none_or(|nearest| gap_m < nearest.gap_m) {
                    let at_s = facts.frame.exposed_at.secs();
                    self.nearest = Some(ClosestApproach { gap_m, parts: [a, b], at_s });
                }
            }
        }
    }

    fn event(&mut self, event: &EventFacts) {
        let EventKind::Finding { found, ended_after: Some(times), reason } = &event.kind else {
            return;
        };
        let is_limit = matches!(
            found.finding,
            Finding::StepsMeetEdge | Finding::StepsMeetParts | Finding::StepsUnreachable | Finding::SolverFails
        );
        if is_limit {
            *self.limits_met.entry(reason.text.clone()).or_default() += times;
        }
    }
}

/// Progress of all runs, 0 to 1 each, and what it is shown to.
type Progress<'w> = Mutex<(Vec<f64>, &'w mut (dyn FnMut(PlateTime, f64) + Send))>;

/// Takes the progress of one of the runs.
struct ProgressSink<'a, 'w> {
    number: usize,
    progress: &'a Progress<'w>,
}

impl Sink for ProgressSink<'_, '_> {
    fn setpoints(&mut self, at: PlateTime, wanted: &Setpoints) {
        let (shares, watch) = &mut *self.progress.lock();
        shares[self.number] = wanted.progress;
        watch(at, shares.iter().sum::<f64>() / shares.len() as f64);
    }
}

/// Runs all `jobs`, each on its own thread, to the end or until `stop` is set; the results are in their order.
pub(super) fn at_the_same_time(
    jobs: &[JobSpec],
    library: &Arc<Library>,
    stop: &AtomicBool,
    watch: &mut (dyn FnMut(PlateTime, f64) + Send),
) -> Result<Vec<DryRun>, Diagnostic> {
    let progress: Progress<'_> = Mutex::new((vec![0.0; jobs.len()], watch));
    let run = |(number, job)| {
        let run = InMemoryRun::with_library(job, Arc::clone(library))?;
        let radii_m = (0..run.params().parts.len()).map(|part| run.params().radius_m(part)).collect();
        let mut record = DryRunRecord { radii_m, ..DryRunRecord::default() };
        let mut shown = ProgressSink { number, progress: &progress };
        let report = run.run_until(stop, &mut Fanout { sinks: vec![&mut record, &mut shown], after_frame: None });
        Ok(DryRun { report, record })
    };
    on_threads(jobs.len(), jobs.iter().enumerate(), &|_| (), run).into_iter().collect()
}
