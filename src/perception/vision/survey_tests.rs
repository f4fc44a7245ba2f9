//! Discs of any size in rendered pictures with known positions.

use super::{DetectedDisc, Table, locate_corners, locate_table, survey};
use upm_core::geometry::Vec2;
use upm_core::signal::Frame;
use upm_scene::testing::SIDE_M;
use upm_scene::{Scene, SceneDisc as Drawn};

/// Flat discs, one at each place, of these diameters, mm.
fn drawn(diameters_mm: &[f64]) -> Vec<Drawn> {
    let place = |i: usize| Vec2::new(-0.06 + 0.055 * (i % 3) as f64, 0.055 - 0.055 * (i / 3) as f64);
    diameters_mm.iter().enumerate().map(|(i, mm)| Drawn::new(place(i), mm * 5e-4, 0.0)).collect()
}

fn surveyed(scene: &Scene, frame: &Frame) -> Vec<DetectedDisc> {
    survey(frame, &locate_table(&scene.frame(), &scene.lens, SIDE_M).unwrap())
}

fn nearest(discs: &[DetectedDisc], at_m: Vec2) -> &DetectedDisc {
    discs.iter().min_by(|a, b| (a.at_m - at_m).norm().total_cmp(&(b.at_m - at_m).norm())).unwrap()
}

#[test]
fn discs_of_any_size_are_measured() {
    let discs = drawn(&[15.0, 13.5, 17.91, 19.05, 26.0, 31.0, 36.5, 12.0, 22.0]);
    for scene in [Scene::plain(3), Scene::general(11).rough(), Scene::general(12)] {
        let found = surveyed(&scene, &scene.frame_with(&discs));
        assert_eq!(found.len(), discs.len());
        for disc in &discs {
            let seen = nearest(&found, disc.at_m);
            assert!((seen.at_m - disc.at_m).norm() < 2e-4, "{seen:?}");
            assert!((seen.radius_m / disc.radius_m - 1.0).abs() < 0.02, "{seen:?}");
            assert!(seen.outline_share > 0.75 && seen.crispness > 0.4, "{seen:?}");
        }
    }
}

#[test]
fn bare_ruled_and_noisy_plates_have_no_discs() {
    for scene in [Scene::plain(1), Scene::general(2).rough()] {
        assert_eq!(surveyed(&scene, &scene.frame()), []);
    }
    assert_eq!(surveyed(&Scene::plain(1), &Frame::new(1, 1)), []);
    for pitch_m in [0.005, 0.01, 0.02, 0.03] {
        let (frame, table) = ruled(&Scene::plain(1), &[], pitch_m);
        assert_eq!(survey(&frame, &table), [], "squares of {pitch_m} m have tangents, but no arcs");
    }
}

/// The plate with dark lines in both directions below the discs, and where it is.
fn ruled(scene: &Scene, discs: &[Drawn], pitch_m: f64) -> (Frame, Table) {
    let (mut frame, table) = (scene.frame_with(discs), locate_table(&scene.frame(), &scene.lens, SIDE_M).unwrap());
    for i in 0..frame.pixels.len() {
        let at = table.table_from_image(Vec2::new((i % 1280) as f64, (i / 1280) as f64));
        let is_line = |x: f64| (x / pitch_m).fract().abs() * pitch_m < 8e-4;
        let is_covered = |disc: &Drawn| (disc.at_m - at).norm() < disc.radius_m;
        if table.holds(at, 0.0) && (is_line(at.x) || is_line(at.y)) && !discs.iter().any(is_covered) {
            frame.pixels[i] = 60;
        }
    }
    (frame, table)
}

#[test]
fn plate_and_discs_are_found_on_fine_rulings() {
    let discs = drawn(&[17.91, 19.05, 21.21, 24.26, 19.05, 17.91]);
    for pitch_m in [0.005, 0.008, 0.01] {
        let (frame, table) = ruled(&Scene::plain(5), &discs, pitch_m);
        let corners = locate_corners(&frame, 1.0, 50).unwrap();
        let off = |corner: &Vec2| table.corners_px.iter().map(|at| (at - corner).norm()).fold(f64::INFINITY, f64::min);
        // the next line is 20 px away; ends of lines at a side shift it a little
        assert!(corners.iter().all(|corner| off(corner) < 1.0), "{corners:?} {:?}", table.corners_px);
        let found = survey(&frame, &table);
        assert_eq!(found.len(), discs.len(), "{pitch_m} {found:?}");
        for disc in &discs {
            let seen = nearest(&found, disc.at_m);
            let off = [(seen.at_m - disc.at_m).norm() / disc.radius_m, (seen.radius_m / disc.radius_m - 1.0).abs()];
            assert!(off[0] < 0.03 && off[1] < 0.02, "{seen:?}");
        }
    }
}

#[test]
fn soft_blot_is_not_crisp() {
    let scene = Scene::plain(4);
    let mut frame = scene.frame();
    for (i, pixel) in frame.pixels.iter_mut().enumerate() {
        let off = (Vec2::new((i % 1280) as f64, (i / 1280) as f64) - Vec2::new(700.0, 480.0)).norm();
        let shade = 0.5 / (1.0 + ((off - 45.0) / 8.0).exp());
        *pixel = (f64::from(*pixel) * (1.0 - shade)) as u8;
    }
    let found = surveyed(&scene, &frame);
    assert!(found.iter().all(|disc| disc.crispness < 0.5), "{found:?}");
}
