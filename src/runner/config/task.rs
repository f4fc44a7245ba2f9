use std::f64::consts::TAU;

use super::job_file::{Assignment, PlannerChoice, TaskSection};
use super::kinds::{PartGroup, each_kind, part_ids};
use super::rig::RigSpec;
use upm_core::document::{Diagnostics, Path, counted};
use upm_core::geometry::Vec2;
use upm_core::units::{GRAVITY_MPS2, mm_from_m, written_mm};
use upm_planning::task::{BinParams, PathParams};
use upm_sim::CameraParams;

/// A task in SI.
#[derive(Clone, Debug, PartialEq)]
pub enum TaskSpec {
    /// One part goes to the centre, then along the branches of a plus sign, clockwise, out and back.
    PlusSign {
        /// Rounds over all four branches; 0 for no end.
        laps: u32,
        /// Distance of the part's rim from the plate's edge at the tips, m.
        edge_margin_m: f64,
        /// Largest distance from the path, m.
        corridor_m: f64,
    },
    /// Every part follows its own path.
    Trajectories {
        /// One path for each part, without corners for a part that stays where it is.
        paths: Vec<PathParams>,
        /// All parts are at the same share of their laps at any time.
        in_phase: bool,
        /// Largest distance from the paths, m.
        corridor_m: f64,
    },
    /// Every part goes to a target place.
    Arrange {
        /// Place of each part, m; `None` for a part that stays where it is.
        targets_m: Vec<Option<Vec2>>,
        /// Assignment of parts to places.
        assignment: Assignment,
    },
    /// Every part goes into its kind's bin.
    Sort {
        /// The bins; every part's kind is in exactly one.
        bins: Vec<BinParams>,
    },
    /// Every part stays at its place.
    Hold {
        /// Duration, s; 0 for no end.
        duration_s: f64,
    },
}

impl TaskSpec {
    /// Its type in the file.
    pub fn name(&self) -> &'static str {
        match self {
            Self::PlusSign { .. } => "plus_sign",
            Self::Trajectories { .. } => "trajectories",
            Self::Arrange { .. } => "arrange",
            Self::Sort { .. } => "sort",
            Self::Hold { .. } => "hold",
        }
    }

    /// True if the task has no end before `limit_s`, its plate time limit, which then completes it.
    pub fn is_endless(&self, limit_s: f64) -> bool {
        match self {
            Self::PlusSign { laps, .. } => *laps == 0,
            Self::Trajectories { paths, .. } => paths.iter().any(|path| path.repeat == 0),
            Self::Hold { duration_s } => *duration_s == 0.0 || *duration_s >= limit_s,
            Self::Arrange { .. } | Self::Sort { .. } => false,
        }
    }
}

/// The task in SI. Faults where it is not feasible.
pub(super) fn build(
    task: &TaskSection,
    at: Path,
    groups: &[PartGroup],
    rig: &RigSpec,
    planner: PlannerChoice,
    faults: &mut Diagnostics,
) -> Option<TaskSpec> {
    let scene = TaskContext::new(at, groups, rig);
    if let TaskSection::PlusSign { corridor_m, .. } | TaskSection::Trajectories { corridor_m, .. } = task
        && faults.are_sound(&["planner"])
    {
        let narrowest_mm = (100.0 * mm_from_m(narrowest_m(rig, scene.kinds.len(), planner))).ceil() / 100.0;
        let allowed = format!("{narrowest_mm:.2} or more: sway, sensing and scatter of a part on {}", rig.model.name);
        let found_mm = written_mm(*corridor_m);
        faults.require(found_mm > narrowest_mm - 1e-9, scene.at.key("corridor_mm"), found_mm, allowed);
    }
    match task {
        &TaskSection::PlusSign { laps, edge_margin_m, corridor_m } => {
            let found = counted(scene.kinds.len(), "part");
            faults.require(scene.kinds.len() == 1, Path::root().key("parts"), found, "exactly one part for plus_sign");
            let most_m = scene.half_m - scene.radii_m.iter().copied().fold(0.0, f64::max);
            let allowed = format!("below {:.3} (else no branch is left)", mm_from_m(most_m));
            let found_mm = written_mm(edge_margin_m);
            faults.require(edge_margin_m < most_m, scene.at.key("edge_margin_mm"), found_mm, allowed);
            Some(TaskSpec::PlusSign { laps, edge_margin_m, corridor_m })
        }
        TaskSection::Trajectories { paths, in_phase, corridor_m } => {
            let parts = scene.named_on(paths, faults)?;
            let of_named = scene.with_parts(&parts).trajectories(paths, *in_phase, faults)?;
            let stays = || PathParams { repeat: 1, ..PathParams::default() };
            let paths = scene.of_each(&parts, of_named).into_iter().map(|path| path.unwrap_or_else(stays));
            let paths = paths.collect();
            Some(TaskSpec::Trajectories { paths, in_phase: *in_phase, corridor_m: *corridor_m })
        }
        TaskSection::Arrange { parts: names, targets_m, targets, assignment } => {
            let parts = scene.named(names.as_deref(), faults)?;
            let of_named = scene.with_parts(&parts).targets(targets_m.as_deref(), targets.as_deref(), faults)?;
            let usual = if names.is_some() { Assignment::Fixed } else { Assignment::Optimal };
            let targets_m = scene.of_each(&parts, of_named);
            Some(TaskSpec::Arrange { targets_m, assignment: assignment.unwrap_or(usual) })
        }
        TaskSection::Sort { bins } => scene.sort(bins, faults),
        TaskSection::Hold { duration_s } => Some(TaskSpec::Hold { duration_s: *duration_s }),
    }
}

