//! Location of rendered tables with known corners.

use super::{Table, TableError, focal_from_corners, locate_corners, locate_table};
use nalgebra::Vector3;
use proptest::prelude::*;
use upm_core::geometry::{Lens, Vec2};
use upm_core::random::Streams;
use upm_core::signal::Frame;
use upm_scene::Scene;
use upm_scene::testing::{SIDE_M, penny};

fn located(scene: &Scene, frame: &Frame) -> Result<Table, TableError> {
    locate_table(frame, &scene.lens, SIDE_M)
}

/// Root mean square error of the corners over scenes, px.
fn corner_rms_px(scenes: &[Scene]) -> f64 {
    let mut sum = 0.0;
    for scene in scenes {
        let frame = scene.frame_with(&[penny(0.02, -0.03), penny(-0.06, 0.05), penny(0.094, 0.01)]);
        let table = located(scene, &frame).unwrap();
        let errors = table.corners_px.iter().zip(scene.corners_px()).map(|(a, b)| (a - b).norm_squared());
        sum += errors.sum::<f64>() / 4.0;
    }
    (sum / scenes.len() as f64).sqrt()
}

#[test]
fn corners_are_as_exact_as_asked() {
    let (clean, rough) = ([0, 1, 2].map(Scene::general), [4, 5, 6].map(|seed| Scene::general(seed).rough()));
    for (scenes, most_px) in [(clean, 0.05), (rough, 0.15)] {
        let rms = corner_rms_px(&scenes);
        assert!(rms <= most_px, "{rms} px");
    }
}

#[test]
fn frame_scale_and_camera_agree_with_the_scene() {
    let scene = Scene::general(11);
    let table = located(&scene, &scene.frame()).unwrap();
    for p in [(0.0, 0.0), (0.09, -0.08), (-0.07, 0.05)].map(|(x, y)| Vec2::new(x, y)) {
        let off_px = (table.image_from_table(p) - scene.image_from_table(p)).norm();
        assert!(off_px < 0.05, "{off_px} px");
        assert!((table.table_from_image(table.image_from_table(p)) - p).norm() < 1e-9);
        let step = Vec2::new(1e-4, 0.0);
        let x = table.image_from_table(p + step) - table.image_from_table(p);
        let y = table.image_from_table(p + Vec2::new(0.0, 1e-4)) - table.image_from_table(p);
        let scale = (x.x * y.y - x.y * y.x).abs().sqrt() * 1e4;
        assert!((table.px_per_m_at(p) / scale - 1.0).abs() < 1e-3);
    }
    assert!((table.camera_in_table_m - scene.camera_m).norm() < 2e-3, "{}", table.camera_in_table_m - scene.camera_m);
}

#[test]
fn any_turn_gives_an_upright_frame() {
    for degrees in [-170.0, -44.0, 46.0, 95.0f64] {
        let mut scene = Scene::plain(0);
        scene.tilt_rad[2] = degrees.to_radians();
        scene.camera_m.z = 0.85;
        let table = located(&scene, &scene.frame()).unwrap();
        assert!(table.rotation_rad.abs() <= std::f64::consts::FRAC_PI_4 + 1e-6);
        let off = (degrees.to_radians() + table.rotation_rad) / std::f64::consts::FRAC_PI_2;
        assert!((off - off.round()).abs() < 1e-3, "{degrees}: {}", table.rotation_rad.to_degrees());
        let [a, b, c, _] = table.corners_px;
        assert!(b.x > a.x && c.y > b.y, "clockwise from top left");
    }
}

#[test]
fn a_partly_hidden_side_is_still_found() {
    let scene = Scene::general(2).rough();
    let mut frame = scene.frame_with(&[penny(0.03, 0.03)]);
    let [a, b, _, _] = scene.corners_px();
    let (from, to) = (a + (b - a) * 0.3, a + (b - a) * 0.6);
    for y in 0..(from.y.max(to.y) as usize + 60) {
        frame.pixels[y * 1280 + from.x as usize..y * 1280 + to.x as usize].fill(120);
    }
    let table = located(&scene, &frame).unwrap();
    for (seen, truth) in table.corners_px.iter().zip(scene.corners_px()) {
        assert!((seen - truth).norm() < 0.25, "{}", seen - truth);
    }
}

#[test]
fn table_is_found_under_strong_shading() {
    let scene = Scene { shading: 0.5, noise_sd: 8.0, ..Scene::general(3) };
    assert!(located(&scene, &scene.frame_with(&[penny(0.05, 0.0)])).is_ok());
}

