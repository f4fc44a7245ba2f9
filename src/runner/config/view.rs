use nalgebra::{Rotation3, Vector3};

use upm_core::geometry::Vec2;
use upm_sim::CameraParams;

/// Least distance of the plate from the frame's edge, as a share of the frame's height.
pub const FRAME_MARGIN: f64 = 0.01;

/// Image position of the point `p_m` of the plate at rest, px; `None` if the point is not in front of the camera.
///
/// Without tilt the camera is aligned with image x along table x and image y against table y; the tilts then rotate it
/// about its x axis, its y axis and the optical axis, in that order, right-handed.
pub fn image_from_plate(camera: &CameraParams, p_m: Vec2) -> Option<Vec2> {
    let [about_x, about_y, about_axis] = camera.tilt_rad;
    let turned = Rotation3::from_axis_angle(&Vector3::x_axis(), about_x)
        * Rotation3::from_axis_angle(&Vector3::y_axis(), about_y)
        * Rotation3::from_axis_angle(&Vector3::z_axis(), about_axis);
    let from_camera = p_m.push(0.0) - camera.position_m;
    let seen = turned.inverse() * Vector3::new(from_camera.x, -from_camera.y, -from_camera.z);
    let lens = camera.lens();
    let ideal_px = lens.principal_px + lens.focal_px * seen.xy() / seen.z;
    (seen.z > 0.0).then(|| lens.image_from_ideal(ideal_px))
}

/// Corners of a square plate, m, clockwise from top left.
pub fn plate_corners_m(side_m: f64) -> [Vec2; 4] {
    let half = 0.5 * side_m;
    [Vec2::new(-half, half), Vec2::new(half, half), Vec2::new(half, -half), Vec2::new(-half, -half)]
}

/// Least distance of the plate's outline from the frame's edge, px; negative if it leaves the frame, `None` if part of
/// it is not in front of the camera.
pub fn margin_px(camera: &CameraParams, side_m: f64) -> Option<f64> {
    const STEPS: usize = 16;
    let corners = plate_corners_m(side_m);
    let [width, height] = camera.size_px.map(|size| size as f64);
    let mut least = f64::INFINITY;
    for (from, to) in corners.iter().zip(corners.iter().cycle().skip(1)) {
        for i in 0..STEPS {
            let p = image_from_plate(camera, from.lerp(to, i as f64 / STEPS as f64))?;
            least = least.min(p.x + 0.5).min(width - 0.5 - p.x).min(p.y + 0.5).min(height - 0.5 - p.y);
        }
    }
    least.is_finite().then_some(least)
}

/// Length of the plate's longest side in the image over that of its shortest; `None` if part of it is not in front of
/// the camera.
pub fn side_ratio(camera: &CameraParams, side_m: f64) -> Option<f64> {
    let [a, b, c, d] = plate_corners_m(side_m).map(|corner_m| image_from_plate(camera, corner_m));
    let corners = [a?, b?, c?, d?];
    let sides = corners.iter().zip(corners.iter().cycle().skip(1)).map(|(from, to)| (to - from).norm());
    let (shortest, longest) =
        sides.fold((f64::INFINITY, 0.0f64), |(least, most), side| (least.min(side), most.max(side)));
    Some(longest / shortest)
}

/// Least height, above the present one, at which the plate's outline is at least `least_px` inside the frame; `None` if
/// there is none up to ten times the present height.
pub fn least_height_m(camera: &CameraParams, side_m: f64, least_px: f64) -> Option<f64> {
    const HIGHEST: f64 = 10.0;
    const HALVINGS: usize = 40;
    let is_seen = |height_m: f64| {
        let [x_m, y_m, _] = camera.position_m.into();
        let raised = CameraParams { position_m: Vector3::new(x_m, y_m, height_m), ..*camera };
        margin_px(&raised, side_m).is_some_and(|margin_px| margin_px >= least_px)
    };
    let mut low_m = camera.position_m.z.max(0.5 * side_m);
    let mut high_m = HIGHEST * low_m;
    if !is_seen(high_m) {
        return None;
    }
    for _ in 0..HALVINGS {
        let middle_m = 0.5 * (low_m + high_m);
        if is_seen(middle_m) { high_m = middle_m } else { low_m = middle_m }
    }
    Some(high_m)
}

