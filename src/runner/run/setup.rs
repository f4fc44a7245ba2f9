use std::sync::Arc;

use super::knocks;
use super::planner_selection::PlannerSelection;
use crate::config::{Assignment, Diagnostic, JobSpec, PlacedPart, REST_GAP_M, REST_MARGIN_M, TaskSpec, place_parts};
use upm_control::{ControlParams, ExpectedPart, Guards, LocalisedFacts, OwnPlanner, Sink};
use upm_core::document::counted;
use upm_core::geometry::{Pose, Vec2};
use upm_core::ground_truth::GroundTruthHandle;
use upm_core::job::CameraMode;
use upm_core::random::Streams;
use upm_core::rig::{PartKind, Rig, RigModel};
use upm_core::time::PlateTime;
use upm_planning::cor_library::{Entry, Library};
use upm_planning::planner::{FlowEffort, PlannerParams, PlanningMethod, RotationPlanner};
use upm_planning::task::{
    Arrange, ArrangeParams, BinParams, Effort, Hold, HoldParams, Motions, PartOutline, PlateScene, PlusSign,
    PlusSignParams, Sequence, Sort, SortParams, Task, Trajectories, TrajectoriesParams,
};
use upm_sim::SimRig;
use upm_sim::faults::FaultSpec;

/// Longest step of a part in one cycle, m.
pub(super) const LONGEST_STEP_M: f64 = 8e-3;
/// Longest step of a part, as a share of the reach of the strong entries at the plate's centre.
const ONE_PULSE: f64 = 0.9;
/// Share of the tolerance within which a part must be measured to have arrived; the rest allows for the measurement
/// error.
pub(super) const MEASURED_SHARE: f64 = 0.9;
/// Twice the least step that is worth a pulse, m.
pub(super) const MIN_DISTANCE_M: f64 = 0.3e-3;
/// Largest lead of a part's reference, m.
pub(super) const LEAD_M: f64 = 4e-3;
/// Time at rest without a detection after which a part is lost, s.
const LOST_AFTER_S: f64 = 0.4;

/// A job's rig, its task and the parameters of control.
pub struct RunSetup {
    /// Rig that control drives, with the parts at their start.
    pub rig: SimRig,
    /// True positions of its parts.
    pub truth: GroundTruthHandle,
    /// Model of the rig that control knows.
    pub model: RigModel,
    /// Its planner and the reason for it.
    pub planner: PlannerSelection,
    /// Task of the job.
    pub task: Box<dyn Task>,
    /// Limits and parts for control.
    pub params: ControlParams,
    /// Parts at their start.
    pub placed: Vec<PlacedPart>,
    /// Simulated faults of the rig, and knocks against its plate.
    pub faults: Vec<FaultSpec>,
    /// Random streams of the run.
    pub streams: Streams,
    /// True where the caller brings the task.
    pub(super) has_own_task: bool,
    pub(super) own_planner: Option<Box<dyn OwnPlanner>>,
    /// The caller's rig, in the place of the simulated one, which stays at rest.
    pub(super) own_rig: Option<Box<dyn Rig>>,
    /// Plate time when control had ended.
    pub(super) ended_at: PlateTime,
}

/// Task, planner or rig of a caller's, in the place of a job's own.
#[derive(Default)]
pub struct OwnParts {
    /// Receives the parts in the order of the job, and ends the run by
    /// [`done`](upm_planning::task::Setpoints::done).
    pub task: Option<Box<dyn Task>>,
    /// Plans pulses from rest to rest.
    pub planner: Option<Box<dyn OwnPlanner>>,
    /// Takes the place of the simulated rig. Nothing is known of its truth.
    pub rig: Option<Box<dyn Rig>>,
}

