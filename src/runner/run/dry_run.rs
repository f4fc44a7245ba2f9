//! Forecast of a job before anything moves: the reach of the library at the starts and targets of the parts, and a few
//! dry runs on the displacement model.

use std::sync::Arc;

use super::coverage::WorstDirection;
use super::planner_selection::PlannerSelection;
use super::setup::{self, RunSetup};
use crate::config::{Diagnostic, JobSpec, PlacedPart, TaskSpec};
use upm_control::{self as control, ClosestApproach, ControlParams, DryRun, DryRunParams, FreshPlanner, LimitMet};
use upm_cor_library::Library;
use upm_core::geometry::{Polyline, Vec2};
use upm_core::job::Outcome;
use upm_core::random::Streams;
use upm_core::time::PlateTime;
use upm_planner::{FieldPlanner, Independence, PlanningMethod, Reach};
use upm_task::PathParams;

/// Speed beyond any that a part can hold, m/s.
const FASTEST_MPS: f64 = 1.0;
/// Most dry runs of a job.
const DRY_RUNS: u64 = 5;
/// Limit on the modelled computing time of all dry runs, ms; at least one is made.
pub(super) const WORK_MS: f64 = 1900.0;
/// Allowance for the computing time of another dry run, relative to the mean of the previous ones.
const MARGIN: f64 = 1.3;

/// Forecast of a job.
#[derive(Clone, Debug, PartialEq)]
pub struct Forecast {
    /// Planner of the job, with the reason for it.
    pub planner: PlannerSelection,
    /// Half the plate's side, m.
    pub half_side_m: f64,
    /// The parts, in the order of the job.
    pub parts: Vec<PartForecast>,
    /// Degree to which the planner's motions can move all parts independently at their starts.
    pub independence: Independence,
    /// True if the job plans with synthesised fields.
    pub fields: bool,
    /// Speed asked of parts on paths, and the speed that they can hold along them by a dry run, m/s; `None` for other
    /// tasks and where that dry run does not complete.
    pub speed_mps: Option<[f64; 2]>,
    /// The dry runs, each with different random numbers.
    pub dry_runs: Vec<DryRun>,
    /// Relative standard deviation of the parts' displacements in them: the spread of friction in the rig's file.
    pub friction_spread: f64,
}

/// A part of a job and the reach of the library at its places.
#[derive(Clone, Debug, PartialEq)]
pub struct PartForecast {
    /// Id: `penny-1`.
    pub id: String,
    /// Radius of the kind's outline, m.
    pub radius_m: f64,
    /// Place before the first pulse.
    pub start: StartForecast,
    /// Target at the end of the first dry run.
    pub target: Option<StartForecast>,
}

/// A position of a part with the reach of the library there.
#[derive(Clone, Debug, PartialEq)]
pub struct StartForecast {
    /// Position, and effect of one pulse in the weakest direction.
    pub place: WorstDirection,
    /// Singular values of the flows of all entries there, larger first; see [`Reach`].
    pub singular_values: [f64; 2],
}

impl StartForecast {
    fn of(library: &Library, position_m: Vec2) -> Self {
        let reach = Reach::of(library, position_m);
        Self { place: WorstDirection::of(position_m, &reach), singular_values: reach.singular_values }
    }
}

/// Prediction from the dry runs of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlanVerdict {
    /// All dry runs that were not broken off reach the goal.
    CanBeDone,
    /// At least half of them reach the goal, but not all.
    Likely,
    /// Fewer than half of them reach the goal, but at least one.
    Unlikely,
    /// None of them reaches the goal.
    CannotBeDone,
    /// The job is too long for a dry run: all were broken off.
    Undecided,
}

impl PlanVerdict {
    /// Stable code of the verdict.
    pub fn code(self) -> &'static str {
        match self {
            Self::CanBeDone => "can_be_done",
            Self::Likely => "likely",
            Self::Unlikely => "unlikely",
            Self::CannotBeDone => "cannot_be_done",
            Self::Undecided => "undecided",
        }
    }

    /// True if the job is predicted to fail.
    pub fn is_failure(self) -> bool {
        matches!(self, Self::Unlikely | Self::CannotBeDone)
    }
}

