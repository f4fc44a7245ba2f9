//! Tracking of parts in rendered sequences.

use super::{CoinFinder, Detection, PlateWatch, Table, TableWatch, Track, Tracker, locate_table};
use proptest::prelude::*;
use upm_core::geometry::Lens;
use upm_core::geometry::Vec2;
use upm_core::random::Streams;
use upm_core::rig::PartKind;
use upm_core::signal::{Frame, MeasuredDisc, MeasuredPositions};
use upm_scene::testing::{PENNY_M, SIDE_M, penny};
use upm_scene::{Scene, SceneDisc};

fn pennies() -> Vec<PartKind> {
    vec![PartKind { name: "penny".into(), radius_m: PENNY_M, thickness_m: 1.52e-3 }]
}

/// Half as many pixels a side as the full scenes: sequences are long.
fn small_scene(seed: u64) -> Scene {
    let mut scene = Scene { blur_px: 1.0, noise_sd: 4.0, shading: 0.3, ..Scene::plain(seed) };
    scene.size_px = [640, 512];
    scene.lens.focal_px /= 2.0;
    scene.lens.principal_px = Vec2::new(319.5, 255.5);
    scene
}

fn start(scene: &Scene, discs: &[SceneDisc]) -> (Table, Vec<Detection>) {
    let frame = scene.frame_with(discs);
    let table = locate_table(&frame, &scene.lens, SIDE_M).unwrap();
    let parts = CoinFinder::new(&table, scene.size_px, &pennies(), true).find(&frame);
    assert_eq!(parts.len(), discs.len());
    (table, parts)
}

fn tracker(scene: &Scene, discs: &[SceneDisc]) -> (Tracker, Vec<usize>) {
    let (table, parts) = start(scene, discs);
    let order = parts
        .iter()
        .map(|part| {
            let off = |i: &usize| (discs[*i].at_m - part.position_m).norm();
            (0..discs.len()).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap()
        })
        .collect();
    (Tracker::new(&table, scene.size_px, &pennies(), true, parts), order)
}

fn worst_mm(tracker: &Tracker, order: &[usize], discs: &[SceneDisc]) -> f64 {
    let off = |(track, &i): (&Track, &usize)| (track.seen.position_m - discs[i].at_m).norm() * 1e3;
    tracker.tracks().iter().zip(order).map(off).fold(0.0, f64::max)
}

#[test]
fn jumps_are_recovered_from() {
    let scene = small_scene(2);
    let (mut tracker, order) = tracker(&scene, &[penny(0.0, 0.0), penny(0.06, 0.06)]);
    // Two radii: the wider search. Across the plate: the full frame.
    for discs in [[penny(0.0, 2.0 * PENNY_M), penny(0.06, 0.06)], [penny(-0.08, -0.07), penny(0.06, 0.05)]] {
        tracker.track(&scene.frame_with(&discs));
        assert!(tracker.tracks().iter().all(|t| t.frames_unseen == 0));
        assert!(worst_mm(&tracker, &order, &discs) < 0.08);
    }
}

#[test]
fn a_hidden_part_is_counted_unseen_and_found_again() {
    let scene = small_scene(3);
    let discs = [penny(0.0, 0.0), penny(0.06, 0.06)];
    let (mut tracker, order) = tracker(&scene, &discs);
    let hidden = order.iter().position(|&i| i == 0).unwrap();
    tracker.track(&scene.frame_with(&discs));
    let last = tracker.tracks()[hidden].clone();
    for k in 1..=5 {
        tracker.track(&scene.frame_with(&discs[1..]));
        assert_eq!(tracker.tracks()[hidden].frames_unseen, k);
        assert_eq!(tracker.tracks()[hidden].seen, last.seen);
        assert_eq!(tracker.tracks()[1 - hidden].frames_unseen, 0);
    }
    let mut dark = scene.frame_with(&discs);
    dark.pixels.fill(0);
    tracker.track(&dark);
    tracker.track(&Frame::new(1, 1));
    assert!(tracker.tracks().iter().all(|t| t.frames_unseen > 0));
    tracker.track(&scene.frame_with(&discs));
    assert!(tracker.tracks().iter().all(|t| t.frames_unseen == 0));
    assert!(worst_mm(&tracker, &order, &discs) < 0.08);
}

#[test]
fn two_tracks_never_claim_one_part() {
    let scene = small_scene(4);
    let (mut tracker, order) = tracker(&scene, &[penny(0.0, 0.0), penny(0.02, 0.0)]);
    // One part is taken away, the other is where both tracks would search.
    tracker.track(&scene.frame_with(&[penny(0.0095, 0.0)]));
    assert_eq!(tracker.tracks().iter().filter(|t| t.frames_unseen == 0).count(), 1);
    let discs = [penny(0.0, 0.0), penny(0.0195, 0.0)];
    for _ in 0..10 {
        tracker.track(&scene.frame_with(&discs));
    }
    assert!(tracker.tracks().iter().all(|t| t.frames_unseen == 0));
    let apart = tracker.tracks()[0].seen.position_m - tracker.tracks()[1].seen.position_m;
    assert!((apart.norm() - 0.0195).abs() < 1e-4);
    assert_eq!(order.len(), 2);
}

