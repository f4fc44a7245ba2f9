use std::fmt;

use upm_core::job::{Finding, RunnerUp};
use upm_planning::planner::{Limit, PlanStatus, PlanningMethod};

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

/// The finding behind a plan without pulses; `None` for a plan that can be played.
pub(super) fn finding_of_plan(status: &PlanStatus) -> Option<Finding> {
    match status {
        PlanStatus::Solved | PlanStatus::NothingToDo => None,
        PlanStatus::Infeasible(Limit::Edge { .. }) => Some(Finding::StepsMeetEdge),
        PlanStatus::Infeasible(Limit::Separation { .. }) => Some(Finding::StepsMeetParts),
        PlanStatus::Infeasible(Limit::Unreachable) => Some(Finding::StepsUnreachable),
        PlanStatus::SolverFailed(_) => Some(Finding::SolverFails),
    }
}

/// The reason, for people, that a plan has no pulses. `id` names a part.
pub(super) fn no_plan_reason<'a>(status: &PlanStatus, method: PlanningMethod, id: impl Fn(usize) -> &'a str) -> String {
    match (status, method) {
        (PlanStatus::Solved, _) => "it has pulses".into(),
        (PlanStatus::NothingToDo, _) => "every step is shorter than the shortest pulse".into(),
        (PlanStatus::Infeasible(Limit::Edge { part }), _) => format!("{} would cross the edge margin", id(*part)),
        (PlanStatus::Infeasible(Limit::Separation { parts: [a, b] }), _) => {
            format!("{} and {} would come too close to each other", id(*a), id(*b))
        }
        (
            PlanStatus::Infeasible(Limit::Unreachable),
            PlanningMethod::SynthesizedField | PlanningMethod::MovingField,
        ) => "no motion was found that brings the parts closer to their places".into(),
        (PlanStatus::Infeasible(Limit::Unreachable), PlanningMethod::CorSequence | PlanningMethod::PseudoInverse) => {
            "no motion of the library moves every part that should move".into()
        }
        (PlanStatus::SolverFailed(why), _) => format!("the solver gave up ({why})"),
    }
}

/// Begin or end of a finding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FindingChange {
    /// It began in this cycle.
    Began,
    /// It no longer holds, or the run has ended.
    Ended {
        /// Number of cycles in which it held.
        times: u64,
        /// Plate time from its beginning to the last cycle in which it held, s.
        lasted_s: f64,
    },
}
