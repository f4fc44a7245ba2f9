//! Simulated rig, the only owner of ground truth.

#![cfg_attr(test, allow(clippy::disallowed_methods))]

mod accelerometers;
mod camera;
mod collision;
mod drive_sequence;
pub mod faults;
mod interlock_port;
mod motors;
mod open_loop;
mod oscillator;
mod params;
mod parts;
mod plant;
mod plate;
#[cfg(test)]
mod pump_tests;
mod simulated_rig;

use camera::{Camera, Snapshot};
pub use open_loop::{OpenLoopTrajectories, OpenPulse, PartTrajectory, check_pulses, simulate};
pub use params::{AccelerometerParams, CameraParams, ContactParams, MotorParams, PartParams, PlateParams, SimParams};
pub use parts::{PartMotion, Parts};
pub use plant::Plant;
pub use plate::{PlateMotion, Wrench};
pub use simulated_rig::SimRig;
