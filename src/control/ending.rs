use crate::rig::RigFault;

/// How a run ended. A lost coin or a missing table is an ending, not an error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Outcome {
    /// The goal was reached.
    Completed,
    /// It cannot be reached any more, or not in time; or the run never began.
    #[default]
    Failed,
    /// Somebody stopped it.
    Cancelled,
}

/// Reason of a run that somebody stopped.
pub const STOPPED: &str = "stopped from outside, motors at zero";

/// An outcome and the reason in words.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Ending {
    /// How.
    pub outcome: Outcome,
    /// Why, one line for people.
    pub reason: String,
}

impl Ending {
    /// The goal was reached.
    pub fn completed(reason: impl Into<String>) -> Self {
        Self { outcome: Outcome::Completed, reason: reason.into() }
    }

    /// The goal is out of reach.
    pub fn failed(reason: impl Into<String>) -> Self {
        Self { outcome: Outcome::Failed, reason: reason.into() }
    }

    /// Somebody stopped it.
    pub fn cancelled(reason: impl Into<String>) -> Self {
        Self { outcome: Outcome::Cancelled, reason: reason.into() }
    }
}

impl From<RigFault> for Ending {
    fn from(fault: RigFault) -> Self {
        Self::failed(format!("the rig stopped: {fault}"))
    }
}
