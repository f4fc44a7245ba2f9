//! Faults that begin and end within a run: what wires and cameras do is laid over any rig by [`Faulty`], what only a plant
//! can have is set on the simulated one through [`FaultyPlant`]. A run without faults is the run it was before.

mod draw;
mod faulty;
mod picture;
mod plant;
mod spec;
mod trace;

pub use draw::drawn_faults;
pub use faulty::Faulty;
pub use plant::{CoilFaults, FaultyPlant, Oil, PlantChange, PlantFaults, SeenDisc};
pub use spec::{Component, FaultKind, FaultSpec, ValueRange};