/// Rig and parts that a task is checked against.
pub(super) struct TaskContext<'a> {
    /// Path of the task in the file.
    pub at: Path,
    /// Rig whose kinds the task may name.
    pub rig: &'a RigSpec,
    /// Half the plate's side, m.
    pub half_m: f64,
    /// Kind of each part.
    pub kinds: Vec<usize>,
    /// Radius of each part, m.
    pub radii_m: Vec<f64>,
    /// Id of each part.
    pub ids: Vec<String>,
}

impl<'a> TaskContext<'a> {
    fn new(at: Path, groups: &[PartGroup], rig: &'a RigSpec) -> Self {
        let kinds = each_kind(groups);
        let radii_m = kinds.iter().map(|&kind| rig.kinds.get(kind).map_or(0.0, |spec| spec.kind.radius_m)).collect();
        let ids = part_ids(groups, &rig.kinds);
        Self { at, rig, half_m: 0.5 * rig.model.plate_side_m, kinds, radii_m, ids }
    }

    pub(super) fn demand_one_each(&self, found: usize, what: &str, at: &Path, faults: &mut Diagnostics) {
        let parts = self.kinds.len();
        faults.require(found == parts, at, counted(found, what), format!("{parts}, one for each part"));
    }
}

/// Error of a part's measured place at rest, px: 2.9 to 3.1 µm rms at 0.35 mm/px in runs on `upm-2`, its camera's noise
/// and lens included.
const SENSING_PX: f64 = 0.01;
/// Scatter of a part along one axis after a synthesised field, m; the library has no such figure. In runs on `upm-2`
/// parts end 0.05 mm off at random in both axes together.
pub(crate) const FIELD_SCATTER_M: f64 = 0.035e-3;
/// Number of standard deviations of sensing and scatter that are allowed for.
const DEVIATIONS: f64 = 3.0;

/// Three standard deviations of a part's measured place under `camera` and its scatter along one axis, m.
pub(crate) fn accuracy_m(camera: &CameraParams, scatter_m: f64) -> f64 {
    DEVIATIONS * libm::hypot(SENSING_PX * camera.position_m.z / camera.focal_px, scatter_m)
}

/// Narrowest half width of a corridor for `parts` parts, m: a part's own sway, plus three standard deviations of
/// sensing and scatter. A shaken part is pulled one way by friction for half a period at most and sways by `μ g
/// T²/32`.
fn narrowest_m(rig: &RigSpec, parts: usize, planner: PlannerChoice) -> f64 {
    let fields = rig.model.fields.filter(|_| match planner {
        PlannerChoice::SynthesizedField | PlannerChoice::MovingField => true,
        PlannerChoice::Auto => parts > 1,
        PlannerChoice::CorSequence | PlannerChoice::PseudoInverse => false,
    });
    let period_s = TAU / fields.map_or(rig.model.base_radps, |fields| fields.base_radps);
    let sway_m = rig.document.friction.coefficient * GRAVITY_MPS2 * period_s * period_s / 32.0;
    sway_m + accuracy_m(&rig.sim.camera, FIELD_SCATTER_M)
}
