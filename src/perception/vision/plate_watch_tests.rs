//! Foreign objects on rendered plates besides the tracked parts.

use super::{Detection, PlateOccupancy, PlateWatch, Table, Track};
use nalgebra::Matrix2;
use proptest::prelude::*;
use rand::RngExt;
use upm_core::geometry::Vec2;
use upm_core::random::{Rng, Streams};
use upm_core::rig::PartKind;
use upm_core::signal::Frame;
use upm_scene::testing::{PENNY_M, SIDE_M, penny};
use upm_scene::{ClutterOutline, ClutterShape, Scene, SceneDisc};

const QUARTER_M: f64 = 12.13e-3;

fn kinds() -> Vec<PartKind> {
    [("penny", PENNY_M, 1.52e-3), ("quarter", QUARTER_M, 1.75e-3)]
        .map(|(name, radius_m, thickness_m)| PartKind { name: name.into(), radius_m, thickness_m })
        .into()
}

fn table(scene: &Scene) -> Table {
    let corners = scene.corners_px().map(|corner| scene.lens.ideal_from_image(corner));
    Table::from_ideal_corners(corners, SIDE_M, &scene.lens).unwrap()
}

fn watch(scene: &Scene) -> PlateWatch {
    PlateWatch::new(&table(scene), scene.size_px, &kinds(), scene.dark_parts())
}

/// A track whose last detection is `disc`.
fn track(disc: &SceneDisc, frames_unseen: u32) -> Track {
    let seen = Detection {
        kind: usize::from(disc.radius_m > 0.011),
        center_px: Vec2::zeros(),
        radius_px: 40.0,
        position_m: disc.at_m,
        score: 1.0,
        covariance_px2: Matrix2::zeros(),
    };
    Track { seen, frames_unseen }
}

fn tracks(discs: &[SceneDisc]) -> Vec<Track> {
    discs.iter().map(|disc| track(disc, 0)).collect()
}

/// A disc `margin_m` or more within the edge and at least as far from all others, outline to outline.
fn place(dice: &mut Rng, others: &[SceneDisc], radius_m: f64, margin_m: f64) -> SceneDisc {
    let reach_m = SIDE_M / 2.0 - radius_m - margin_m;
    let draw = |_| {
        SceneDisc::new(
            Vec2::new(dice.random_range(-1.0..1.0), dice.random_range(-1.0..1.0)) * reach_m,
            radius_m,
            1.6e-3,
        )
    };
    let free = |disc: &SceneDisc| {
        others.iter().all(|other| (other.at_m - disc.at_m).norm() > other.radius_m + radius_m + margin_m)
    };
    (0..10_000).map(draw).find(free).unwrap()
}

/// Pennies and quarters.
fn scattered(dice: &mut Rng, count: usize) -> Vec<SceneDisc> {
    let mut discs = Vec::new();
    for i in 0..count {
        let next = place(dice, &discs, [PENNY_M, QUARTER_M][i % 2], 1e-4);
        discs.push(next);
    }
    discs
}

fn lit(mut frame: Frame, factor: f64) -> Frame {
    frame.pixels.iter_mut().for_each(|pixel| *pixel = (f64::from(*pixel) * factor).round().min(255.0) as u8);
    frame
}

fn shot(scene: &Scene, seed: u64, discs: &[SceneDisc]) -> Frame {
    Scene { seed, ..scene.clone() }.frame_with(discs)
}

fn is_clear(sight: &PlateOccupancy) -> bool {
    !sight.dark && sight.foreign_m.is_empty() && sight.hidden_share == 0.0
}

#[test]
fn foreign_penny_is_reported_in_every_frame() {
    for seed in 0..6 {
        let scene = Scene { noise_sd: 2.5, shading: 0.3, ..Scene::general(seed) };
        let mut dice = Streams::new(seed).stream("places");
        let discs = scattered(&mut dice, 8);
        let mut watch = watch(&scene);
        for k in 0..4 {
            assert!(is_clear(&watch.check(&shot(&scene, 10 + k, &discs), &tracks(&discs))), "seed {seed}, {k}");
            let foreign = place(&mut dice, &discs, PENNY_M, PENNY_M);
            let mut all = discs.clone();
            all.push(foreign.clone());
            let sight = watch.check(&shot(&scene, 100 + k, &all), &tracks(&discs));
            assert_eq!((sight.foreign_m.len(), sight.hidden_share, sight.dark), (1, 0.0, false), "seed {seed}, {k}");
            let off_mm = (sight.foreign_m[0] - foreign.at_m).norm() * 1e3;
            assert!(off_mm < 2.0, "seed {seed}, {k}: {off_mm} mm off");
        }
    }
}

