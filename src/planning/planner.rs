//! Planners: from wanted steps to pulses. Either CORs of the library, a second-order-cone program for the counts of
//! pulses and quadratic programs for their lengths d_j; or one synthesised motion for all parts.

mod cache;
mod corridor;
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

pub use corridor::Corridor;
pub use fields::{FieldPlanner, Heading, MovingPlanner, Segment};
pub use flow_effort::FlowEffort;
pub use independence::Independence;
pub use pseudo_inverse::PseudoInverse;
pub use reach::Reach;
pub use rotations::RotationPlanner;
pub use types::{
    FieldPulse, Limit, PartState, Plan, PlanStatus, PlannedPulse, PlannerParams, PlanningMethod, Rotation,
};