#[test]
fn positions_in_place_of_pixels_are_found_and_followed() {
    let scene = small_scene(7);
    let (table, _) = start(&scene, &[]);
    let frame = |places_m: &[Vec2]| {
        let disc = |&foot_m: &Vec2| {
            let seen_m = foot_m + table.parallax(foot_m, pennies()[0].thickness_m).0;
            MeasuredDisc { center_px: table.image_from_table(seen_m), sd_px: 0.01, radius_m: PENNY_M }
        };
        let discs = places_m.iter().map(disc).collect();
        let positions = Some(MeasuredPositions { corners_px: Some(table.corners_px), discs });
        Frame { pixels: Vec::new(), positions, ..Frame::new(scene.size_px[0], scene.size_px[1]) }
    };
    let places_m = |k: i32| [-1.0, 1.0].map(|side: f64| side * Vec2::new(0.04 - 0.002 * f64::from(k), 0.012));
    let first = frame(&places_m(0));
    let located = locate_table(&first, &scene.lens, SIDE_M).unwrap();
    assert!(located.corners_px.iter().zip(&table.corners_px).all(|(a, b)| (a - b).norm() < 1e-6));
    let parts = CoinFinder::new(&table, scene.size_px, &pennies(), true).find(&first);
    let mut tracker = Tracker::new(&table, scene.size_px, &pennies(), true, parts);
    for k in 1..=40 {
        // the two pass each other; their order in the list says nothing
        let [a, b] = places_m(k);
        let listed = if k % 3 == 0 { [b, a] } else { [a, b] };
        tracker.track(&frame(&listed));
        for (track, place_m) in tracker.tracks().iter().zip([a, b]) {
            assert!(
                track.frames_unseen == 0 && (track.seen.position_m - place_m).norm() < 1e-9,
                "frame {k}: {track:?}"
            );
        }
    }
    tracker.track(&frame(&places_m(41)[1..]));
    assert_eq!(tracker.tracks().iter().map(|track| track.frames_unseen).collect::<Vec<_>>(), [1, 0], "one is hidden");
    let hidden = Frame { positions: Some(MeasuredPositions::default()), ..first };
    assert_eq!(locate_table(&hidden, &scene.lens, SIDE_M), Err(super::TableError::CornerHidden));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn no_table_no_kind_and_no_picture_breaks_it(
        corners in proptest::array::uniform8(-40.0..160.0f64), radii in proptest::collection::vec(1e-4..0.5f64, 0..3),
        size in proptest::array::uniform2(1usize..130), seed in 0u64..100, dark in any::<bool>(),
    ) {
        let corners = [0, 2, 4, 6].map(|i| Vec2::new(corners[i], corners[i + 1]));
        let lens = Lens { radial: [-0.2, 0.05], ..Lens::ideal(150.0, Vec2::new(60.0, 60.0)) };
        let Ok(table) = Table::from_ideal_corners(corners, SIDE_M, &lens) else { return Ok(()) };
        let kinds: Vec<PartKind> =
            radii.iter().map(|&radius_m| PartKind { name: String::new(), radius_m, thickness_m: radius_m / 5.0 }).collect();
        let mut frame = Frame::new(size[0], size[1]);
        let mut rng = Streams::new(seed).stream("noise");
        frame.pixels.fill_with(|| rng.next_u64() as u8);
        let odd = Detection {
            kind: 1, center_px: corners[0], radius_px: 3.0, position_m: Vec2::zeros(), score: 1.0, covariance_px2: nalgebra::Matrix2::zeros(),
        };
        let odd_tracks = [Vec2::zeros(), Vec2::new(0.3, 1e9)]
            .map(|position_m| Track { seen: Detection { position_m, ..odd.clone() }, frames_unseen: 0 });
        let mut start = CoinFinder::new(&table, size, &kinds, dark).find(&frame);
        start.push(odd);
        let count = start.len();
        let mut tracker = Tracker::new(&table, size, &kinds, dark, start);
        let (table_watch, mut plate_watch) = (TableWatch::new(&table, size), PlateWatch::new(&table, size, &kinds, dark));
        for (least, span) in [(0, 256), (100, 56), (200, 56)] {
            frame.pixels.fill_with(|| (least + rng.next_u64() % span) as u8);
            tracker.track(&frame);
            prop_assert_eq!(tracker.tracks().len(), count);
            prop_assert!(tracker.tracks().iter().all(|t| t.seen.position_m.x.is_finite() && t.seen.center_px.y.is_finite()));
            prop_assert!(table_watch.check(&frame).corner_px().is_none_or(|px| !px.is_nan()));
            prop_assert!((0.0..=1.0).contains(&plate_watch.check(&frame, &odd_tracks).hidden_share));
        }
    }
}
