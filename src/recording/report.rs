use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::timings::TimingsReport;
use upm_core::job::{Outcome, RecordingEnd, StopCause};
use upm_document::schema_of;

/// `report.json`. Lengths in mm, to 1e-4.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Report {
    /// Name of the job.
    pub name: String,
    /// Its seed.
    pub seed: u64,
    /// Version of this program.
    pub version: String,
    /// The planner that ran and why; `None` in reports from before it was told.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub planner: Option<PlannerReport>,
    /// How the run ended.
    pub outcome: Outcome,
    /// Why, in words.
    pub reason: String,
    /// Whether the truth agrees that the goal was reached; only on a simulated rig.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verdict: Option<Verdict>,
    /// The cause that ended it, where programs tell it apart.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stop: Option<StopReport>,
    /// The experiment's own time, s.
    pub plate_time_s: f64,
    /// Least plate time by rotations, s: the relaxed program over the library at the flows of the start, no strict bound.
    /// `None` for tasks without final targets, for more than 16 parts and for runs without a pulse.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bound_s: Option<f64>,
    /// Time on the wall, s.
    pub wall_time_s: f64,
    /// Frames tracked.
    pub frames: u64,
    /// Cycles ended.
    pub cycles: u64,
    /// Pulses played.
    pub pulses: u64,
    /// Laps completed.
    pub laps: u32,
    /// Touches between parts; `None` on a rig that does not tell.
    pub collisions: Option<u64>,
    /// Parts lost.
    pub lost_parts: usize,
    /// Deadlines missed; only where plate time kept to the clock.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub deadline_misses: Option<u64>,
    /// Whole frames by which the worst of them was missed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub worst_late_frames: Option<u64>,
    /// How far plate time fell behind the clock in all, s: a plate that waited for this computer. Only where plate time
    /// kept to the clock; `None` in reports from before it was measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub behind_s: Option<f64>,
    /// Largest distance of a part from its target at the end, from truth where there is one; `None` without targets.
    pub max_error_mm: Option<f64>,
    /// Root mean square of those distances.
    pub rms_error_mm: Option<f64>,
    /// Their mean: the error E of the UPM paper (Eq. 3) for the whole run.
    #[serde(default)]
    pub mean_error_mm: Option<f64>,
    /// The same error of each cycle; `None` without a cycle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cycle_error_mm: Option<CycleError>,
    /// Measured against true positions over every frame that shows the part, root mean square; `None` without truth.
    pub sensing_rms_error_mm: Option<f64>,
    /// The same over frames taken at rest alone.
    pub sensing_rms_error_at_rest_mm: Option<f64>,
    /// Measured distance from the path over all cycles in which a part had one, root mean square; `None` without paths.
    pub cross_track_rms_mm: Option<f64>,
    /// Its maximum.
    pub cross_track_max_mm: Option<f64>,
    /// Largest difference of a part's phase from the common one, as a part of a period; `None` without phases to keep.
    pub phase_error_max: Option<f64>,
    /// Where pulses were forecast to carry parts against where they did; `None` without a pulse.
    pub prediction_error_mm: Option<PredictionError>,
    /// Every part, in the order of the job.
    pub parts: Vec<PartReport>,
    /// How long things took, µs of wall time.
    pub timing_us: TimingsReport,
    /// Guards that fired, in the order in which they did.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub guards: Vec<GuardReport>,
    /// Faults of the simulated rig that began within the run.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub faults: Vec<FaultReport>,
    /// How its recording ended, where that does not hold the whole run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recording: Option<RecordingReport>,
    /// What went wrong beside the run itself: a recording that does not hold all of it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
}

/// The JSON Schema (draft 2020-12) of `report.json`.
pub fn report_schema() -> Value {
    schema_of::<Report>()
}

/// The end of a recording that does not hold the whole run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct RecordingReport {
    /// Stable code.
    pub code: RecordingEnd,
    /// The same in words.
    pub text: String,
}

impl RecordingReport {
    /// Something could not be recorded.
    pub fn failed(reason: &str) -> Self {
        Self { code: RecordingEnd::RecordingFailed, text: format!("the recording ends early: {reason}") }
    }

    /// Somebody stopped it.
    pub fn stopped(reason: &str) -> Self {
        Self { code: RecordingEnd::RecordingStopped, text: format!("the recording ends early: stopped, {reason}") }
    }
}

/// What the truth says of an outcome.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The outcome is true.
    True,
    /// The run counts as completed, and a part is farther from its target, or from where it is believed to be on a path
    /// without a last place, than the tolerance and 0.1 mm.
    FalseSuccess,
}

/// A guard that fired.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GuardReport {
    /// Stable code.
    pub code: String,
    /// When, s of plate time.
    pub at_s: f64,
    /// What it found and what to check.
    pub text: String,
}

/// A fault of the simulated rig.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FaultReport {
    /// Where.
    pub component: String,
    /// What.
    pub kind: String,
    /// How much.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub value: Vec<f64>,
    /// From when, s of plate time.
    pub from_s: f64,
    /// Until when, s; `None` for good.
    pub to_s: Option<f64>,
}

/// The planner of a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct PlannerReport {
    /// Its name in a job file.
    pub name: String,
    /// Who named it.
    pub chosen: SelectedBy,
    /// Why it was this one, for programs.
    pub code: String,
    /// The same for people.
    pub why: String,
    /// The others that the rig could run, by their names in a job file.
    pub alternatives: Vec<String>,
}

/// Who named the planner of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SelectedBy {
    /// The program, for a job that leaves it open or says `auto`.
    Auto,
    /// The job.
    Job,
}

/// Distances of forecast places from measured ones over every pulse and part, root mean square, mm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PredictionError {
    /// Forecast by the library alone.
    pub library: f64,
    /// Forecast with what the run had learned of friction and regions until then.
    pub learned: f64,
}

/// Error E of the UPM paper (Eq. 3) over the cycles: the mean distance of all parts, as measured after a cycle, from the
/// subgoals of that cycle, mm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CycleError {
    /// Mean of the cycles.
    pub mean: f64,
    /// The largest.
    pub max: f64,
}

/// One part at the end of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PartReport {
    /// Name in this run: `penny-1`.
    pub id: String,
    /// Its kind.
    pub kind: String,
    /// Where it should be; `None` when nothing was wanted of it.
    pub target_mm: Option<[f64; 2]>,
    /// Where it was last seen; `None` when it never was.
    pub measured_mm: Option<[f64; 2]>,
    /// Where it truly is; `None` on a rig that does not tell.
    pub true_mm: Option<[f64; 2]>,
    /// Distance to the target, from truth where there is one.
    pub error_mm: Option<f64>,
}

/// The cause that ended a run: a code for programs, a text for people.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct StopReport {
    /// Stable code.
    pub code: StopCause,
    /// The same in words, with the remedy.
    pub text: String,
    /// Advice on what to check or change; `None` where there is nothing, and in reports without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remedy: Option<String>,
}

impl StopReport {
    /// The report of an end by `cause`, for the reason `text`.
    pub fn of(cause: StopCause, text: &str) -> Self {
        Self { code: cause, text: text.to_owned(), remedy: cause.remedy().map(str::to_owned) }
    }
}