impl RunSetup {
    /// Selects the planner, places the parts and builds rig, task and parameters.
    ///
    /// # Errors
    /// Parts that find no places.
    pub fn new(job: &JobSpec, library: &Arc<Library>) -> Result<Self, Diagnostic> {
        let planner = PlannerSelection::of(job);
        let (rig, placed) = simulated_rig(job)?;
        let (kinds, kind_of_part) = kinds_present(job, &placed);
        let given_m = job.parts.iter().flat_map(|group| std::iter::repeat_n(group.position_m, group.count));
        let parts = placed.iter().zip(kind_of_part).zip(given_m);
        let parts = parts.map(|((part, kind), expected_m)| ExpectedPart { id: part.id.clone(), kind, expected_m });
        let model = job.rig.model.clone();
        let params = ControlParams {
            parts: parts.collect(),
            time_limit_s: job.plate_time_limit_s,
            endless: job.is_endless(),
            follows_paths: job.each_task().any(|task| matches!(task, TaskSpec::Trajectories { .. })),
            tolerance_m: job.tolerance_m,
            lost_after_frames: lost_after_frames(model.frame_hz),
            method: planner.method,
            planner: planner_params(&model),
            guards: Guards {
                without: job.without_guard,
                false_alarms_per_1000_h: job.document.false_alarms_per_1000_h,
            },
            kinds,
        };
        let task = each_task(job, library, &placed, planner.method);
        let streams = Streams::new(job.seed());
        let knocks = job.rig.document.simulation.knocks.iter();
        let knocks = knocks.flat_map(|knocks| knocks::drawn(knocks, job.plate_time_limit_s, &streams));
        let faults = job.faults.iter().copied().chain(knocks).collect();
        Ok(Self {
            truth: rig.probe(),
            rig,
            model,
            planner,
            task,
            params,
            placed,
            faults,
            streams,
            has_own_task: false,
            own_planner: None,
            own_rig: None,
            ended_at: PlateTime::ZERO,
        })
    }

    /// Takes a planner of pulses from rest.
    pub(super) fn fall_back(&mut self) {
        self.planner.fall_back();
        self.params.method = self.planner.method;
    }

    /// `Err` for a job with faults on a rig of the caller's, since only the simulated rig has them.
    pub(super) fn refuse_faults(&self, job: &JobSpec) -> Result<(), Diagnostic> {
        let found = counted(self.faults.len(), "fault");
        let wrong = || Diagnostic::new(&job.file, "faults", found, "none on a rig of the caller's");
        if self.faults.is_empty() { Ok(()) } else { Err(wrong()) }
    }

    /// Replaces the task by the caller's.
    pub(super) fn take_task(&mut self, task: Box<dyn Task>) {
        (self.task, self.has_own_task, self.params.endless) = (task, true, false);
    }

    /// The same setup with what the caller brings.
    ///
    /// # Errors
    /// A job with faults on a rig of the caller's.
    pub fn with_own(mut self, job: &JobSpec, OwnParts { task, planner, rig }: OwnParts) -> Result<Self, Diagnostic> {
        rig.iter().try_for_each(|_| self.refuse_faults(job))?;
        if planner.is_some() || rig.as_ref().is_some_and(|rig| !rig.takes_over()) {
            self.fall_back();
        }
        task.into_iter().for_each(|task| self.take_task(task));
        Ok(Self { own_planner: planner, own_rig: rig, ..self })
    }

    /// For people: each thing that the caller brings.
    pub(super) fn owned(&self) -> Vec<String> {
        let own =
            [(self.has_own_task, "task"), (self.own_planner.is_some(), "planner"), (self.own_rig.is_some(), "rig")];
        let own = own.into_iter().filter(|(is_own, _)| *is_own);
        own.map(|(_, what)| format!("the {what} is the caller's own: verify cannot repeat this run")).collect()
    }

    /// Truth of the run; `None` on a rig of the caller's.
    pub(super) fn known_truth(&self) -> Option<GroundTruthHandle> {
        self.own_rig.is_none().then(|| self.truth.clone())
    }
}

/// Number of frames without a detection after which a part is lost; at low frame rates a single bad picture does not
/// end a run.
fn lost_after_frames(frame_hz: f64) -> u32 {
    (LOST_AFTER_S * frame_hz).max(2.0) as u32
}

/// The simulated rig of a job with its parts at their start.
pub(crate) fn simulated_rig(job: &JobSpec) -> Result<(SimRig, Vec<PlacedPart>), Diagnostic> {
    let streams = Streams::new(job.seed());
    let placed = place_parts(job, streams)?;
    let poses = placed.iter().map(|part| (part.params, Pose::at(part.position_m)));
    let rig = SimRig::new(job.rig.model.clone(), job.rig.sim.clone(), poses.collect(), streams);
    let rig = if job.camera == CameraMode::Positions { rig.without_pixels(&streams) } else { rig };
    Ok((rig, placed))
}