/// Progress of the dry runs of a job.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DryRunProgress {
    /// Number of the current dry run, from 1.
    pub dry_run: u64,
    /// Expected number of dry runs.
    pub of: u64,
    /// Plate time in the current dry run.
    pub at: PlateTime,
    /// Share of all dry runs that is done, 0 to 1.
    pub done: f64,
}

/// Makes dry runs of `job` with `library`; `watch` receives the progress. `Err` if the parts find no places.
pub fn dry_run(
    job: &JobSpec,
    library: &Arc<Library>,
    watch: &mut dyn FnMut(DryRunProgress),
) -> Result<Forecast, Diagnostic> {
    // only parts and parameters of the setup are used; nothing is played on its rig
    let RunSetup { params, placed, model, planner: selection, .. } = RunSetup::new(job, library)?;
    let starts_m = named(&placed, &params);
    let planner = FreshPlanner::new(params.method, library, params.planner);
    let (mut dry_runs, mut work_ms, mut of) = (Vec::new(), 0.0, DRY_RUNS);
    let dry_run = |job: &JobSpec, number: u64, most_work_ms: f64, watch: &mut dyn FnMut(PlateTime, f64)| {
        let dry_run = DryRunParams {
            starts_m: starts_m.clone(),
            frame_hz: model.frame_hz,
            friction_spread: job.rig.document.friction.spread,
            streams: Streams::new(job.seed()),
            number,
            most_work_ms,
        };
        let mut task = setup::task(job, library, &placed, params.method);
        control::dry_run(library, &planner, task.as_mut(), &params, &dry_run, watch)
    };
    for number in 0..DRY_RUNS {
        let done = dry_run(job, number, WORK_MS - work_ms, &mut |at, progress| {
            let done = (number as f64 + progress) / of as f64;
            watch(DryRunProgress { dry_run: number + 1, of, at, done });
        });
        work_ms += done.work_ms;
        dry_runs.push(done);
        of = affordable(work_ms, number + 1);
        if of == number + 1 {
            break;
        }
    }
    let speed_mps = speed_mps(job, |job, watch| dry_run(job, 0, WORK_MS, watch));
    let by_fields = params.method == PlanningMethod::SynthesizedField;
    let fields = by_fields.then(|| FieldPlanner::new(library, params.planner)).flatten();
    let targets_m = dry_runs.first().map_or(&[][..], |first| &first.targets_m);
    let parts = starts_m.iter().zip(&params.parts).enumerate().map(|(i, (&start_m, part))| PartForecast {
        id: part.id.clone(),
        radius_m: params.kinds.get(part.kind).map_or(0.0, |kind| kind.radius_m),
        start: StartForecast::of(library, start_m),
        target: targets_m.get(i).map(|&target_m| StartForecast::of(library, target_m)),
    });
    Ok(Forecast {
        planner: selection,
        half_side_m: 0.5 * model.plate_side_m,
        parts: parts.collect(),
        independence: match &fields {
            Some(fields) => Independence::of_fields(fields, &starts_m),
            None => Independence::of_rotations(library, &starts_m),
        },
        fields: fields.is_some(),
        speed_mps,
        dry_runs,
        friction_spread: job.rig.document.friction.spread,
    })
}

/// Speed asked of parts on paths, and the speed that the slowest of them holds when all go as fast as they can: one
/// pass by `dry_run`, m/s.
fn speed_mps(job: &JobSpec, dry_run: impl Fn(&JobSpec, &mut dyn FnMut(PlateTime, f64)) -> DryRun) -> Option<[f64; 2]> {
    let mut fast = job.clone();
    let TaskSpec::Trajectories { paths, in_phase, .. } = &mut fast.task else { return None };
    let asked_mps = paths.iter().map(|path| path.speed_mps).fold(0.0, f64::max);
    paths.iter_mut().for_each(|path| (path.speed_mps, path.repeat) = (FASTEST_MPS, 1));
    let pass_m = |path: &PathParams| {
        let back = if *in_phase { path.waypoints_m.get(..1).unwrap_or_default() } else { &[] };
        Polyline::new([&path.waypoints_m, back].concat()).length_m()
    };
    let longest_m = paths.iter().map(pass_m).fold(0.0, f64::max);
    let (mut begun_s, mut ended_s) = (0.0, 0.0);
    let done = dry_run(&fast, &mut |at, progress| {
        ended_s = at.secs();
        if progress == 0.0 {
            begun_s = ended_s;
        }
    });
    (is_completed(&done) && ended_s > begun_s).then(|| [asked_mps, longest_m / (ended_s - begun_s)])
}