/// True if distortion is injective on the plate: the lens's map does not fold anywhere between the principal point and
/// the plate's outline.
pub fn is_one_to_one(camera: &CameraParams, side_m: f64) -> bool {
    const STEPS: usize = 32;
    let (lens, undistorted) = (camera.lens(), CameraParams { radial: [0.0; 2], tangential: [0.0; 2], ..*camera });
    plate_corners_m(side_m).into_iter().all(|corner_m| {
        let Some(corner_px) = image_from_plate(&undistorted, corner_m) else { return false };
        (0..=STEPS).all(|i| {
            let ideal_px = lens.principal_px.lerp(&corner_px, i as f64 / STEPS as f64);
            lens.jacobian_at_ideal(ideal_px).determinant() > 0.0
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(tilt_rad: [f64; 3]) -> CameraParams {
        CameraParams {
            size_px: [640, 480],
            frame_hz: 60.0,
            exposure_s: 0.004,
            focal_px: 1000.0,
            principal_px: None,
            radial: [0.0; 2],
            tangential: [0.0; 2],
            position_m: Vector3::new(0.01, -0.02, 0.5),
            tilt_rad,
            blur_px: 0.0,
            levels: [0.0, 255.0, 0.0],
            shading: 0.0,
            shading_direction_rad: 0.0,
            full_well_e: f64::INFINITY,
            read_noise: 0.0,
        }
    }

    #[test]
    fn an_untilted_camera_scales_and_flips() {
        let seen = image_from_plate(&camera([0.0; 3]), Vec2::new(0.03, 0.05)).unwrap();
        assert!((seen - Vec2::new(319.5 + 40.0, 239.5 - 140.0)).norm() < 1e-9);
    }

    #[test]
    fn tilts_move_the_picture_the_other_way() {
        let seen = |tilt| image_from_plate(&camera(tilt), Vec2::new(0.01, -0.02)).unwrap() - Vec2::new(319.5, 239.5);
        assert!(seen([0.0; 3]).norm() < 1e-9);
        assert!((seen([0.01, 0.0, 0.0]).y - 1000.0 * 0.01_f64.tan()).abs() < 1e-9);
        assert!((seen([0.0, 0.01, 0.0]).x + 1000.0 * 0.01_f64.tan()).abs() < 1e-9);
        let turned = image_from_plate(&camera([0.0, 0.0, 0.01]), Vec2::new(0.02, -0.02)).unwrap();
        assert!((turned - Vec2::new(319.5 + 20.0 * 0.01_f64.cos(), 239.5 - 20.0 * 0.01_f64.sin())).norm() < 1e-9);
        assert_eq!(image_from_plate(&camera([2.0, 0.0, 0.0]), Vec2::zeros()), None);
    }

    #[test]
    fn least_height_is_the_lowest_from_which_the_whole_plate_is_seen() {
        let camera = camera([0.03, -0.02, 0.1]);
        let height_m = least_height_m(&camera, 0.3, 5.0).unwrap();
        let margin_at = |height_m: f64| {
            let mut raised = camera;
            raised.position_m.z = height_m;
            margin_px(&raised, 0.3).unwrap()
        };
        assert!(margin_at(height_m) >= 5.0 && margin_at(0.999 * height_m) < 5.0, "{height_m} m");
        let mut aside = camera;
        aside.tilt_rad = [0.0, 0.6, 0.0];
        assert_eq!(least_height_m(&aside, 0.3, 5.0), None);
    }
}
