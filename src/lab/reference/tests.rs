//! The fast path against the reference, in rendered scenes of several seeds.

use super::{find_parts, locate_table};
use upm_core::rig::PartKind;
use upm_perception::vision::{self, CoinFinder, Detection};
use upm_scene::testing::{PENNY_M, SIDE_M, penny};
use upm_scene::{Scene, SceneDisc};

/// Largest distance of the reference's corners from the fast path's, and of its parts, px.
const CORNER_PX: f64 = 0.6;
const PART_PX: f64 = 0.4;

fn pennies() -> Vec<PartKind> {
    vec![PartKind { name: "penny".into(), radius_m: PENNY_M, thickness_m: 1.52e-3 }]
}

fn scattered() -> Vec<SceneDisc> {
    [(-0.0671, -0.0713), (0.0012, 0.0004), (0.0533, 0.0617), (-0.0481, 0.0557), (0.0729, -0.0391), (0.0203, -0.0684)]
        .map(|(x, y)| penny(x, y))
        .into()
}

/// Largest distance of the reference from the fast path: corners, parts, px; parts in mm of the plate.
fn differences(scene: &Scene, discs: &[SceneDisc]) -> [f64; 3] {
    let frame = scene.frame_with(discs);
    let table = vision::locate_table(&frame, &scene.lens, SIDE_M).unwrap();
    let parts = CoinFinder::new(&table, scene.size_px, &pennies(), true).find(&frame);
    let view = locate_table(&frame, &scene.lens, SIDE_M).unwrap();
    let found = find_parts(&view, &pennies(), true);
    assert_eq!((parts.len(), found.len()), (discs.len(), discs.len()), "parts, fast and reference");
    let corners = table.corners_px.iter().zip(&view.table.corners_px).map(|(a, b)| (a - b).norm());
    let nearest = |part: &Detection| {
        let off = |other: &&Detection| (other.center_px - part.center_px).norm();
        found.iter().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap()
    };
    let px = parts.iter().map(|part| (nearest(part).center_px - part.center_px).norm());
    let mm = parts.iter().map(|part| (nearest(part).position_m - part.position_m).norm() * 1e3);
    [corners.fold(0.0, f64::max), px.fold(0.0, f64::max), mm.fold(0.0, f64::max)]
}

#[test]
fn fast_path_agrees_with_the_reference() {
    let clean = (0..1).map(|seed| (format!("clean {seed}"), Scene::general(seed)));
    let rough = (4..5).map(|seed| (format!("rough {seed}"), Scene::general(seed).rough()));
    let plain = [("plain".to_owned(), Scene::plain(1))];
    for (name, scene) in clean.chain(rough).chain(plain) {
        let [corner_px, part_px, part_mm] = differences(&scene, &scattered());
        eprintln!("{name}: corners {corner_px:.3} px, parts {part_px:.3} px, {part_mm:.3} mm");
        assert!(
            corner_px < CORNER_PX && part_px < PART_PX && part_mm < 0.25,
            "{name}: {corner_px} {part_px} {part_mm}"
        );
    }
}

#[test]
fn touching_parts_stay_apart_in_both() {
    let discs: Vec<SceneDisc> =
        [(0.0, 0.0), (2.0 * PENNY_M, 0.0), (0.0, 2.0 * PENNY_M)].map(|(x, y)| penny(x, y)).into();
    let [_, part_px, _] = differences(&Scene::plain(2), &discs);
    assert!(part_px < PART_PX, "{part_px}");
}
