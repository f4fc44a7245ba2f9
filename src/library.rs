//! The COR library: what a rig was measured to be able to do, and how far parts go when it does.

mod types;

pub use types::{AxisShape, DisplacementModel, Entry, Library};