/// Kinds on the plate, and the index of each part into them.
fn kinds_present(job: &JobSpec, placed: &[PlacedPart]) -> (Vec<PartKind>, Vec<usize>) {
    let mut numbers: Vec<usize> = placed.iter().map(|part| part.kind).collect();
    numbers.sort_unstable();
    numbers.dedup();
    let of_part = placed.iter().map(|part| numbers.binary_search(&part.kind).unwrap_or_default()).collect();
    let kinds = numbers.iter().filter_map(|&number| job.rig.kinds.get(number)).map(|spec| spec.kind.clone());
    (kinds.collect(), of_part)
}

/// Limits and weights of the planner in every run on a rig.
pub fn planner_params(model: &RigModel) -> PlannerParams {
    PlannerParams {
        lever_arm_m: model.lever_arm_m,
        half_side_m: 0.5 * model.plate_side_m,
        edge_margin_m: REST_MARGIN_M,
        separation_m: REST_GAP_M,
        min_distance_m: MIN_DISTANCE_M,
        frame_s: 1.0 / model.frame_hz,
        exposure_s: model.exposure_s,
        max_sustain_s: model.max_sustain_s,
    }
}

/// Longest step that one pulse can make in most directions; a longer one would take several, each about another centre.
fn stride_m(library: &Library) -> f64 {
    let at_center = |entry: &Entry| library.displacement.max_distance(entry.speed_at(Vec2::zeros()));
    let mut reach_m: Vec<f64> = library.entries.iter().map(at_center).collect();
    reach_m.sort_by(f64::total_cmp);
    let strong_m = reach_m.get(reach_m.len() * 9 / 10).copied().unwrap_or_default();
    LONGEST_STEP_M.min(ONE_PULSE * strong_m)
}

/// The job's task, or its tasks one after another.
fn each_task(job: &JobSpec, library: &Arc<Library>, placed: &[PlacedPart], method: PlanningMethod) -> Box<dyn Task> {
    if job.earlier.is_empty() && job.document.repeat == 1 {
        return task(job, &job.task, library, placed, method);
    }
    let in_round = job.earlier.len() + 1;
    let of = Some(in_round * job.document.repeat as usize).filter(|of| *of > 0);
    let (job, library, placed) = (job.clone(), library.clone(), placed.to_vec());
    let at = move |index: usize| -> Box<dyn Task> {
        let spec = job.earlier.get(index % in_round).unwrap_or(&job.task);
        task(&job, spec, &library, &placed, method)
    };
    Box::new(Sequence::new(of, Box::new(at)))
}

/// The task `spec` for the parts of `job`.
pub(crate) fn task(
    job: &JobSpec,
    spec: &TaskSpec,
    library: &Library,
    placed: &[PlacedPart],
    method: PlanningMethod,
) -> Box<dyn Task + Send> {
    let half_side_m = 0.5 * job.rig.model.plate_side_m;
    let arrive_m = MEASURED_SHARE * job.tolerance_m;
    let scene = |motions: Motions| PlateScene { half_side_m, motions, discs: discs(placed) };
    match spec {
        TaskSpec::PlusSign { laps, edge_margin_m, corridor_m } => Box::new(PlusSign::new(PlusSignParams {
            half_side_m,
            part_radius_m: placed.first().map_or(0.0, |part| part.params.radius_m),
            edge_margin_m: *edge_margin_m,
            laps: *laps,
            arrive_m: job.tolerance_m,
            stride_m: stride_m(library),
            corridor_m: *corridor_m,
        })),
        TaskSpec::Trajectories { paths, in_phase, corridor_m } => Box::new(Trajectories::new(TrajectoriesParams {
            scene: scene(motions(job, library, method)),
            paths: paths.clone(),
            in_phase: *in_phase,
            lead_m: LEAD_M,
            stride_m: LONGEST_STEP_M,
            arrive_m,
            corridor_m: *corridor_m,
        })),
        TaskSpec::Arrange { targets_m, assignment } => Box::new(Arrange::new(ArrangeParams {
            scene: scene(motions(job, library, method)),
            targets_m: targets_m.clone(),
            exchange: *assignment == Assignment::Optimal,
            arrive_m,
        })),
        TaskSpec::Hold { duration_s } => {
            // without an end, the limit is the duration: elapsed time is its only progress
            let limit_s = job.plate_time_limit_s;
            let duration_s = if spec.is_endless(limit_s) { limit_s } else { *duration_s };
            Box::new(Hold::new(HoldParams { scene: scene(Motions::Independent), duration_s, arrive_m }))
        }
        TaskSpec::Sort { bins } => Box::new(Sort::new(sort_params(job, bins, scene(motions(job, library, method))))),
    }
}

