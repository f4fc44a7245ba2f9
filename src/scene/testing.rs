//! Scenes for tests of the vision.

use nalgebra::Vector3;

use super::{Scene, SceneDisc};
use upm_core::geometry::Vec2;

/// Side of the plate, m.
pub const SIDE_M: f64 = 0.2032;
/// Radius of a penny, m.
pub const PENNY_M: f64 = 0.009525;

/// A penny at `(x_m, y_m)` on the plate.
pub fn penny(x_m: f64, y_m: f64) -> SceneDisc {
    SceneDisc::new(Vec2::new(x_m, y_m), PENNY_M, 1.52e-3)
}

impl Scene {
    /// Rotation, off-centre camera, tilt and lens distortion drawn from the seed.
    pub fn general(seed: u64) -> Self {
        let u = |k: u64| ((seed * 7919 + k * 104_729 + 13) % 1000) as f64 / 500.0 - 1.0;
        let mut scene = Self::plain(seed);
        scene.tilt_rad = [0.05 * u(4), 0.05 * u(5), 0.1 * u(6)];
        let plate_in_camera_m = Vector3::new(0.003 * u(1), 0.003 * u(2), 0.6 + 0.02 * u(3));
        scene.camera_m = -scene.camera_from_table().transpose() * plate_in_camera_m;
        scene.lens.radial = [-0.12 + 0.05 * u(7), 0.03];
        scene.lens.tangential = [4e-4, -3e-4];
        scene
    }

    /// The same under uneven light, blurred, with noise.
    pub fn rough(self) -> Self {
        Self { shading: 0.4, blur_px: 1.5, noise_sd: 8.0, ..self }
    }
}
