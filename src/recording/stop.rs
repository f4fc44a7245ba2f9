//! The cause that ended a run, as reports have it.

use serde::{Deserialize, Serialize};

use upm_core::job::StopCause;

/// The cause that ended a run: a code for programs, a text for people.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct StopReport {
    /// Stable code.
    pub code: StopCause,
    /// The same in words, with the remedy.
    pub text: String,
    /// What the operator should check or change; `None` where there is nothing, and in reports from before it was told.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub remedy: Option<String>,
}

impl StopReport {
    /// The report of an end by `cause`, for the reason `text`.
    pub fn of(cause: StopCause, text: &str) -> Self {
        Self { code: cause, text: text.to_owned(), remedy: cause.remedy().map(str::to_owned) }
    }
}