/// Kind of motion that the job's planner uses.
fn motions(job: &JobSpec, library: &Library, method: PlanningMethod) -> Motions {
    let parts = job.parts.iter().map(|group| group.count).sum();
    match method {
        PlanningMethod::CorSequence => Motions::Rotations {
            stride_m: RotationPlanner::longest_path_m(parts, 0.5 * library.plate_side_m),
            effort: Arc::new(RotationEffort(FlowEffort::new(library))),
        },
        PlanningMethod::PseudoInverse | PlanningMethod::SynthesizedField | PlanningMethod::MovingField => {
            Motions::Independent
        }
    }
}

/// The planner's cost of steps, as tasks request it.
#[derive(Debug)]
struct RotationEffort(FlowEffort);

impl Effort for RotationEffort {
    fn squared(&self, places_m: &[Vec2], steps_m: &[Vec2], slopes: Option<(&mut [Vec2], &mut [Vec2])>) -> f64 {
        self.0.squared(places_m, steps_m, slopes)
    }
}

fn discs(placed: &[PlacedPart]) -> Vec<PartOutline> {
    placed.iter().map(|part| PartOutline { kind: part.kind, radius_m: part.params.radius_m }).collect()
}

fn sort_params(job: &JobSpec, bins: &[BinParams], scene: PlateScene) -> SortParams {
    SortParams {
        scene,
        bins: bins.to_vec(),
        // slots may be as near to the border as half the gap between rims
        margin_m: ((1.0 - MEASURED_SHARE) * job.tolerance_m).min(0.25 * REST_GAP_M),
    }
}

/// Sink that orders the truth as control named the parts; must be the first sink.
pub struct TruthInJobOrder(pub GroundTruthHandle);

impl Sink for TruthInJobOrder {
    fn localised(&mut self, facts: &LocalisedFacts<'_>) {
        let seen_m: Vec<_> = facts.detections.iter().map(|detection| detection.position_m).collect();
        self.0.order_by(&seen_m);
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use proptest::prelude::*;
    use serde_json::json;

    use super::*;
    use crate::config::Origin;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        #[test]
        fn sort_finds_slots_in_every_bin_that_a_job_may_have(
            kind in prop::sample::select(&["dime", "penny", "quarter"][..]), count in 1usize..13, width in 30.0..160.0f64,
        ) {
            let origin = Origin::of_file(&Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("configs/job.json"));
            let job = |height: f64| {
                let region = json!({"min": [-80.0, -140.0], "max": [width - 80.0, height - 140.0]});
                let task = json!({"type": "sort", "bins": [{"kinds": [kind], "region_mm": region}]});
                let parts = json!([{"kind": kind, "count": count}]);
                let text = json!({"name": "bin", "rig": "rigs/upm-2.json", "parts": parts, "task": task}).to_string();
                JobSpec::from_json(&text, &origin, None).ok()
            };
            let (mut low, mut high) = (0.0, 280.0);
            prop_assume!(job(high).is_some());
            for _ in 0..20 {
                let middle = 0.5 * (low + high);
                *(if job(middle).is_some() { &mut high } else { &mut low }) = middle;
            }
            let smallest = job(high).unwrap();
            let placed = place_parts(&smallest, Streams::new(1)).unwrap();
            let TaskSpec::Sort { bins } = &smallest.task else { panic!("{:?}", smallest.task) };
            let scene = PlateScene { discs: discs(&placed), ..PlateScene::default() };
            let gaps_m = sort_params(&smallest, bins, scene).gaps_m();
            // slots are spread by bisection, to less than a micrometre
            prop_assert!(gaps_m[0] > REST_GAP_M - 1e-6, "{gaps_m:?} in {width} x {high}");
        }
    }

    #[test]
    fn one_bad_picture_loses_no_part() {
        assert_eq!([0.5, 3.9, 4.0, 60.0].map(lost_after_frames), [2, 2, 2, 24]);
    }
}