/// Number of dry runs that fit if the first `done` of them took `work_ms`. Another one must have time to take
/// somewhat longer than the previous ones, since one that is broken off has no result.
fn affordable(work_ms: f64, done: u64) -> u64 {
    let each_ms = MARGIN * work_ms / done as f64;
    let more = if each_ms > 0.0 { ((WORK_MS - work_ms).max(0.0) / each_ms) as u64 } else { DRY_RUNS };
    (done + more).min(DRY_RUNS)
}

/// Start of each part in the order of the names that control will give: of one kind, parts without a given place are
/// named from left to right.
pub(super) fn named(placed: &[PlacedPart], params: &ControlParams) -> Vec<Vec2> {
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

impl Forecast {
    /// Verdict of the dry runs.
    pub fn verdict(&self) -> PlanVerdict {
        match (self.completed(), self.decided()) {
            (_, 0) => PlanVerdict::Undecided,
            (completed, decided) if completed == decided => PlanVerdict::CanBeDone,
            (0, _) => PlanVerdict::CannotBeDone,
            (completed, decided) if 2 * completed >= decided => PlanVerdict::Likely,
            _ => PlanVerdict::Unlikely,
        }
    }

    /// Number of dry runs that completed.
    pub fn completed(&self) -> usize {
        self.dry_runs.iter().filter(|dry_run| is_completed(dry_run)).count()
    }

    /// Number of dry runs that completed or failed, that is, were not broken off.
    pub fn decided(&self) -> usize {
        self.dry_runs.iter().filter(|dry_run| is_completed(dry_run) || !dry_run.left_off).count()
    }

    /// Reasons of the dry runs' endings, failures first, with the number of each.
    pub fn endings(&self) -> Vec<(&str, usize)> {
        let mut endings: Vec<(&str, usize)> = Vec::new();
        let (completed, failed): (Vec<&DryRun>, Vec<&DryRun>) =
            self.dry_runs.iter().partition(|dry_run| is_completed(dry_run));
        for DryRun { ending, .. } in failed.into_iter().chain(completed) {
            match endings.iter_mut().find(|(reason, _)| *reason == ending.reason) {
                Some((_, times)) => *times += 1,
                None => endings.push((&ending.reason, 1)),
            }
        }
        endings
    }

    /// Least, median and largest value of a figure over the completed dry runs; `None` if none completed.
    pub fn range(&self, figure: impl Fn(&DryRun) -> f64) -> Option<[f64; 3]> {
        let completed = self.dry_runs.iter().filter(|dry_run| is_completed(dry_run));
        let mut figures: Vec<f64> = completed.map(figure).collect();
        figures.sort_by(f64::total_cmp);
        let middle = figures.len() / 2;
        let median = if figures.len() % 2 == 1 {
            *figures.get(middle)?
        } else {
            0.5 * (figures.get(middle.checked_sub(1)?)? + figures.get(middle)?)
        };
        Some([*figures.first()?, median, *figures.last()?])
    }

    /// Least gap between two parts in any dry run.
    pub fn nearest(&self) -> Option<ClosestApproach> {
        self.dry_runs.iter().filter_map(|dry_run| dry_run.nearest).min_by(|a, b| a.gap_m.total_cmp(&b.gap_m))
    }

    /// Limits that prevented plans, over all dry runs, the most frequent first.
    pub fn limits_met(&self) -> Vec<LimitMet> {
        let mut all: Vec<LimitMet> = Vec::new();
        for met in self.dry_runs.iter().flat_map(|dry_run| &dry_run.limits_met) {
            match all.iter_mut().find(|other| other.limit == met.limit) {
                Some(other) => other.times += met.times,
                None => all.push(met.clone()),
            }
        }
        all.sort_by_key(|met| std::cmp::Reverse(met.times));
        all
    }
}

pub(super) fn is_completed(dry_run: &DryRun) -> bool {
    dry_run.ending.outcome == Outcome::Completed
}

#[cfg(test)]
mod tests;
