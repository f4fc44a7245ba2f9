//! Forecast of a job before anything moves: the reach of the library at the starts and targets of the parts, and dry
//! runs, which are runs without pixels.

mod runs;
mod verdict;

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use super::coverage::PlaceReach;
use super::planner_selection::PlannerSelection;
use super::setup::RunSetup;
use crate::config::{Diagnostic, JobSpec, PlacedPart, TaskSpec};
use upm_control::ControlParams;
use upm_core::geometry::Vec2;
use upm_core::job::CameraMode;
use upm_core::time::PlateTime;
use upm_core::units::m_from_mm;
use upm_planning::cor_library::Library;
use upm_planning::planner::{FieldPlanner, Independence, PlanningMethod, RotationPlanner};

use runs::at_the_same_time;

pub use runs::{ClosestApproach, DryRun, DryRunRecord};
pub use verdict::{DryRuns, ForecastSummary, PlanVerdict};

/// Speed beyond any that a part can hold, m/s.
const FASTEST_MPS: f64 = 1.0;
/// Dry runs of a job where no seeds are named.
const DRY_RUNS: u64 = 5;

/// Forecast of a job.
#[derive(Clone, Debug)]
pub struct Forecast {
    /// Planner of the job, with the reason for it.
    pub planner: PlannerSelection,
    /// The parts, in the order of the job.
    pub parts: Vec<PartForecast>,
    /// Degree to which the planner's motions can move all parts independently at their starts.
    pub independence: Independence,
    /// True if the job plans with synthesised fields.
    pub fields: bool,
    /// Speed asked of parts on paths, and the speed that they can hold along them by a dry run, m/s; `None` for other
    /// tasks and where that dry run does not complete.
    pub speed_mps: Option<[f64; 2]>,
    /// The dry runs, each with another seed.
    pub dry_runs: DryRuns,
}

/// A part of a job and the reach of the library at its places.
#[derive(Clone, Debug, PartialEq)]
pub struct PartForecast {
    /// Id: `penny-1`.
    pub id: String,
    /// Radius of the kind's outline, m.
    pub radius_m: f64,
    /// Place before the first pulse.
    pub start: PlaceReach,
    /// Target at the end of the first dry run.
    pub target: Option<PlaceReach>,
}

/// Makes dry runs of `job` with `library` on all cores, from the start places of the job's seed: one with each of
/// `seeds`, or where there are none with the job's own and the next four. `watch` receives the plate time in one of
/// them and the share of all that is done, 0 to 1. All end early once `stop` is set. `Err` if the
/// parts find no places.
pub fn dry_run(
    job: &JobSpec,
    seeds: &[u64],
    library: &Arc<Library>,
    stop: &AtomicBool,
    watch: &mut (dyn FnMut(PlateTime, f64) + Send),
) -> Result<Forecast, Diagnostic> {
    // nothing is played on the rig of this setup
    let RunSetup { params, placed, .. } = RunSetup::new(job, library)?;
    let job = job.clone().with_camera(CameraMode::Positions);
    let next: Vec<u64> = (0..DRY_RUNS).map(|number| job.seed().wrapping_add(number)).collect();
    let seeds = if seeds.is_empty() { &next } else { seeds };
    let mut jobs: Vec<JobSpec> = seeds.iter().map(|&seed| job.clone().at_the_same_places(seed)).collect();
    let fast = as_fast_as_possible(&job);
    jobs.extend(fast.iter().map(|(job, ..)| job.clone()));
    let by_fields = matches!(params.method, PlanningMethod::SynthesizedField | PlanningMethod::MovingField);
    // the dry runs begin at the same time: what their planners share is computed before, once
    let fields = by_fields.then(|| FieldPlanner::new(library, params.planner)).flatten();
    let _rotations = (!by_fields).then(|| RotationPlanner::new(Arc::clone(library), params.planner));
    let mut dry_runs = at_the_same_time(&jobs, library, stop, watch)?;
    let speed_mps = fast.and_then(|(_, asked_mps, longest_m)| {
        let run = dry_runs.pop()?;
        let [begun, ended] = run.record.advanced;
        let advanced_s = ended.secs_since(begun);
        (run.report.reached_goal() && advanced_s > 0.0).then(|| [asked_mps, longest_m / advanced_s])
    });
    let starts_m = named(&placed, &params);
    let target_m = |i: usize| dry_runs.first()?.report.parts.get(i)?.target_mm;
    let parts = starts_m.iter().zip(&params.parts).enumerate().map(|(i, (&start_m, part))| PartForecast {
        id: part.id.clone(),
        radius_m: params.radius_m(i),
        start: PlaceReach::of(library, start_m),
        target: target_m(i).map(|[x, y]| PlaceReach::of(library, Vec2::new(m_from_mm(x), m_from_mm(y)))),
    });
    Ok(Forecast {
        planner: PlannerSelection::of(&job),
        parts: parts.collect(),
        independence: match &fields {
            Some(fields) => Independence::of_fields(fields, &starts_m),
            None => Independence::of_rotations(library, &starts_m),
        },
        fields: fields.is_some(),
        speed_mps,
        dry_runs: DryRuns(dry_runs),
    })
}

/// `job` with its parts going along their paths once, as fast as they can; the speed that `job` asks, m/s, and the
/// longest of the paths, m. `None` for a job without paths.
fn as_fast_as_possible(job: &JobSpec) -> Option<(JobSpec, f64, f64)> {
    let mut job = job.clone();
    let TaskSpec::Trajectories { paths, in_phase, .. } = &mut job.task else { return None };
    let asked_mps = paths.iter().map(|path| path.speed_mps).fold(0.0, f64::max);
    paths.iter_mut().for_each(|path| (path.speed_mps, path.repeat) = (FASTEST_MPS, 1));
    let longest_m = paths.iter().map(|path| path.line(*in_phase).length_m()).fold(0.0, f64::max);
    Some((job, asked_mps, longest_m))
}

/// Start of each part in the order of the names that control will give: of one kind, parts without a given place are
/// named from left to right.
fn named(placed: &[PlacedPart], params: &ControlParams) -> Vec<Vec2> {
    let mut starts_m: Vec<Vec2> = placed.iter().map(|part| part.position_m).collect();
    for kind in 0..params.kinds.len() {
        let anywhere = |i: &usize| params.parts[*i].kind == kind && params.parts[*i].expected_m.is_none();
        let unnamed: Vec<usize> = (0..placed.len().min(params.parts.len())).filter(anywhere).collect();
        let mut places_m: Vec<Vec2> = unnamed.iter().map(|&i| placed[i].position_m).collect();
        places_m.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
        unnamed.into_iter().zip(places_m).for_each(|(i, place_m)| starts_m[i] = place_m);
    }
    starts_m
}

#[cfg(test)]
mod tests;
