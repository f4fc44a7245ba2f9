//! Foundations of every other crate of `upm`: units, plate time, seeded random streams, planar geometry, the friction
//! of a disc, the plain data that crosses the hardware boundary, and the trait [`rig::Rig`] that is this boundary.

#![cfg_attr(test, allow(clippy::disallowed_methods))]

pub mod background;
mod coded_enum;
pub mod disc_friction;
pub mod document;
pub mod files;
pub mod geometry;
pub mod ground_truth;
pub mod job;
pub mod phasor;
pub mod random;
pub mod rig;
pub mod signal;
pub mod thread_priority;
pub mod time;
pub mod units;
