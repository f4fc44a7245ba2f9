//! Faults that begin and end within a run. [`Faulty`] adds faults of wiring and cameras to any rig; faults of the plant
//! itself are set on the simulated rig through [`FaultyPlant`]. A run without faults is unchanged.

mod draw;
mod faulty;
mod picture;
mod plant;
mod spec;
mod trace;

pub use draw::drawn_faults;
pub use faulty::Faulty;
pub use plant::{CoilFaults, FaultyPlant, Oil, PlantChange, PlantFaults, SeenDisc};
pub use spec::{FaultKind, FaultSpec, FaultyComponent, ValueRange};
