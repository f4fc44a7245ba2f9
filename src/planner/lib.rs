//! Planners: from wanted steps to pulses. Either candidate CORs of the library, a quadratic program for the d_j and a
//! sequence of rotations; or one synthesised motion for all parts.

mod fields;
mod flow_effort;
mod friction;
mod independence;
mod pseudo_inverse;
mod pump;
mod reach;
mod rotations;
mod types;

#[cfg(test)]
mod fixture;
#[cfg(test)]
mod tests;

pub use fields::FieldPlanner;
pub use flow_effort::FlowEffort;
pub use independence::Independence;
pub use pseudo_inverse::PseudoInverse;
pub use reach::Reach;
pub use rotations::RotationPlanner;
pub use types::{
    FieldPulse, Limit, PartState, Plan, PlanStatus, PlannedPulse, PlannerParams, PlanningMethod, Rotation,
};
