use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::lengths::{mm, point_mm};
use super::timings::TimingsReport;
use upm_core::document::schema_of;
use upm_core::geometry::Vec2;
use upm_core::job::{CameraMode, Evidence, Outcome, RunnerUp, StopCause};

/// `report.json`. Lengths in mm, to 1e-4.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Report {
    /// Name of the job.
    pub name: String,
    /// Seed of all random numbers of the run.
    pub seed: u64,
    /// Version of this program.
    pub version: String,
    /// Pictures from the camera, or positions in their place.
    pub camera: CameraMode,
    /// The planner that ran and why; `None` where the run did not begin.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub planner: Option<PlannerReport>,
    /// How the run ended.
    pub outcome: Outcome,
    /// Why, in words.
    pub reason: String,
    /// Whether the truth agrees that the goal was reached; only on a simulated rig.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub verdict: Option<Verdict>,
    /// The cause of its end, where it has a code.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stop: Option<StopReport>,
    /// The experiment's own time, s.
    pub plate_time_s: f64,
    /// Duration of the run by the computer's clock, s.
    pub wall_time_s: f64,
    /// Its extent.
    #[serde(flatten)]
    pub work: WorkReport,
    /// How plate time kept to the clock; `None` for a run at full speed.
    #[serde(flatten)]
    pub pacing: Option<PacingReport>,
    /// Distances from targets, subgoals, true and forecast positions.
    #[serde(flatten)]
    pub accuracy: AccuracyReport,
    /// Parts against their paths.
    #[serde(flatten)]
    pub path: PathReport,
    /// Every part, in the order of the job.
    pub parts: Vec<PartReport>,
    /// Durations, µs of wall time.
    pub timing_us: TimingsReport,
    /// Guards, faults and warnings.
    #[serde(flatten)]
    pub incidents: IncidentReport,
    /// How near the run came to the findings that rest on chance; `None` when it never began.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub evidence: Option<Evidence>,
}

impl Report {
    /// True for a run that reached its goal, in truth, too.
    pub fn reached_goal(&self) -> bool {
        self.outcome == Outcome::Completed && self.verdict != Some(Verdict::FalseSuccess)
    }
}

/// The JSON Schema (draft 2020-12) of `report.json`.
pub fn report_schema() -> Value {
    schema_of::<Report>().clone()
}

/// Extent of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WorkReport {
    /// Frames tracked.
    pub frames: u64,
    /// Cycles ended.
    pub cycles: u64,
    /// Pulses played in the run, those of probes included.
    pub pulses: u64,
    /// Laps completed.
    pub laps: u32,
    /// Plate time at which each task of a list began, s, of the first hundred; empty for a job of one task.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tasks_from_s: Vec<f64>,
    /// Contacts between parts; `None` on a rig without ground truth.
    pub collisions: Option<u64>,
    /// Number of parts that were missing for so long that the run ended.
    pub lost_parts: usize,
}

/// Distances of parts from where they should be, or were taken to be.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AccuracyReport {
    /// Largest distance of a part from its target at the end, from truth where there is one; `None` without targets.
    pub max_error_mm: Option<f64>,
    /// Root mean square of those distances.
    pub rms_error_mm: Option<f64>,
    /// Their mean: the error E of the UPM paper (Eq. 3) for the whole run.
    pub mean_error_mm: Option<f64>,
    /// The same error of each cycle that ends at rest; `None` without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cycle_error_mm: Option<CycleError>,
    /// Root mean square distance of measured from true positions over every frame that shows the part; `None` without
    /// truth.
    pub sensing_rms_error_mm: Option<f64>,
    /// The same over frames taken at rest alone.
    pub sensing_rms_error_at_rest_mm: Option<f64>,
    /// Distances of measured from forecast positions after pulses; `None` without a pulse.
    pub prediction_error_mm: Option<PredictionError>,
}

/// Guards that fired, faults that began, and problems beside the run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct IncidentReport {
    /// Guards that fired, in the order in which they did.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub guards: Vec<GuardReport>,
    /// Faults of the simulated rig that began within the run.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub faults: Vec<FaultEntry>,
    /// Why its recording does not hold the whole run.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub recording: Option<String>,
    /// Problems beside the run itself: a recording that does not hold all of it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
}

/// How plate time kept to the clock.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PacingReport {
    /// Deadlines missed.
    pub deadline_misses: u64,
    /// Largest lateness, whole frames.
    pub worst_late_frames: u64,
    /// Total lag of plate time behind the clock, s: the plate waited for this computer.
    pub behind_s: f64,
}

/// Parts against their paths in every frame between the first and the last points of the paths, from truth where there
/// is one; `None` without paths.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PathReport {
    /// Root mean square distance from the path.
    pub cross_track_rms_mm: Option<f64>,
    /// Its maximum.
    pub cross_track_max_mm: Option<f64>,
    /// Distance gone by all parts over the length of path that they advanced.
    pub travel_ratio: Option<f64>,
    /// Largest difference of a part's phase from its reference, as a fraction of a lap; `None` for parts not in phase.
    pub phase_error_max: Option<f64>,
    /// Speed asked of the part that held the least share of it; `None` for tasks without speeds.
    pub speed_asked_mm_s: Option<f64>,
    /// Mean speed along the path that it held in plate time.
    pub speed_held_mm_s: Option<f64>,
}

