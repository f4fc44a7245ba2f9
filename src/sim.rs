//! The simulated rig, the only owner of ground truth.

mod params;
mod truth;

pub use params::{AccelerometerParams, CameraParams, ContactParams, MotorParams, PartParams, PlateParams, SimParams};
pub use truth::{PartTruth, Truth, TruthProbe};