#[test]
fn foreign_parts_of_the_first_frame_are_reported() {
    let scene = Scene { noise_sd: 2.5, ..Scene::general(2) };
    let discs = [penny(0.0, 0.0), penny(0.05, 0.05), penny(-0.05, 0.02)];
    let mut watch = watch(&scene);
    for _ in 0..3 {
        assert_eq!(watch.check(&scene.frame_with(&discs), &tracks(&discs[..1])).foreign_m.len(), 2);
    }
}

#[test]
fn plate_under_a_part_that_moved_away_is_watched() {
    let scene = Scene { noise_sd: 2.5, shading: 0.3, ..Scene::general(4) };
    let (before, after) = ([penny(-0.03, 0.02)], [penny(0.04, -0.03)]);
    let mut watch = watch(&scene);
    assert!(is_clear(&watch.check(&shot(&scene, 1, &before), &tracks(&before))));
    assert!(is_clear(&watch.check(&shot(&scene, 2, &after), &tracks(&after))));
    let both = [before[0].clone(), after[0].clone()];
    let sight = watch.check(&shot(&scene, 3, &both), &tracks(&after));
    assert!((sight.foreign_m[0] - before[0].at_m).norm() < 2e-3);
}

#[test]
fn last_place_of_an_unseen_part_is_excused() {
    let scene = Scene { noise_sd: 2.5, ..Scene::general(5) };
    let discs = [penny(-0.03, 0.02), penny(0.04, -0.03)];
    let mut watch = watch(&scene);
    let seen = [track(&discs[0], 0), track(&discs[1], 3)];
    assert!(is_clear(&watch.check(&scene.frame_with(&discs), &seen)));
    assert!(is_clear(&watch.check(&scene.frame_with(&discs[..1]), &seen)));
    // Slipped from where it was last seen: something is there, but no foreign part.
    let slipped = [discs[0].clone(), penny(0.051, -0.03)];
    let sight = watch.check(&scene.frame_with(&slipped), &seen);
    assert!(sight.foreign_m.is_empty() && sight.hidden_share > 0.0, "{sight:?}");
}

/// The tracks while `cover` hides some of the parts.
fn tracks_behind(discs: &[SceneDisc], cover: &ClutterOutline) -> Vec<Track> {
    discs.iter().map(|disc| track(disc, u32::from(cover.depth(disc.at_m) > -0.3 * disc.radius_m))).collect()
}

#[test]
fn hand_and_arm_hide_the_plate_and_are_not_reported_as_parts() {
    const LEVELS: [f64; 5] = [15.0, 40.0, 90.0, 130.0, 255.0];
    for (seed, level) in (0..).zip(LEVELS) {
        let scene = Scene { noise_sd: 2.5, shading: 0.2, ..Scene::general(seed) };
        let mut dice = Streams::new(seed).stream("places");
        let discs = scattered(&mut dice, 10);
        let mut watch = watch(&scene);
        watch.check(&shot(&scene, 50, &discs), &tracks(&discs));
        // each level in its share of the poses, which lie all around
        for k in (seed as i32..40).step_by(LEVELS.len()) {
            let (sin, cos) = (f64::from(k) * 0.8).sin_cos();
            let (out, side) = (Vec2::new(cos, sin), Vec2::new(-sin, cos));
            let palm = ClutterOutline::rectangle(out * (SIDE_M * 0.68), [SIDE_M / 2.0, SIDE_M], 0.8 * f64::from(k));
            let tip = out * (0.01 * f64::from(k % 8)) + side * (0.008 * f64::from((k / 5 + k) % 5));
            let arm = ClutterOutline::capsule(tip, tip + out * 0.4, 0.03);
            for (shape, least) in [(palm, 0.15), (arm, 0.05)] {
                let tracks = tracks_behind(&discs, &shape);
                let covered = Scene { occluders: vec![ClutterShape { shape, level }], ..scene.clone() };
                let sight = watch.check(&shot(&covered, 60 + k as u64, &discs), &tracks);
                assert!(sight.foreign_m.is_empty() && !sight.dark, "level {level}, {k}: {sight:?}");
                assert!(sight.hidden_share > least, "level {level}, {k}: {sight:?}");
            }
        }
        assert!(is_clear(&watch.check(&shot(&scene, 90, &discs), &tracks(&discs))), "level {level}");
    }
}