/// Verdict of the ground truth on an outcome.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The truth confirms the outcome.
    True,
    /// The run counts as completed, but a part is farther from its target, or from its tracked position on a path
    /// without end, than the tolerance and 0.1 mm.
    FalseSuccess,
}

/// A guard that fired.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GuardReport {
    /// Stable code.
    pub code: String,
    /// Plate time, s.
    pub at_s: f64,
    /// The finding and what to check.
    pub text: String,
    /// The explanation that the senses can tell least from it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub runner_up: Option<RunnerUp>,
}

/// One fault of the simulated rig.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FaultEntry {
    /// Where: `camera`, `light`, `view`, `coil0` to `coil3`, `coils`, `accel0` to `accel3`, `part0` and on, `parts`,
    /// `plate`, `device`, `clock`, or the name of a part.
    #[schemars(length(min = 1, max = 64))]
    pub component: String,
    /// The fault; each component has its kinds.
    #[schemars(length(min = 1, max = 16))]
    pub kind: String,
    /// How much, where the kind asks for it.
    pub value: Option<FaultValue>,
    /// From when, s of plate time.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 1e6))]
    pub from_s: f64,
    /// Until when, s; left out: for good.
    #[schemars(range(min = 0.0, max = 1e6))]
    pub to_s: Option<f64>,
}

/// One value of a fault, or several.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum FaultValue {
    /// A number, for kinds with a single value.
    #[schemars(title = "number")]
    One(f64),
    /// A list of one to three numbers, in the order of the kind's values.
    #[schemars(title = "numbers")]
    Several(#[schemars(length(min = 1, max = 3))] Vec<f64>),
}

impl FaultValue {
    /// Its numbers.
    pub fn numbers(&self) -> &[f64] {
        match self {
            Self::One(value) => std::slice::from_ref(value),
            Self::Several(values) => values,
        }
    }
}

/// The planner of a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct PlannerReport {
    /// Its name in a job file.
    pub name: String,
    /// Origin of the choice.
    pub chosen: SelectedBy,
    /// The reason, for programs.
    pub code: String,
    /// The reason, for people.
    pub why: String,
    /// The other planners that the rig could run, by their names in a job file.
    pub alternatives: Vec<String>,
}

/// Origin of the choice of a planner.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SelectedBy {
    /// The program, for a job that leaves it open or says `auto`.
    Auto,
    /// The job, which names the planner.
    Job,
}

/// Root mean square distances between forecast and measured positions over every pulse and part, mm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PredictionError {
    /// Forecast by the library alone.
    pub library: f64,
    /// Forecast with the gains of friction and regions that the run had learned until then.
    pub learned: f64,
}

/// Error E of the UPM paper (Eq. 3) over the cycles: the mean distance of all parts, as measured after a cycle, from
/// the subgoals of that cycle, mm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CycleError {
    /// Mean over the cycles.
    pub mean: f64,
    /// Largest of the cycles.
    pub max: f64,
}

/// One part at the end of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PartReport {
    /// Name in this run: `penny-1`.
    pub id: String,
    /// Name of the part's kind: `penny`.
    pub kind: String,
    /// Target; `None` when the part had none.
    pub target_mm: Option<[f64; 2]>,
    /// Last seen position; `None` when it was never seen.
    pub measured_mm: Option<[f64; 2]>,
    /// True position; `None` on a rig without ground truth.
    pub true_mm: Option<[f64; 2]>,
    /// Distance to the target, from truth where there is one.
    pub error_mm: Option<f64>,
}

impl PartReport {
    /// The part `id` of this kind: its last target, its last seen and its true position, m.
    pub fn of(id: &str, kind: &str, target_m: Option<Vec2>, measured_m: Option<Vec2>, true_m: Option<Vec2>) -> Self {
        let error_m = true_m.or(measured_m).zip(target_m).map(|(at_m, target_m)| (at_m - target_m).norm());
        Self {
            id: id.to_owned(),
            kind: kind.to_owned(),
            target_mm: target_m.map(point_mm),
            measured_mm: measured_m.map(point_mm),
            true_mm: true_m.map(point_mm),
            error_mm: error_m.map(mm),
        }
    }
}

/// The cause that ended a run: a code for programs, a text for people.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct StopReport {
    /// Stable code.
    pub code: StopCause,
    /// The same in words, with the remedy.
    pub text: String,
    /// Advice on what to check or change; `None` without advice.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub remedy: Option<String>,
}

impl StopReport {
    /// The report of an end by `cause` for the reason `text`.
    pub fn of(cause: StopCause, text: &str) -> Self {
        Self { code: cause, text: text.to_owned(), remedy: cause.remedy().map(str::to_owned) }
    }
}
