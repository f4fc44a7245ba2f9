//! From wanted steps to pulses: candidate CORs out of the library, the QP for the d_j, the sequence.

mod types;

pub use types::{Limit, PartState, Plan, PlanStatus, PlannedPulse, PlannerParams};
