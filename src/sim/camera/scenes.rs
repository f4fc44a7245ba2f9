//! Cameras for tests.

use nalgebra::Vector3;
use proptest::prelude::*;

use super::CameraParams;

/// Side of the plate in all scenes, m.
pub(super) const PLATE_M: f64 = 0.2032;

/// The whole plate in 1280 × 1024, 4.4 px per millimetre.
pub(super) fn full() -> CameraParams {
    CameraParams {
        size_px: [1280, 1024],
        frame_hz: 60.0,
        exposure_s: 2e-3,
        focal_px: 2650.0,
        principal_px: Some([645.0, 505.0]),
        radial: [-0.15, 0.08],
        tangential: [4e-4, -3e-4],
        position_m: Vector3::new(0.02, -0.015, 0.6),
        tilt_rad: [0.03, -0.04, 0.02],
        blur_px: 0.8,
        levels: [12.0, 220.0, 35.0],
        shading: 0.15,
        shading_direction_rad: 0.6,
        full_well_e: 10_000.0,
        read_noise: 0.8,
    }
}

/// A small picture of the plate's upper right, strongly tilted and distorted, as sharp as the full one.
pub(super) fn small() -> CameraParams {
    CameraParams {
        size_px: [150, 110],
        focal_px: 1100.0,
        principal_px: Some([40.0, 80.0]),
        radial: [-0.5, 0.4],
        tangential: [3e-3, -2e-3],
        position_m: Vector3::new(0.03, 0.02, 0.55),
        tilt_rad: [0.09, 0.07, 0.15],
        ..full()
    }
}

/// Small pictures of a corner of the plate or of empty ground, from vertical views to views across the horizon.
pub(super) fn any() -> impl Strategy<Value = CameraParams> {
    let tilt = || prop_oneof![-0.1..0.1f64, -1.7..1.7f64];
    let radial = || prop_oneof![Just(0.0), -0.3..0.3f64];
    let lens = (800.0..3000.0f64, -400.0..400.0f64, -400.0..400.0f64, radial(), radial(), -5e-3..5e-3f64);
    let place = (-0.05..0.05f64, -0.05..0.05f64, 0.2..1.5f64);
    (lens, place, tilt(), tilt(), -3.2..3.2f64).prop_map(|(lens, place, about_x, about_y, about_axis)| CameraParams {
        focal_px: lens.0,
        principal_px: Some([60.0 + lens.1, 50.0 + lens.2]),
        radial: [lens.3, 0.5 * lens.4],
        tangential: [lens.5, -lens.5],
        position_m: Vector3::new(place.0, place.1, place.2),
        tilt_rad: [about_x, about_y, about_axis],
        ..small()
    })
}
