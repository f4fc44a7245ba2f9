use std::fmt;

use upm_core::job::{Finding, RunnerUp};
use upm_planning::planner::{Limit, PlanStatus};

/// A finding of a run that may last over many cycles, and what it is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Found {
    /// The finding.
    pub finding: Finding,
    /// Index of the part, coil or channel; `None` where it is about none, or an unknown one.
    pub about: Option<usize>,
}

impl Found {
    /// A finding about the part, coil or channel with this index.
    pub(super) fn about(finding: Finding, index: usize) -> Self {
        Self { finding, about: Some(index) }
    }
}

impl From<Finding> for Found {
    fn from(finding: Finding) -> Self {
        Self { finding, about: None }
    }
}

/// Why a finding holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reason {
    /// The reason for people.
    pub text: String,
    /// The next best explanation; `None` where no other was weighed.
    pub runner_up: Option<RunnerUp>,
}

impl From<String> for Reason {
    fn from(text: String) -> Self {
        Self { text, runner_up: None }
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)?;
        self.runner_up.as_ref().map_or(Ok(()), |runner_up| write!(f, " ({runner_up})"))
    }
}

/// The finding behind a plan without pulses, and its reason for people; `None` for a plan that can be played. `id`
/// names a part.
pub(super) fn finding_of_plan<'a>(status: &PlanStatus, id: impl Fn(usize) -> &'a str) -> Option<(Finding, String)> {
    Some(match status {
        PlanStatus::Solved | PlanStatus::NothingToDo => return None,
        PlanStatus::SolverFailed(why) => (Finding::SolverFails, format!("the solver gave up ({why})")),
        PlanStatus::Infeasible(Limit::Edge { part }) => {
            (Finding::StepsMeetEdge, format!("{} would cross the edge margin", id(*part)))
        }
        PlanStatus::Infeasible(Limit::Separation { parts: [a, b] }) => {
            (Finding::StepsMeetParts, format!("{} and {} would come too close to each other", id(*a), id(*b)))
        }
        PlanStatus::Infeasible(Limit::Unreachable) => {
            (Finding::StepsUnreachable, "no motion was found that brings the parts closer to their places".into())
        }
    })
}
