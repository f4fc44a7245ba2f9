//! A library without a rig, for tests: few belts, and neutral values elsewhere.

use std::f64::consts::TAU;

use super::{AxisShape, DisplacementModel, Entry, Library};
use upm_core::geometry::Twist;

/// Belts `pumps` of one pair of coils at 60 Hz, on a plate of 0.2 m; distances and the plate's response are unknown.
pub fn library(pumps: impl IntoIterator<Item = Twist>) -> Library {
    Library {
        rig: "bench".into(),
        fingerprint: "12ab".into(),
        plate_side_m: 0.2,
        base_radps: TAU * 60.0,
        attack_s: 0.01,
        rest_s: 0.03,
        motor_arrangement: Default::default(),
        accelerometer_gain: [1.0; 4],
        shapes: [AxisShape::FREE_MASS; 3],
        entries: pumps.into_iter().map(|pump| Entry { amplitudes: [100, -100, 0, 0], pump }).collect(),
        displacement: DisplacementModel::default(),
        camera_noise: None,
        fields: None,
        plate: None,
    }
}
