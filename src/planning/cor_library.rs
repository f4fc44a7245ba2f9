//! The COR library: measured motions of a rig, and measured distances of parts under them.

mod coil_response;
mod displacement;
mod drive;
#[cfg(test)]
mod fields_tests;
mod file;
mod probe;
mod segment_response;
pub mod testing;
mod types;
mod validate;

pub use coil_response::CoilResponse;
pub(crate) use displacement::bracket;
pub use drive::{drive_for, motor_harmonics};
pub use types::{AxisShape, CameraNoise, DisplacementModel, Entry, FieldResponse, Library, PlateResponse};
pub(crate) use validate::flow_eigenvalues;
