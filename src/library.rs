//! The COR library: what a rig was measured to be able to do, and how far parts go when it does.

mod displacement;
mod drive;
mod fault;
mod field_drive;
mod file;
mod raw;
mod types;
mod validate;
mod wording;

pub use drive::drive_for;
pub use fault::LibraryFault;
pub use raw::{RawDisplacement, RawEntry, RawLibrary, RawShapes};
pub use types::{AxisShape, DisplacementModel, Entry, FieldResponse, Library};
pub use validate::RigFacts;
