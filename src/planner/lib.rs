//! From wanted steps to pulses: candidate CORs out of the library, the QP for the d_j, the sequence; or one synthesised
//! motion for all parts.

mod candidates;
mod field;
mod fields;
mod fit;
mod limits;
mod plan;
mod program;
mod pseudo_inverse;
mod reach;
mod sequence;
mod sparsify;
mod stride;
mod task;
mod types;

#[cfg(test)]
mod closed_loop;
#[cfg(test)]
mod fixture;
#[cfg(test)]
mod tests;

pub use fields::FieldPlanner;
pub use plan::Planner;
pub use pseudo_inverse::PseudoInverse;
pub use reach::Reach;
pub use types::{FieldPulse, Limit, Method, PartState, Plan, PlanStatus, PlannedPulse, PlannerParams, Rotation};
