//! A library without a rig for tests: few belts, distances by hand.

use std::f64::consts::TAU;

use upm_core::geometry::Twist;
use upm_library::{AxisShape, DisplacementModel, Entry, Library};

pub const HALF_M: f64 = 0.1;

/// Steps of 1 to 10 mm and 2 to 20 mm on belts of 0.1 and 0.5 m/s, a tenth of them as standard deviation.
pub fn library(pumps: impl IntoIterator<Item = Twist>) -> Library {
    let distance_m = vec![vec![0.001, 0.01], vec![0.002, 0.02]];
    Library {
        rig: "made".into(),
        fingerprint: "12ab".into(),
        plate_side_m: 2.0 * HALF_M,
        base_radps: TAU * 60.0,
        attack_s: 0.01,
        rest_s: 0.03,
        accelerometer_gain: [1.0; 4],
        shapes: [AxisShape::FREE_MASS; 3],
        entries: pumps.into_iter().map(|pump| Entry { amplitudes: [100, -100, 0, 0], pump }).collect(),
        displacement: DisplacementModel {
            speed_mps: vec![0.1, 0.5],
            sustain_s: vec![0.0, 0.2],
            sd_m: distance_m.iter().map(|row| row.iter().map(|d| 0.1 * d).collect()).collect(),
            distance_m,
        },
        fields: None,
        plate: None,
    }
}
