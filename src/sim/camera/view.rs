use nalgebra::{Matrix3, Rotation3, Vector3};

use super::super::CameraParams;
use upm_core::geometry::{Lens, Vec2};

/// Pose and projection of the camera: table to image and, on the plate's plane, back.
#[derive(Clone, Debug)]
pub(super) struct CameraProjection {
    lens: Lens,
    position_m: Vector3<f64>,
    table_from_camera: Matrix3<f64>,
}

impl CameraProjection {
    pub(super) fn new(params: &CameraParams) -> Self {
        let [about_x, about_y, about_axis] = params.tilt_rad;
        let looking_down = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
        let turned = Rotation3::from_axis_angle(&Vector3::x_axis(), about_x)
            * Rotation3::from_axis_angle(&Vector3::y_axis(), about_y)
            * Rotation3::from_axis_angle(&Vector3::z_axis(), about_axis);
        Self {
            lens: params.lens(),
            position_m: params.position_m,
            table_from_camera: looking_down * turned.into_inner(),
        }
    }

    /// Projection of a table point at `height_m` above the plate, px.
    pub(super) fn image_from_table(&self, p_m: Vec2, height_m: f64) -> Vec2 {
        let seen = self.table_from_camera.tr_mul(&(Vector3::new(p_m.x, p_m.y, height_m) - self.position_m));
        self.lens.image_from_ideal(self.lens.principal_px + self.lens.focal_px * seen.xy() / seen.z)
    }

    /// The point of the plate's plane seen at an image point, m; `None` at and above the horizon.
    pub(super) fn table_from_image(&self, image_px: Vec2) -> Option<Vec2> {
        self.table_from_ideal(self.lens.ideal_from_image(image_px))
    }

    /// The point of the plate's plane seen at an ideal image point, m; `None` at and above the horizon.
    pub(super) fn table_from_ideal(&self, ideal_px: Vec2) -> Option<Vec2> {
        let n = (ideal_px - self.lens.principal_px) / self.lens.focal_px;
        let ray = self.table_from_camera * Vector3::new(n.x, n.y, 1.0);
        let depth = -self.position_m.z / ray.z;
        let p_m = self.position_m.xy() + depth * ray.xy();
        (depth > 0.0 && p_m.x.is_finite() && p_m.y.is_finite()).then_some(p_m)
    }

    /// Ideal image points of `ideal.len()` pixels of one row, from the pixel at `first_px` rightwards.
    /// The map is so smooth that one Newton step from a straight extrapolation is exact to 1e-9 px.
    pub(super) fn ideal_from_row(&self, first_px: Vec2, ideal: &mut [Vec2]) {
        for i in 0..ideal.len() {
            let image_px = first_px + Vec2::new(i as f64, 0.0);
            ideal[i] = if self.lens.is_ideal() {
                image_px
            } else if i < 2 {
                self.lens.ideal_from_image(image_px)
            } else {
                self.refined(2.0 * ideal[i - 1] - ideal[i - 2], image_px)
            };
        }
    }

    fn refined(&self, ideal_px: Vec2, image_px: Vec2) -> Vec2 {
        let error = self.lens.image_from_ideal(ideal_px) - image_px;
        match self.lens.jacobian_at_ideal(ideal_px).try_inverse() {
            Some(inverse) => ideal_px - inverse * error,
            None => ideal_px,
        }
    }

    /// Intersection with the plate's plane, m, of the line of sight through a point at `height_m` above the plate, and
    /// the magnification there of a level figure at that height.
    pub(super) fn shadow(&self, p_m: Vec2, height_m: f64) -> (Vec2, f64) {
        let magnification = self.position_m.z / (self.position_m.z - height_m);
        let foot = self.position_m.xy();
        (foot + magnification * (p_m - foot), magnification)
    }

    /// Metres of the plate per pixel near the optical axis.
    pub(super) fn m_per_px(&self) -> f64 {
        self.position_m.z / self.lens.focal_px
    }
}

#[cfg(test)]
mod tests {
    use super::super::scenes;
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn tilts_turn_the_camera_about_its_own_axes() {
        let seen_at = |tilt_rad| {
            let mut params = scenes::small();
            (params.tilt_rad, params.position_m) = (tilt_rad, Vector3::new(0.0, 0.0, 0.5));
            params = CameraParams { focal_px: 1000.0, principal_px: Some([0.0; 2]), ..params };
            (params.radial, params.tangential) = ([0.0; 2], [0.0; 2]);
            CameraProjection::new(&params).image_from_table(Vec2::new(0.01, 0.0), 0.0)
        };
        let straight = seen_at([0.0; 3]);
        assert!((straight - Vec2::new(20.0, 0.0)).norm() < 1e-9);
        assert!(seen_at([0.01, 0.0, 0.0]).y > 9.9, "turned up about the image's x axis, things move down");
        assert!(seen_at([0.0, 0.01, 0.0]).x < 10.1, "turned right about the image's y axis, things move left");
        assert!(seen_at([0.0, 0.0, 0.01]).y < -0.19, "turned clockwise, the picture turns counter-clockwise");
    }

    proptest! {
        #[test]
        fn the_way_back_is_the_way_there(x in -0.1..0.1f64, y in -0.1..0.1f64, height in 0.0..0.02f64) {
            let view = CameraProjection::new(&scenes::full());
            let p = Vec2::new(x, y);
            let back = view.table_from_image(view.image_from_table(p, 0.0)).unwrap();
            prop_assert!((back - p).norm() < 1e-12);
            let (shadow, _) = view.shadow(p, height);
            prop_assert!((view.image_from_table(shadow, 0.0) - view.image_from_table(p, height)).norm() < 1e-8);
        }

    }
}
