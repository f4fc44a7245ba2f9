use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::layout::LayoutPart;
use crate::states::{JobState, PlateState, RecordingStatus, StandingState};
use upm_core::job::Pace;

/// A job and what became of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Job {
    /// Its id: 32 hex digits that sort by the time it was submitted.
    #[schemars(extend("pattern" = "^[0-9a-f]{32}$"))]
    pub id: String,
    /// Its name; several jobs may have the same.
    pub name: String,
    /// How far it has come.
    pub state: JobState,
    /// The plate it goes to.
    pub plate: String,
    /// When it was accepted (UTC).
    #[schemars(extend("format" = "date-time"))]
    pub submitted_at: String,
    /// When its plate took it (UTC).
    #[schemars(extend("format" = "date-time"))]
    pub started_at: Option<String>,
    /// When it ended, however it did (UTC).
    #[schemars(extend("format" = "date-time"))]
    pub finished_at: Option<String>,
    /// Share of it that is done.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub progress: f64,
    /// Its `report.json`, once it has ended.
    pub report: Option<Map<String, Value>>,
    /// Why it ended as it did; empty until then.
    pub reason: String,
    /// Its seed.
    pub seed: u64,
    /// How fast it runs.
    pub pace: Pace,
    /// What there is of its recording.
    pub recording: RecordingStatus,
    /// True for a run of its plate's standing job, which no client submitted.
    #[serde(default)]
    pub standing: bool,
}

/// Jobs, newest first.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct JobsPage {
    /// The jobs.
    pub jobs: Vec<Job>,
    /// Cursor of the next page; null on the last.
    pub next: Option<String>,
}

/// The standing job of a plate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StandingJob {
    /// Name of the job.
    pub name: String,
    /// Its state.
    pub state: StandingState,
    /// Why it does not run; empty when it does, or only waits for its turn.
    pub why: String,
}

/// Why a plate is paused.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct PauseCause {
    /// A name for programs: that of `stop` in the job's report where the end of a job paused the plate, else `reset`,
    /// `restarted`, `crashed`, `store_damaged`, `data_displaced` or `stopped`.
    pub code: String,
    /// What to check or do before the plate goes on.
    pub remedy: String,
}

/// A state of the run on a plate that lasts, and that an operator should know of.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct PlateCondition {
    /// A name for programs: the code of a condition of the run, or `computer_busy` while plate time falls behind the clock.
    pub code: String,
    /// The condition in words.
    pub reason: String,
    /// What to check or change.
    pub remedy: String,
}

/// A plate at one moment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Plate {
    /// Its name.
    pub name: String,
    /// What it is doing.
    pub state: PlateState,
    /// Why it does nothing; empty when it does something or could.
    pub why: String,
    /// The cause of its pause; null unless it is paused.
    #[serde(default)]
    pub pause: Option<PauseCause>,
    /// What holds in the run on it that an operator should know of.
    #[serde(default)]
    pub conditions: Vec<PlateCondition>,
    /// Id of the job it has.
    pub job: Option<String>,
    /// The job that runs whenever its queue is empty; null when it has none.
    pub standing_job: Option<StandingJob>,
    /// Jobs that wait for it.
    pub queued: u64,
    /// Plate time of what is shown, from the start of its job, s.
    pub at_s: f64,
    /// Wall time since that was seen, s; null before anything was.
    pub age_s: Option<f64>,
    /// Side of the square plate, mm. Its centre is the origin of all places.
    pub side_mm: f64,
    /// The kinds of parts that its rig knows.
    #[serde(default)]
    pub kinds: Vec<LayoutPart>,
    /// Where each part is, mm.
    pub positions_mm: Vec<[f64; 2]>,
    /// Radius of each part, mm.
    pub radii_mm: Vec<f64>,
    /// Where each part shall end, mm.
    pub targets_mm: Vec<[f64; 2]>,
    /// Share of the job that is done.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub progress: f64,
    /// What is being done, in words.
    pub phase: String,
    /// Frames that came later than one frame, since the daemon started.
    pub deadline_misses: u64,
    /// How far plate time fell behind the clock in the present or last run, s: this computer was too slow.
    pub behind_s: f64,
    /// Size of the recording that is being written, MB; null while none is.
    #[serde(default)]
    pub recording_mb: Option<f64>,
    /// Where a Rerun viewer on this machine connects to; null where there is no live stream.
    pub live: Option<String>,
}

/// All plates.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Plates {
    /// In the order of the configuration.
    pub plates: Vec<Plate>,
}

/// An emergency stop, done.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct EStopped {
    /// The plate.
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

/// Who ends an emergency stop, and why.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ResetRequest {
    /// Who looked at the plate.
    #[schemars(length(min = 1, max = 200), extend("pattern" = "\\S"))]
    pub operator: String,
    /// Why it may move again.
    #[schemars(length(min = 1, max = 1000), extend("pattern" = "\\S"))]
    pub reason: String,
}

impl ResetRequest {
    /// The first member that says nothing or too much: its name, what was found, what is allowed.
    pub fn fault(&self) -> Option<(&'static str, String, String)> {
        let members = [("operator", &self.operator, 200), ("reason", &self.reason, 1000)];
        let is_said = |text: &str, most: usize| !text.trim().is_empty() && text.chars().count() <= most;
        let (member, text, most) = members.into_iter().find(|(_, text, most)| !is_said(text, *most))?;
        let found = format!("{} characters", text.trim().chars().count());
        Some((member, found, format!("1 to {most} characters, not blanks alone")))
    }
}

/// All is well; when it is not the answer is a problem that says why.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Well {
    /// Always true.
    pub ok: bool,
}
