//! Sensor data processing: [`vision`] finds table and parts in a camera frame, [`estimation`] determines the plate's
//! motion from an accelerometer trace.

#![cfg_attr(test, allow(clippy::disallowed_methods))]

pub mod estimation;
pub mod vision;
