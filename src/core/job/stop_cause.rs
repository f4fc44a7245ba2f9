use serde::{Deserialize, Serialize};

use super::{Effect, Finding};
use crate::coded_enum;

coded_enum! {
    /// A stop that a person or another job asked for, or that the end of the program caused.
    #[derive(schemars::JsonSchema)]
    pub enum StopRequest {
        /// A request to give way to another job: the run ended between two cycles, motors at zero, parts at rest.
        GaveWay = "gave_way",
        /// The flag that ends a run was set by an unknown caller.
        Stopped = "stopped",
        /// The operator interrupted the program.
        Interrupted = "interrupted",
        /// A client asked for it.
        Cancelled = "cancelled",
        /// An operator pressed the emergency stop.
        Estop = "estop",
        /// The program ended.
        Shutdown = "shutdown",
    }
}

/// Cause of the end of a run that did not reach its goal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(untagged)]
pub enum StopCause {
    /// Something was wrong.
    Found(Finding),
    /// It was asked for.
    Asked(StopRequest),
}

impl From<Finding> for StopCause {
    fn from(finding: Finding) -> Self {
        Self::Found(finding)
    }
}

impl From<StopRequest> for StopCause {
    fn from(request: StopRequest) -> Self {
        Self::Asked(request)
    }
}

impl StopCause {
    /// The name in files and on the network, which never changes.
    pub fn code(self) -> &'static str {
        match self {
            Self::Found(finding) => finding.code(),
            Self::Asked(request) => request.code(),
        }
    }

    /// The cause with this code.
    pub fn of_code(code: &str) -> Option<Self> {
        let found = Finding::of_code(code).map(Self::Found);
        found.or_else(|| StopRequest::of_code(code).map(Self::Asked))
    }

    /// Advice for the operator on what to check or change; `None` without advice.
    pub fn remedy(self) -> Option<&'static str> {
        match self {
            Self::Found(finding) => Some(finding.check()).filter(|check| !check.is_empty()),
            Self::Asked(_) => None,
        }
    }

    /// True for a stop from outside the run: a repetition of the run does not end there.
    pub fn is_external(self) -> bool {
        self.is_by_watchdog() || matches!(self, Self::Asked(_) | Self::Found(Finding::JournalLost))
    }

    /// True for a stop by a watchdog, which detects faults that the run itself cannot.
    pub fn is_by_watchdog(self) -> bool {
        use Finding::{DeadlineMissed, Hung, JournalBlocked, LeaseExpired, NoPartSeen, Watchdog};
        let Self::Found(finding) = self else { return false };
        matches!(finding, LeaseExpired | Watchdog | DeadlineMissed | Hung | NoPartSeen | JournalBlocked)
    }

    /// True where the operator has to check the plate before it takes another job.
    pub fn pauses_plate(self) -> bool {
        matches!(self, Self::Found(finding) if !matches!(finding.effect(), Effect::GoesOn | Effect::Ends))
    }
}
