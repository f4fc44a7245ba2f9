//! From raw sensor data to facts: [`vision`] finds table and parts in a camera frame, [`estimation`] reads the plate's
//! motion from an accelerometer trace.

pub mod estimation;
pub mod vision;
