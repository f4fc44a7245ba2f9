use std::sync::atomic::{AtomicBool, Ordering};

use super::conditions::Condition;
use upm_core::rig::{RigFault, Trip};

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

/// Cause of the end of a run, for programs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EndCause {
    /// The run itself, or a stop from outside.
    #[default]
    Run,
    /// A request to give way: the run ended between two cycles, with motors at zero and parts at rest.
    GaveWay,
    /// Pulses, or time without one, brought no part nearer to its target.
    NoProgress,
    /// A cycle had no plan that keeps the limits.
    NoFeasibleStep,
    /// Rotations of the library cannot move the parts independently where they were first seen.
    Uncontrollable,
    /// The plate time limit was reached.
    TimeLimit,
    /// A part cannot be seen any more.
    PartLost,
    /// The camera does not see the parts of the job when the run begins.
    PartCount,
    /// The rig failed.
    Device,
    /// A guard found something that a run cannot go on with.
    Guard(Condition),
    /// Stopped from outside: this computer was too slow for the plate, under strict deadlines.
    DeadlineMissed,
    /// Stopped from outside: control took no frame for a long time.
    Hung,
    /// Stopped from outside: no part was seen for a long time.
    NoPartSeen,
    /// Stopped from outside: events of the run could not be stored.
    EventsBlocked,
    /// Stopped from outside: the journal could not be written.
    JournalBlocked,
}

impl EndCause {
    /// For people: what the operator should check or change; `None` where there is nothing.
    pub fn remedy(self) -> Option<&'static str> {
        match self {
            Self::Run | Self::GaveWay | Self::NoFeasibleStep | Self::Uncontrollable | Self::DeadlineMissed => None,
            Self::NoProgress => Some("check that the parts lie flat and free, and that the targets can be reached"),
            Self::TimeLimit => Some("check that the parts move freely, or give the job more time"),
            Self::PartLost => Some("find the part and put it back, or take it out of the job"),
            Self::PartCount => Some("put the parts of the job on the plate, and nothing else"),
            Self::Device => Some("check the rig's power and cables"),
            Self::Guard(condition) => Some(condition.remedy()),
            Self::Hung => Some("restart the program, and report it"),
            Self::NoPartSeen => Some("check the parts, the light and the camera"),
            Self::EventsBlocked | Self::JournalBlocked => Some("check the disk"),
        }
    }
}

/// Outcome, cause and reason of the end of a run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Ending {
    /// How.
    pub outcome: Outcome,
    /// Its cause.
    pub cause: EndCause,
    /// Why, one line for people.
    pub reason: String,
}

impl Ending {
    /// The goal was reached.
    pub fn completed(reason: impl Into<String>) -> Self {
        Self { outcome: Outcome::Completed, reason: reason.into(), ..Self::default() }
    }

    /// The goal is out of reach.
    pub fn failed(reason: impl Into<String>) -> Self {
        Self { outcome: Outcome::Failed, reason: reason.into(), ..Self::default() }
    }

    /// The goal is out of reach for a cause that programs tell apart; `reason` is followed by the remedy.
    pub fn failed_because(cause: EndCause, reason: impl std::fmt::Display) -> Self {
        let reason = cause.remedy().map_or_else(|| reason.to_string(), |remedy| format!("{reason}; {remedy}"));
        Self { cause, ..Self::failed(reason) }
    }

    /// A guard ends the run.
    pub(super) fn guarded(condition: Condition, reason: impl std::fmt::Display) -> Self {
        Self::failed_because(EndCause::Guard(condition), reason)
    }

    /// Somebody stopped it.
    pub fn cancelled(reason: impl Into<String>) -> Self {
        Self { outcome: Outcome::Cancelled, reason: reason.into(), ..Self::default() }
    }

    /// Ended between two cycles to make room for another run. A task without an end that gets on is `completed` by that;
    /// any other has not reached its goal.
    pub fn gave_way(completed: bool) -> Self {
        let outcome = if completed { Outcome::Completed } else { Outcome::Cancelled };
        Self { outcome, cause: EndCause::GaveWay, reason: "gave way to another job".to_owned() }
    }
}

impl From<RigFault> for Ending {
    fn from(fault: RigFault) -> Self {
        let reason = format!("the rig stopped: {fault}");
        match fault {
            RigFault::Stopped(Trip::EStop | Trip::Shutdown) => Self::cancelled(reason),
            RigFault::Stopped(_) => Self::failed(reason),
            _ => Self::failed_because(EndCause::Device, reason),
        }
    }
}

/// An ending once somebody set `stop`.
pub(super) fn check_stop(stop: &AtomicBool) -> Result<(), Ending> {
    if stop.load(Ordering::Relaxed) { Err(Ending::cancelled(STOPPED)) } else { Ok(()) }
}

/// True for the reason of a run that was stopped, from outside or by its rig's interlock: nothing in the run itself
/// ended it.
pub fn is_stop(reason: &str) -> bool {
    reason == STOPPED || Trip::ALL.iter().any(|&trip| reason == Ending::from(RigFault::Stopped(trip)).reason)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stopped_rig_ends_a_run_by_who_stopped_it() {
        for (trip, outcome) in [
            (Trip::EStop, Outcome::Cancelled),
            (Trip::Shutdown, Outcome::Cancelled),
            (Trip::Lease, Outcome::Failed),
            (Trip::Watchdog, Outcome::Failed),
        ] {
            let ending = Ending::from(RigFault::Stopped(trip));
            assert_eq!((ending.outcome, is_stop(&ending.reason)), (outcome, true), "{trip:?}");
        }
        assert!(is_stop(STOPPED));
        let broken = Ending::from(RigFault::Device("no camera".into()));
        assert_eq!((broken.outcome, is_stop(&broken.reason)), (Outcome::Failed, false));
        assert!(!is_stop("stalled: no pulse for 10 s of plate time"));
    }
}
