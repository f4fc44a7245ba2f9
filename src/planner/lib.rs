//! From wanted steps to pulses: candidate CORs out of the library, the QP for the d_j, the sequence; or one synthesised
//! motion for all parts.

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
pub use types::{FieldPulse, Limit, Method, PartState, Plan, PlanStatus, PlannedPulse, PlannerParams, Rotation};
