use std::sync::atomic::AtomicBool;

use crate::config::RigSpec;
use crate::control::ExpectedPart;
use crate::control::calibration::{self, CalibrationFault, CalibrationParams, CalibrationProgress};
use crate::geometry::{Pose, Vec2};
use crate::library::Library;
use crate::random::Streams;
use crate::sim::{PartParams, SimRig};

/// Where the calibration coins lie, in parts of half the plate's side: spread over radii and directions, far
/// enough inside that the longest pulse leaves them on the plate.
const COINS: [[f64; 2]; 7] =
    [[0.05, 0.0], [-0.45, 0.1], [0.4, 0.4], [0.1, -0.5], [-0.3, -0.45], [-0.2, 0.55], [0.55, -0.2]];

/// Measures the simulated rig `rig` with pennies on it.
pub fn calibrate(
    rig: &RigSpec,
    seed: u64,
    params: &CalibrationParams,
    stop: &AtomicBool,
    progress: &mut dyn FnMut(CalibrationProgress),
) -> Result<Library, CalibrationFault> {
    let streams = Streams::new(seed);
    let Some(penny) = rig.kinds.first() else {
        return Err(CalibrationFault::Look("the rig knows no kind of part".into()));
    };
    let coin = PartParams {
        radius_m: penny.kind.radius_m,
        thickness_m: penny.kind.thickness_m,
        mass_kg: penny.mass_kg,
        friction: penny.friction,
    };
    let half_side_m = 0.5 * rig.model.plate_side_m;
    let coins =
        COINS.iter().map(|&[x, y]| (coin, Pose { position_m: Vec2::new(x, y) * half_side_m, heading_rad: 0.0 }));
    let mut simulated = SimRig::new(rig.model.clone(), rig.sim.clone(), coins.collect(), streams);
    calibration::calibrate(&mut simulated, &rig.model, &rig.fingerprint, params, stop, progress)
}

/// The full calibration of `rig`, pennies on the plate.
pub fn calibration_params(rig: &RigSpec) -> CalibrationParams {
    let kinds = rig.kinds.first().map(|spec| spec.kind.clone()).into_iter().collect();
    let coin = |i: usize| ExpectedPart { id: format!("coin-{}", i + 1), kind: 0, expected_m: None };
    CalibrationParams::full(kinds, (0..COINS.len()).map(coin).collect())
}
