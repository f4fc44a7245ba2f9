//! The COR library: what a rig was measured to be able to do, and how far parts go when it does.

mod agreement;
mod coil_response;
mod displacement;
mod drive;
mod field_drive;
#[cfg(test)]
mod fields_tests;
mod file;
#[cfg(test)]
mod plate_tests;
mod probe;
mod raw;
mod raw_fields;
mod raw_plate;
mod types;
mod validate;

pub use coil_response::CoilResponse;
pub use drive::drive_for;
pub use field_drive::motor_harmonics;
pub use raw::{RawDisplacement, RawEntry, RawLibrary, RawShapes};
pub use raw_fields::RawFieldResponse;
pub use raw_plate::{RawAxes, RawPlateResponse};
pub use types::{AxisShape, DisplacementModel, Entry, FieldResponse, Library, PlateResponse};
pub use validate::{FieldFacts, RigFacts};
