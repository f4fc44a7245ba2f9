use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What keeps the daemon from working or from taking jobs. Codes stay; the sentence beside one may change.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ReasonCode {
    /// The job store has not written, or not answered a question, for too long.
    StoreHangs,
    /// A thread that runs, watches or latches the plates has died or hangs.
    PlatesDead,
    /// The data folder, or a file in it that the daemon holds open, was deleted or replaced.
    DataDisplaced,
    /// The daemon ends.
    Ending,
    /// The job store was found damaged, and no operator has resumed the plates since.
    StoreDamaged,
    /// The last write of the job store failed.
    StoreUnwritable,
    /// The disk has too little room for a job.
    DiskLow,
    /// An emergency stop holds on every plate.
    AllStopped,
}

impl ReasonCode {
    /// True for what a restart of the daemon may end. One without its data would forget what it still knows.
    pub fn may_end_by_restart(self) -> bool {
        self != Self::DataDisplaced
    }
}

/// One thing that keeps the daemon from working or from taking jobs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Reason {
    /// What it is, for programs.
    pub code: ReasonCode,
    /// The same as a sentence for a person.
    pub detail: String,
}

impl Reason {
    /// A reason with its sentence.
    pub fn new(code: ReasonCode, detail: impl Into<String>) -> Self {
        Self { code, detail: detail.into() }
    }
}

/// The sentences of all reasons on one line.
pub fn joined(reasons: &[Reason]) -> String {
    reasons.iter().map(|reason| reason.detail.as_str()).collect::<Vec<_>>().join("; ")
}
