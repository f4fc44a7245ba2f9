//! Faults that begin and end within a run. [`Faulty`] adds faults of wiring and cameras to the simulated rig; faults of
//! the plant itself are set on its parts. A run without faults is unchanged.

mod faulty;
mod picture;
mod plant;
mod spec;
mod trace;

pub use faulty::Faulty;
pub(crate) use picture::SeenDisc;
pub(crate) use plant::{CoilFaults, Oil, PlantFaults};
pub use spec::{FaultKind, FaultSpec, FaultyComponent, ValueRange};
