//! Sensor data processing: [`vision`] finds table and parts in a camera frame, [`estimation`] determines the plate's
//! motion from an accelerometer trace.

pub mod estimation;
pub mod vision;
