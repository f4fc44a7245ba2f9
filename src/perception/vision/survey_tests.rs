//! Discs of any size in rendered pictures with known positions.

use super::{DetectedDisc, Detection, Survey, locate_table, survey};
use upm_core::geometry::Vec2;
use upm_core::signal::Frame;
use upm_scene::testing::SIDE_M;
use upm_scene::{Scene, SceneDisc as Drawn};

/// Flat discs, one at each place, of these diameters, mm.
fn drawn(diameters_mm: &[f64]) -> Vec<Drawn> {
    let place = |i: usize| Vec2::new(-0.06 + 0.055 * (i % 3) as f64, 0.055 - 0.055 * (i / 3) as f64);
    diameters_mm.iter().enumerate().map(|(i, mm)| Drawn::new(place(i), mm * 5e-4, 0.0)).collect()
}

fn surveyed(scene: &Scene, frame: &Frame, known: &[Detection]) -> Survey {
    survey(frame, &locate_table(&scene.frame(), &scene.lens, SIDE_M).unwrap(), known)
}

fn nearest(discs: &[DetectedDisc], at_m: Vec2) -> &DetectedDisc {
    discs.iter().min_by(|a, b| (a.at_m - at_m).norm().total_cmp(&(b.at_m - at_m).norm())).unwrap()
}

#[test]
fn discs_of_any_size_are_measured() {
    let discs = drawn(&[9.0, 13.5, 17.91, 19.05, 26.0, 31.0, 36.5, 12.0, 22.0]);
    for scene in [Scene::plain(3), Scene::general(11).rough(), Scene::general(12)] {
        let found = surveyed(&scene, &scene.frame_with(&discs), &[]).discs;
        assert_eq!(found.len(), discs.len());
        for disc in &discs {
            let seen = nearest(&found, disc.at_m);
            assert!((seen.at_m - disc.at_m).norm() < 2e-4, "{seen:?}");
            assert!((seen.radius_m / disc.radius_m - 1.0).abs() < 0.02, "{seen:?}");
            assert!(seen.outline_share > 0.85 && seen.crispness > 0.45 && seen.level < 0.3, "{seen:?}");
        }
    }
}

#[test]
fn bare_plates_and_noise_have_no_discs() {
    for scene in [Scene::plain(1), Scene::general(2).rough()] {
        let found = surveyed(&scene, &scene.frame(), &[]);
        assert!(found.discs.is_empty(), "{found:?}");
        assert!(found.darkest > 0.85 && found.lightest < 1.15, "{found:?}");
    }
    assert_eq!(surveyed(&Scene::plain(1), &Frame::new(1, 1), &[]), Survey::default());
}

#[test]
fn soft_blot_is_not_crisp_and_dims_the_darkest_place() {
    let scene = Scene::plain(4);
    let mut frame = scene.frame();
    for (i, pixel) in frame.pixels.iter_mut().enumerate() {
        let off = (Vec2::new((i % 1280) as f64, (i / 1280) as f64) - Vec2::new(700.0, 480.0)).norm();
        let shade = 0.5 / (1.0 + ((off - 45.0) / 8.0).exp());
        *pixel = (f64::from(*pixel) * (1.0 - shade)) as u8;
    }
    let found = surveyed(&scene, &frame, &[]);
    assert!(found.discs.iter().all(|disc| disc.crispness < 0.5), "{found:?}");
    assert!(found.darkest < 0.6, "{found:?}");
}

#[test]
fn outline_covered_over_a_third_shows_the_rest() {
    let scene = Scene::plain(5);
    let disc = drawn(&[24.26]);
    let mut frame = scene.frame_with(&disc);
    let whole = surveyed(&scene, &frame, &[]).discs[0].clone();
    let plate = frame.row(whole.center_px.y as usize)[(whole.center_px.x + 2.0 * whole.radius_px) as usize];
    let width = frame.width;
    for (i, pixel) in frame.pixels.iter_mut().enumerate() {
        let off = Vec2::new((i % width) as f64, (i / width) as f64) - whole.center_px;
        if off.x > 0.6 * whole.radius_px && off.norm() < 1.2 * whole.radius_px {
            *pixel = plate;
        }
    }
    let part = Detection {
        kind: 0,
        center_px: whole.center_px,
        radius_px: whole.radius_px,
        position_m: whole.at_m,
        score: 1.0,
        covariance_px2: whole.covariance_px2,
    };
    let covered = surveyed(&scene, &frame, &[part]).discs;
    assert!(whole.outline_share > 0.95 && covered[0].outline_share < 0.8, "{whole:?} {covered:?}");
}