#[test]
fn swung_plate_shows_foreign_parts_and_no_others() {
    let scene = Scene { noise_sd: 2.5, shading: 0.2, ..Scene::general(3) };
    let discs = scattered(&mut Streams::new(3).stream("places"), 10);
    let table = table(&scene);
    let mut watch = watch(&scene);
    watch.check(&shot(&scene, 50, &discs), &tracks(&discs));
    for swing_px in [[9.0, -4.0], [-6.0, 11.0]].map(Vec2::from) {
        let mut swung = scene.clone();
        swung.lens.principal_px += table.in_picture(swing_px.push(0.0)).xy();
        let swing_m = swing_px / table.mean_px_per_m();
        // all but one are parts, tracked where they are seen
        let seen: Vec<SceneDisc> = discs.iter().map(|d| SceneDisc { at_m: d.at_m + swing_m, ..d.clone() }).collect();
        let frame = shot(&swung, 60, &discs);
        assert!(is_clear(&watch.check_swung(&frame, &tracks(&seen), swing_px.push(0.0))), "{swing_px:?}");
        let sight = watch.check_swung(&frame, &tracks(&seen[1..]), swing_px.push(0.0));
        let is_there = sight.foreign_m.iter().any(|at_m| (at_m - discs[0].at_m).norm() < PENNY_M);
        assert!(is_there && sight.foreign_m.len() == 1, "{swing_px:?}: {sight:?}");
    }
}

#[test]
fn frames_that_show_no_plate_are_dark_and_not_learned_from() {
    let scene = Scene { noise_sd: 2.5, ..Scene::general(6) };
    let discs = [penny(0.0, 0.0), penny(0.05, 0.05)];
    let mut watch = watch(&scene);
    let black = Frame::new(1280, 1024);
    let mut garbage = black.clone();
    let mut rng = Streams::new(1).stream("garbage");
    garbage.pixels.fill_with(|| rng.random());
    let none = [black.clone(), garbage, Frame::new(640, 512), Frame::new(1, 1), Frame::new(0, 0)];
    for _ in 0..2 {
        for frame in &none {
            assert_eq!(watch.check(frame, &[]), PlateOccupancy { foreign_m: &[], hidden_share: 0.0, dark: true });
        }
        assert!(is_clear(&watch.check(&scene.frame_with(&discs), &tracks(&discs))));
        assert_eq!(watch.check(&scene.frame_with(&discs), &tracks(&discs[..1])).foreign_m.len(), 1);
    }
}

#[test]
fn white_foreign_part_on_a_dark_plate_is_reported() {
    let scene = Scene { levels: [15.0, 60.0, 200.0], noise_sd: 2.5, ..Scene::general(7) };
    let discs = [penny(0.0, 0.0), penny(0.05, 0.05)];
    let mut watch = watch(&scene);
    assert!(is_clear(&watch.check(&scene.frame_with(&discs), &tracks(&discs))));
    assert_eq!(watch.check(&scene.frame_with(&discs), &tracks(&discs[..1])).foreign_m.len(), 1);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 8, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn healthy_frames_show_nothing_foreign(
        seed in 0u64..10_000, lights in proptest::array::uniform4(0.1..1.5f64), shading in 0.0..0.4f64, rough in any::<bool>(),
    ) {
        let scene = Scene::general(seed % 100);
        let scene = if rough { Scene { shading, ..scene.rough() } } else { Scene { shading, noise_sd: 2.5, ..scene } };
        let mut dice = Streams::new(seed).stream("places");
        let mut watch = watch(&scene);
        for (k, light) in (0..).zip(lights) {
            let discs = scattered(&mut dice, 12);
            let mut tracks = tracks(&discs);
            tracks.iter_mut().step_by(5).for_each(|track| track.frames_unseen = 2);
            let light = if rough { 0.5 + 0.4 * light } else { light };
            let sight = watch.check(&lit(shot(&scene, seed + k, &discs), light), &tracks);
            prop_assert!(is_clear(&sight), "light {}: {:?}", light, sight);
            let foreign = place(&mut dice, &discs, PENNY_M, 0.8 * PENNY_M);
            let all = [discs.as_slice(), &[foreign]].concat();
            let sight = watch.check(&lit(shot(&scene, seed + k, &all), light), &tracks);
            prop_assert!(sight.foreign_m.len() == 1, "light {}: {:?}", light, sight);
        }
    }
}
