//! Synthetic library for tests, without a rig: few belt speeds, with distances chosen by hand.

use upm_core::geometry::Twist;
use upm_planning::cor_library::{DisplacementModel, Library};

pub const HALF_M: f64 = 0.1;

/// Steps of 1 to 10 mm and 2 to 20 mm on belts of 0.1 and 0.5 m/s, with standard deviations of a tenth of the step.
pub fn library(pumps: impl IntoIterator<Item = Twist>) -> Library {
    let distance_m = vec![vec![0.001, 0.01], vec![0.002, 0.02]];
    let displacement = DisplacementModel {
        speed_mps: vec![0.1, 0.5],
        sustain_s: vec![0.0, 0.2],
        sd_m: distance_m.iter().map(|row| row.iter().map(|d| 0.1 * d).collect()).collect(),
        distance_m,
    };
    Library { displacement, ..upm_planning::cor_library::testing::library(pumps) }
}
