use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::layout::LayoutPartView;
use crate::states::{JobState, PauseCause, PlateCondition, PlateState, RecordingStatus, StandingJob};
use upm_core::job::Pace;

/// A job with its state and result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Job {
    /// Id of the job: 32 hex digits, which sort by the time of submission.
    #[schemars(extend("pattern" = "^[0-9a-f]{32}$"))]
    pub id: String,
    /// Name of the job; several jobs may have the same.
    pub name: String,
    /// Stage between submission and end, at the time of the answer.
    pub state: JobState,
    /// Plate on which it runs.
    pub plate: String,
    /// Time at which it was accepted (UTC).
    #[schemars(extend("format" = "date-time"))]
    pub submitted_at: String,
    /// Time at which its plate took it (UTC).
    #[schemars(extend("format" = "date-time"))]
    pub started_at: Option<String>,
    /// Time of its end, whatever the outcome (UTC).
    #[schemars(extend("format" = "date-time"))]
    pub finished_at: Option<String>,
    /// Share of the job that is done, 0 to 1.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub progress: f64,
    /// Its `report.json`, once it has ended.
    pub report: Option<Map<String, Value>>,
    /// Reason of its end; empty until then.
    pub reason: String,
    /// Seed of everything random in its run.
    pub seed: u64,
    /// Pace of its run.
    pub pace: Pace,
    /// State of its recording.
    pub recording: RecordingStatus,
    /// True for a run of its plate's standing job, which no client submitted.
    #[serde(default)]
    pub standing: bool,
    /// Turn in its plate's queue: the lowest runs first, equal ones in the order of their ids. Zero unless the job was
    /// moved to the front.
    #[serde(default)]
    pub turn: i64,
}

/// Selection of jobs to list, newest first.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[schemars(inline)]
#[serde(deny_unknown_fields)]
pub struct JobsQuery {
    /// Only jobs in this state.
    pub state: Option<JobState>,
    /// Most jobs on the page.
    #[serde(default = "usual_limit")]
    #[schemars(range(min = 1, max = 200))]
    pub limit: usize,
    /// `next` of the page before, a job that need not exist any more: only older ones.
    #[schemars(length(equal = 32))]
    pub cursor: Option<String>,
}

fn usual_limit() -> usize {
    50
}

/// A page of jobs, newest first.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct JobsPage {
    /// At most `limit` jobs of those that match the query.
    pub jobs: Vec<Job>,
    /// Cursor of the next page; null on the last.
    pub next: Option<String>,
}

/// A plate at one moment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Plate {
    /// Name of the plate.
    pub name: String,
    /// Whether it is idle, runs a job, or is held by a pause or an emergency stop.
    pub state: PlateState,
    /// Why it is idle; empty when it runs a job or could.
    pub why: String,
    /// The cause of its pause; null unless it is paused.
    #[serde(default)]
    pub pause: Option<PauseCause>,
    /// Current conditions of the run on it that an operator should know of.
    #[serde(default)]
    pub conditions: Vec<PlateCondition>,
    /// Id of the job on it; null when there is none.
    pub job: Option<String>,
    /// The job that runs whenever its queue is empty; null when none is configured.
    pub standing_job: Option<StandingJob>,
    /// Number of jobs queued for it.
    pub queued: u64,
    /// Plate time of the observation shown, from the start of its job, s.
    pub at_s: f64,
    /// Wall time since that observation, s; null before the first.
    pub age_s: Option<f64>,
    /// Side of the square plate, mm. Its centre is the origin of all positions.
    pub side_mm: f64,
    /// The kinds of parts that its rig knows.
    #[serde(default)]
    pub kinds: Vec<LayoutPartView>,
    /// Position of each part, mm.
    pub positions_mm: Vec<[f64; 2]>,
    /// Radius of each part, mm.
    pub radii_mm: Vec<f64>,
    /// Target position of each part, mm.
    pub targets_mm: Vec<[f64; 2]>,
    /// Share of the job that is done, 0 to 1.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub progress: f64,
    /// Current activity, as text.
    pub phase: String,
    /// Frames that came more than one frame late, since the daemon started.
    pub deadline_misses: u64,
    /// Lag of plate time behind the clock in the present or last run, s: this computer was too slow.
    pub behind_s: f64,
    /// Size of the recording being written, MB; null while none is.
    #[serde(default)]
    pub recording_mb: Option<f64>,
    /// Address for a Rerun viewer on this machine; null where there is no live stream.
    pub live: Option<String>,
}

/// Every plate of the daemon at one moment.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Plates {
    /// The plates, in the order of the configuration.
    pub plates: Vec<Plate>,
    /// Address and port of the listener whose `POST /v1/estop` stops every plate; null where there is none.
    #[serde(default)]
    pub stop_listen: Option<String>,
}

/// Result of an emergency stop.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct EStopped {
    /// Name of the plate.
    pub plate: String,
    /// True once the motors were seen at zero; a plate at rest has nothing to stop.
    pub silent: bool,
    /// True when the stop is on the disk and holds over a restart.
    pub persisted: bool,
    /// Plate time of the request, s.
    pub requested_at_s: Option<f64>,
    /// Plate time from which the force was zero, s.
    pub silent_at_s: Option<f64>,
    /// Wall time between the two, s.
    pub wall_s: Option<f64>,
}

/// A request to end an emergency stop.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ResetRequest {
    /// Name of the operator who inspected the plate.
    #[schemars(length(min = 1, max = 200), extend("pattern" = "\\S"))]
    pub operator: String,
    /// Reason why it may move again.
    #[schemars(length(min = 1, max = 1000), extend("pattern" = "\\S"))]
    pub reason: String,
}

impl ResetRequest {
    /// The first member that is empty or too long: its name, the text found, and what is allowed.
    pub fn fault(&self) -> Option<(&'static str, String, String)> {
        let members = [("operator", &self.operator, 200), ("reason", &self.reason, 1000)];
        let is_said = |text: &str, most: usize| !text.trim().is_empty() && text.chars().count() <= most;
        let (member, text, most) = members.into_iter().find(|(_, text, most)| !is_said(text, *most))?;
        let found = format!("{} characters", text.trim().chars().count());
        Some((member, found, format!("1 to {most} characters, not blanks alone")))
    }
}

/// Confirmation that all is well; otherwise the answer is a problem with the reasons.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Health {
    /// Always true.
    pub ok: bool,
}
