//! Detection of parts in rendered pictures with known positions.

use super::{CoinFinder, Detection, Table, locate_table};
use upm_core::geometry::Vec2;
use upm_core::rig::PartKind;
use upm_core::signal::Frame;
use upm_scene::testing::{PENNY_M, SIDE_M, penny};
use upm_scene::{Scene, SceneDisc};

fn kind(name: &str, diameter_mm: f64, thickness_mm: f64) -> PartKind {
    PartKind { name: name.into(), radius_m: diameter_mm * 5e-4, thickness_m: thickness_mm * 1e-3 }
}

fn pennies() -> Vec<PartKind> {
    vec![kind("penny", 19.05, 1.52)]
}

fn scattered() -> Vec<SceneDisc> {
    [(-0.0671, -0.0713), (0.0012, 0.0004), (0.0533, 0.0617), (-0.0481, 0.0557), (0.0729, -0.0391), (0.0203, -0.0684)]
        .map(|(x, y)| penny(x, y))
        .into()
}

fn table_of(scene: &Scene, discs: &[SceneDisc]) -> Table {
    locate_table(&scene.frame_with(discs), &scene.lens, SIDE_M).unwrap()
}

fn found(scene: &Scene, discs: &[SceneDisc], kinds: &[PartKind]) -> (Table, Vec<Detection>) {
    let table = table_of(scene, discs);
    let parts = CoinFinder::new(&table, scene.size_px, kinds, true).find(&scene.frame_with(discs));
    (table, parts)
}

fn nearest<'a>(parts: &'a [Detection], disc: &SceneDisc) -> &'a Detection {
    let off = |part: &Detection| (part.position_m - disc.at_m).norm();
    parts.iter().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap()
}

/// Root mean square error of positions over scenes, each axis, px and mm.
fn position_rms(scenes: &[Scene]) -> (f64, f64) {
    let discs = scattered();
    let (mut px, mut mm, mut n) = (0.0, 0.0, 0.0);
    for scene in scenes {
        let (table, parts) = found(scene, &discs, &pennies());
        assert_eq!(parts.len(), discs.len());
        for disc in &discs {
            let part = nearest(&parts, disc);
            let seen = table.image_from_table(part.position_m) - scene.image_from_table(disc.at_m);
            px += seen.norm_squared();
            mm += (part.position_m - disc.at_m).norm_squared() * 1e6;
            n += 2.0;
        }
    }
    ((px / n).sqrt(), (mm / n).sqrt())
}

#[test]
fn places_are_as_exact_as_asked() {
    let (clean, rough) = ([0, 1].map(Scene::general), [3, 4].map(|seed| Scene::general(seed).rough()));
    for (scenes, most_px, most_mm) in [(clean, 0.03, 0.01), (rough, 0.10, 0.025)] {
        let (px, mm) = position_rms(&scenes);
        assert!(px <= most_px && mm < most_mm, "{px} px {mm} mm rms an axis");
    }
}

#[test]
fn touching_parts_stay_apart() {
    // Seven in the closest packing: the middle one shows its rim only through six gaps.
    let mut discs = vec![penny(0.01, 0.02)];
    discs.extend((0..6).map(|k| {
        let (sin, cos) = (f64::from(k) * std::f64::consts::FRAC_PI_3 + 0.1).sin_cos();
        penny(0.01 + 2.0 * PENNY_M * cos, 0.02 + 2.0 * PENNY_M * sin)
    }));
    for scene in [Scene::plain(1), Scene::plain(2).rough()] {
        let (_, parts) = found(&scene, &discs, &pennies());
        assert_eq!(parts.len(), 7);
        for disc in &discs {
            let off_mm = (nearest(&parts, disc).position_m - disc.at_m).norm() * 1e3;
            assert!(off_mm < 0.06, "{off_mm} mm");
        }
    }
}

#[test]
fn parts_at_the_edge_are_found() {
    let edge = SIDE_M / 2.0;
    let discs = [
        penny(edge - PENNY_M - 1e-4, 0.03),
        penny(-0.02, -edge + PENNY_M * 0.85),
        penny(-edge + PENNY_M + 0.0008, edge - PENNY_M - 0.0005),
    ];
    for scene in [Scene::plain(1), Scene::general(2).rough()] {
        let (_, parts) = found(&scene, &discs, &pennies());
        assert_eq!(parts.len(), 3);
        for disc in &discs {
            let off_mm = (nearest(&parts, disc).position_m - disc.at_m).norm() * 1e3;
            assert!(off_mm < 0.06, "{off_mm} mm at {:?}", disc.at_m);
        }
    }
}

#[test]
fn kinds_are_distinguished_by_their_rims() {
    let kinds = [("penny", 19.05, 1.52), ("nickel", 21.21, 1.95), ("dime", 17.91, 1.35), ("quarter", 24.26, 1.75)];
    let kinds = kinds.map(|(name, diameter_mm, thickness_mm)| kind(name, diameter_mm, thickness_mm));
    let (xs, ys) =
        ([-0.06, 0.0, 0.06, -0.06, 0.0, 0.0225, 0.06, -0.03], [0.06, 0.06, 0.06, -0.01, -0.01, -0.01, -0.06, -0.06]);
    let disc = |i: usize| SceneDisc::new(Vec2::new(xs[i], ys[i]), kinds[i % 4].radius_m, kinds[i % 4].thickness_m);
    let discs: Vec<SceneDisc> = (0..8).map(disc).collect();
    let (_, parts) = found(&Scene::general(9).rough(), &discs, &kinds);
    assert_eq!(parts.len(), discs.len());
    for (i, disc) in discs.iter().enumerate() {
        let part = nearest(&parts, disc);
        assert_eq!(part.kind, i % 4);
        let off_mm = (part.position_m - disc.at_m).norm() * 1e3;
        assert!(off_mm < 0.04, "{off_mm} mm, kind {}", part.kind);
    }
}

#[test]
fn light_parts_on_a_gray_plate() {
    let scene = Scene { levels: [15.0, 110.0, 240.0], ..Scene::general(3).rough() };
    let discs = scattered();
    let table = table_of(&scene, &discs);
    let parts = CoinFinder::new(&table, scene.size_px, &pennies(), false).find(&scene.frame_with(&discs));
    assert_eq!(parts.len(), discs.len());
    assert!(discs.iter().all(|disc| (nearest(&parts, disc).position_m - disc.at_m).norm() < 6e-5));
}

#[test]
fn blots_bare_plates_and_odd_frames_give_no_parts() {
    let blots =
        [SceneDisc::new(Vec2::new(0.03, 0.03), 0.025, 0.0), SceneDisc::new(Vec2::new(-0.04, -0.03), 0.006, 0.0)];
    for scene in [Scene::plain(1), Scene::general(2).rough()] {
        let table = table_of(&scene, &[]);
        let mut finder = CoinFinder::new(&table, scene.size_px, &pennies(), true);
        assert_eq!(finder.find(&scene.frame()), []);
        assert_eq!(finder.find(&scene.frame_with(&blots)), []);
        assert_eq!(finder.find(&Frame::new(3, 3)), []);
        assert_eq!(finder.find(&Frame::new(1280, 1024)), []);
    }
}
