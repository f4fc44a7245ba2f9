use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::states::JobState;
use crate::store::Job;
use crate::supervisor::{LayoutView, Plate};

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

/// Every plate of the daemon at one moment.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Plates {
    /// The plates, in the order of the configuration.
    pub plates: Vec<Plate>,
    /// Address and port of the listener whose `POST /v1/estop` stops every plate; null where there is none.
    #[serde(default)]
    pub stop_listen: Option<String>,
}

/// A job that is ready to be queued.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Checked {
    /// Name of the job.
    pub name: String,
    /// Plate to which it would go.
    pub plate: String,
    /// Parts, targets, bins and paths that the job asks for.
    pub layout: LayoutView,
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