#[test]
fn focal_length_follows_from_a_tilted_square() {
    for (focal_sides, tilt_deg) in [(0.6, 8.0), (0.6, 22.0), (1.2, 15.0), (4.0, 22.0f64)] {
        let mut scene = Scene::plain(2);
        let [width, height] = scene.size_px;
        scene.lens = Lens::centered([width, height], focal_sides);
        scene.tilt_rad = [tilt_deg.to_radians(), 0.0, 0.3];
        let far = 1.6 * SIDE_M * scene.lens.focal_px / height as f64;
        scene.camera_m = Vector3::new(0.0, far * scene.tilt_rad[0].sin(), far * scene.tilt_rad[0].cos());
        let corners = locate_corners(&scene.frame(), 1.0, 100).unwrap();
        let (focal_px, share) = focal_from_corners(corners, 1.0, [1000.0, 0.15], &scene.lens).unwrap();
        let off = focal_px / scene.lens.focal_px - 1.0;
        assert!(off.abs() < 0.05 && share > 0.9, "{focal_sides} widths at {tilt_deg}: {off}, {share}");
    }
}

fn fault(frame: &Frame) -> TableError {
    let size = Vec2::new(frame.width as f64, frame.height as f64);
    let lens = Lens::ideal(1.2 * size.amax().max(1.0), (size - Vec2::repeat(1.0)) / 2.0);
    locate_table(frame, &lens, SIDE_M).unwrap_err()
}

fn noise(width: usize, height: usize, seed: u64) -> Frame {
    let mut frame = Frame::new(width, height);
    let mut rng = Streams::new(seed).stream("noise");
    frame.pixels.fill_with(|| rng.next_u64() as u8);
    frame
}

#[test]
fn without_a_table_there_is_a_fault() {
    let mut white = Frame::new(640, 480);
    white.pixels.fill(255);
    let mut lying = Frame::new(64, 64);
    lying.pixels.pop();
    assert_eq!(fault(&Frame::new(640, 480)), TableError::NoEdges);
    assert_eq!(fault(&white), TableError::NoEdges);
    assert_eq!(fault(&noise(640, 480, 1)), TableError::NoEdges);
    assert_eq!(fault(&Frame::new(1, 1)), TableError::TooSmall { width: 1, height: 1 });
    assert_eq!(fault(&lying), TableError::Malformed { width: 64, height: 64, pixels: 4095 });
    assert_eq!(fault(&Frame::new(20_000, 40)), TableError::NoEdges);
    assert_eq!(fault(&Frame::new(9_000, 8_000)), TableError::TooLarge { width: 9_000, height: 8_000 });
}

#[test]
fn a_table_that_leaves_the_picture_is_reported() {
    for shift in [Vec2::new(140.0, 0.0), Vec2::new(260.0, 0.0), Vec2::new(0.0, -120.0), Vec2::new(300.0, 200.0)] {
        let mut scene = Scene::plain(1);
        scene.size_px = [1000, 960];
        scene.lens.principal_px = Vec2::new(499.5, 479.5) + shift;
        assert_eq!(located(&scene, &scene.frame()), Err(TableError::CutByFrame), "{shift}");
    }
}

#[test]
fn two_tables_are_one_too_many() {
    let mut scene = Scene::plain(1);
    scene.camera_m.z = 1.2;
    scene.lens.principal_px = Vec2::new(300.0, 400.0);
    let mut frame = scene.frame();
    scene.lens.principal_px = Vec2::new(900.0, 480.0);
    for (pixel, other) in frame.pixels.iter_mut().zip(scene.frame().pixels) {
        *pixel = (*pixel).max(other);
    }
    assert_eq!(fault(&frame), TableError::MoreThanOne);
}

#[test]
fn oblong_is_no_square_but_a_rectangle() {
    let mut frame = Frame::new(800, 600);
    for y in 150..450 {
        frame.pixels[y * 800 + 100..y * 800 + 700].fill(220);
    }
    let wanted = "and left are 2.00 to 1 (most 1.4)";
    assert!(fault(&frame).to_string().contains(wanted), "{}", fault(&frame));
    assert!(locate_corners(&frame, 0.5, 100).is_ok());
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn no_picture_breaks_it(width in 1usize..200, height in 1usize..200, seed in 0u64..1000, blocks in 1usize..5, side in 1e-3..10.0f64) {
        // Random bright and dark rectangles, some noise.
        let mut frame = noise(width, height, seed);
        frame.pixels.iter_mut().for_each(|p| *p /= 16);
        let mut rng = Streams::new(seed).stream("blocks");
        for _ in 0..blocks {
            let mut draw = |n: usize| (rng.next_u64() % n as u64) as usize;
            let (x, y) = (draw(width), draw(height));
            let (right, bottom) = (x + draw(width - x) + 1, y + draw(height - y) + 1);
            let level = draw(240) as u8;
            for row in y..bottom {
                frame.pixels[row * width + x..row * width + right].iter_mut().for_each(|p| *p = level.saturating_add(*p));
            }
        }
        let lens = Lens { radial: [-0.3, 0.1], ..Lens::ideal(150.0, Vec2::new(90.0, 70.0)) };
        if let Ok(table) = locate_table(&frame, &lens, side) {
            prop_assert!(table.corners_px.iter().all(|c| c.x.is_finite() && c.y.is_finite()));
            prop_assert!(table.camera_in_table_m.iter().all(|c| c.is_finite()));
        }
    }
}
