use std::f64::consts::TAU;

use nalgebra::{Matrix3, Rotation3, Vector3};

use super::{Scene, SceneDisc, ScenePartTruth};
use upm_core::geometry::{Homography, Vec2, cross};

/// Points of the polygon that approximates an outline for its area.
const OUTLINE_POINTS: usize = 720;

impl Scene {
    /// Camera coordinates (x right, y down, z away from the camera) of directions in the table frame.
    pub(super) fn camera_from_table(&self) -> Matrix3<f64> {
        let [about_x, about_y, about_axis] = self.tilt_rad;
        let down = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), about_axis)
            * Rotation3::from_axis_angle(&Vector3::y_axis(), about_y)
            * Rotation3::from_axis_angle(&Vector3::x_axis(), about_x);
        turn.matrix() * down
    }

    /// Ideal image coordinates from plate coordinates.
    pub(super) fn ideal_from_table(&self) -> Homography {
        let r = self.camera_from_table();
        let t = -r * self.camera_m;
        let (f, p) = (self.lens.focal_px, self.lens.principal_px);
        let k = Matrix3::new(f, 0.0, p.x, 0.0, f, p.y, 0.0, 0.0, 1.0);
        Homography::new(k * Matrix3::from_columns(&[r.column(0).into(), r.column(1).into(), t]))
    }

    /// Image point, px, of a point of the plate's plane, m.
    pub fn image_from_table(&self, p_m: Vec2) -> Vec2 {
        self.lens.image_from_ideal(self.ideal_from_table().apply(p_m))
    }

    /// True corners, px, clockwise from top left.
    pub fn corners_px(&self) -> [Vec2; 4] {
        [(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)]
            .map(|(x, y)| self.image_from_table(Vec2::new(x, y) * (self.side_m / 2.0)))
    }

    /// True position of every part, on the plate and in the picture.
    pub fn truth(&self) -> Vec<ScenePartTruth> {
        let ideal_from_table = self.ideal_from_table();
        let truth = |part: &SceneDisc| {
            let circles = self.seen_circles(part);
            let on_outline = |i: usize| {
                let (sin, cos) = (TAU * i as f64 / OUTLINE_POINTS as f64).sin_cos();
                let normal = Vec2::new(cos, sin);
                // The hull's farthest point along the normal.
                let [foot, top] = circles.map(|(center, radius)| center + radius * normal);
                let farthest = if top.dot(&normal) > foot.dot(&normal) { top } else { foot };
                self.lens.image_from_ideal(ideal_from_table.apply(farthest))
            };
            let (area_px2, center_px) = area_and_centre(&(0..OUTLINE_POINTS).map(on_outline).collect::<Vec<_>>());
            let radius_px = (area_px2 / std::f64::consts::PI).sqrt();
            ScenePartTruth { kind: part.kind, at_m: part.at_m, center_px, radius_px }
        };
        self.parts.iter().map(truth).collect()
    }

    /// A part's foot, and its top as projected on the plate's plane, by similar triangles from the camera's centre.
    pub(super) fn seen_circles(&self, part: &SceneDisc) -> [(Vec2, f64); 2] {
        let scale = self.camera_m.z / (self.camera_m.z - part.thickness_m);
        let below_camera = self.camera_m.xy();
        let top = below_camera + (part.at_m - below_camera) * scale;
        [(part.at_m, part.radius_m), (top, part.radius_m * scale)]
    }
}

/// Area and centroid of a polygon, by the shoelace formula about its first point.
fn area_and_centre(polygon: &[Vec2]) -> (f64, Vec2) {
    let Some(&origin) = polygon.first() else {
        return (0.0, Vec2::zeros());
    };
    let (mut twice, mut moment) = (0.0, Vec2::zeros());
    for (a, b) in polygon.iter().zip(polygon.iter().skip(1)) {
        let (a, b) = (a - origin, b - origin);
        let part = cross(a, b);
        twice += part;
        moment += (a + b) * part;
    }
    (twice.abs() / 2.0, origin + moment / (3.0 * twice))
}

#[cfg(test)]
mod tests {
    use super::super::testing::{PENNY_M, penny};
    use super::*;

    #[test]
    fn a_part_below_the_camera_shows_its_top() {
        let scene = Scene { parts: vec![penny(0.0, 0.0)], ..Scene::plain(0) };
        let truth = scene.truth()[0];
        assert!((truth.center_px - scene.image_from_table(Vec2::zeros())).norm() < 1e-9);
        let radius_px = 2520.0 * PENNY_M / (0.6 - 1.52e-3);
        assert!((truth.radius_px / radius_px - 1.0).abs() < 2e-5, "{} {radius_px}", truth.radius_px);
    }

    #[test]
    fn a_flat_part_off_the_axis_shows_the_centre_of_an_ellipse() {
        // The image of a circle in a tilted plane is an ellipse whose middle is not the image of the circle's.
        let mut scene = Scene::general(3);
        scene.lens.radial = [0.0; 2];
        scene.lens.tangential = [0.0; 2];
        scene.tilt_rad = [0.17, 0.0, 0.0];
        scene.parts = vec![SceneDisc::new(Vec2::new(0.05, 0.06), 0.03, 0.0)];
        let map = scene.ideal_from_table();
        let (h, c) = (map.matrix(), scene.parts[0].at_m);
        // Conic of the circle, mapped; its pole of the line at infinity is its centre (Hartley and Zisserman, ch. 2).
        let circle = Matrix3::new(1.0, 0.0, -c.x, 0.0, 1.0, -c.y, -c.x, -c.y, c.norm_squared() - 9e-4);
        let inverse = h.try_inverse().unwrap();
        let conic = inverse.transpose() * circle * inverse;
        let center = conic.try_inverse().unwrap().column(2).into_owned();
        let expected = Vec2::new(center.x / center.z, center.y / center.z);
        assert!((scene.truth()[0].center_px - expected).norm() < 1e-4);
        assert!((scene.image_from_table(c) - expected).norm() > 0.05);
    }
}
