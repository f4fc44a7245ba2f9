//! Tracking of parts in rendered sequences, past each other and behind covers, against their true positions.

use super::super::classifier::overlap;
use super::super::{CoinFinder, Table, Track, Tracker};
use rand_distr::{Distribution, Uniform};
use upm_core::geometry::Vec2;
use upm_core::random::Streams;
use upm_core::rig::PartKind;
use upm_core::signal::Frame;
use upm_scene::testing::{PENNY_M, SIDE_M, penny};
use upm_scene::{ClutterOutline, ClutterShape, Scene, SceneDisc};

/// One sequence: true positions of the parts and the things that hide them, frame by frame.
struct TrackingSequence {
    scene: Scene,
    table: Table,
    tracker: Tracker,
    /// The part of each track.
    parts: Vec<usize>,
}

impl TrackingSequence {
    fn start(scene: Scene, places_m: &[Vec2]) -> Self {
        let corners = scene.corners_px().map(|corner| scene.lens.ideal_from_image(corner));
        let table = Table::from_ideal_corners(corners, SIDE_M, &scene.lens).unwrap();
        let kinds = [PartKind { name: "penny".into(), radius_m: PENNY_M, thickness_m: 1.52e-3 }];
        let frame = scene.frame_with(&discs(places_m));
        let found = CoinFinder::new(&table, scene.size_px, &kinds, true).find(&frame);
        assert_eq!(found.len(), places_m.len());
        let nearest = |at: Vec2| {
            let off = |i: &usize| (places_m[*i] - at).norm();
            (0..places_m.len()).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap()
        };
        let parts = found.iter().map(|part| nearest(part.position_m)).collect();
        let tracker = Tracker::new(&table, scene.size_px, &kinds, true, found);
        Self { scene, table, tracker, parts }
    }

    /// Tracks the next frame. Every detection of a part must be within `most_px` of it, and no two tracks on one part.
    fn next(&mut self, places_m: &[Vec2], covers: Vec<ClutterShape>, most_px: f64) {
        self.scene.seed += 1;
        self.scene.occluders = covers;
        self.show(&self.scene.frame_with(&discs(places_m)), places_m, most_px);
    }

    fn show(&mut self, frame: &Frame, places_m: &[Vec2], most_px: f64) {
        self.tracker.track(frame);
        for i in 0..self.parts.len() {
            let (seed, off) = (self.scene.seed, self.error_px(i, places_m).norm());
            assert!(self.track(i).frames_unseen > 0 || off < most_px, "frame {seed}: part {i} is off by {off} px");
            for j in 0..i {
                let both = [i, j].map(|k| self.track(k)).map(|t| (t.frames_unseen == 0).then_some(&t.seen));
                assert!(!matches!(both, [Some(a), Some(b)] if overlap(a, b)), "frame {seed}: {i} and {j} are one");
            }
        }
    }

    fn track(&self, part: usize) -> &Track {
        &self.tracker.tracks()[self.parts.iter().position(|&i| i == part).unwrap()]
    }

    /// Distance of the last detection of a part from its present position.
    fn error_px(&self, part: usize, places_m: &[Vec2]) -> Vec2 {
        self.table.image_from_table(self.track(part).seen.position_m) - self.table.image_from_table(places_m[part])
    }

    fn all_seen(&self) -> bool {
        self.tracker.tracks().iter().all(|track| track.frames_unseen == 0)
    }
}

fn discs(places_m: &[Vec2]) -> Vec<SceneDisc> {
    places_m.iter().map(|at| penny(at.x, at.y)).collect()
}

fn mm(x: f64, y: f64) -> Vec2 {
    Vec2::new(x, y) * 1e-3
}

/// Parts of 20 px radius, noise and blur.
fn small_scene(seed: u64) -> Scene {
    let mut scene = Scene { blur_px: 1.0, noise_sd: 6.0, shading: 0.3, ..Scene::plain(1000 * seed) };
    scene.size_px = [500, 480];
    scene.lens.focal_px /= 2.0;
    scene.lens.principal_px = Vec2::new(249.5, 239.5);
    scene
}

#[test]
fn parts_that_brush_past_each_other_keep_their_names() {
    for seed in 0..3 {
        let mut dice = Streams::new(seed).stream("speeds");
        let speed: Vec<f64> = Uniform::new(0.8, 1.6).unwrap().sample_iter(&mut dice).take(4).collect();
        let gap = PENNY_M * 1e3 + 0.02;
        // Two lanes that touch, a part at rest between two passing ones, and one on a circle.
        let places = |k: f64| {
            let (sin, cos) = libm::sincos(0.1 * speed[0] * k);
            vec![
                mm(-50.0 + speed[0] * k, gap - 60.0),
                mm(50.0 - speed[1] * k, -gap - 60.0),
                mm(-75.0, 75.0 - speed[2] * k),
                mm(-75.0 + 2.0 * gap, 30.0),
                mm(-75.0 + 4.0 * gap, -15.0 + speed[3] * k),
                mm(65.0 + 15.0 * cos, 65.0 + 15.0 * sin),
            ]
        };
        let mut sequence = TrackingSequence::start(small_scene(seed), &places(0.0));
        for k in 1..=60 {
            sequence.next(&places(f64::from(k)), Vec::new(), 0.5);
            assert!(sequence.all_seen(), "seed {seed}, frame {k}");
        }
    }
}

#[test]
fn finger_hides_parts_and_is_not_taken_for_one() {
    for (seed, level) in [(1, 30.0), (2, 90.0), (3, 250.0)] {
        let places = |k: f64| vec![mm(-40.0 + 0.3 * k, 30.0), mm(-20.0 + 0.3 * k, 30.0), mm(30.0, 20.0 - 0.3 * k)];
        let mut sequence = TrackingSequence::start(small_scene(seed), &places(0.0));
        let (mut hidden, mut partly) = ([0; 3], 0);
        for k in 1..=70 {
            let tip = mm(-75.0 + 2.5 * f64::from(k), 28.0);
            let finger = ClutterOutline::capsule(tip, tip + mm(-10.0, -160.0), 0.013);
            let places = places(f64::from(k));
            let depth: Vec<f64> = places.iter().map(|&at| finger.depth(at) / PENNY_M).collect();
            sequence.next(&places, vec![ClutterShape { shape: finger, level }], 1.5);
            for (i, depth) in depth.into_iter().enumerate() {
                let seen = sequence.track(i).frames_unseen == 0;
                hidden[i] += u32::from(!seen);
                partly += u32::from(seen && depth > -0.8);
                assert!(seen || depth > -0.8, "level {level}, frame {k}: part {i} is in plain view");
                assert!(!seen || depth < 0.9, "level {level}, frame {k}: part {i} is hidden");
            }
        }
        assert!(sequence.all_seen(), "level {level}");
        assert!(hidden.iter().all(|&frames| frames > 2) && partly > 6, "level {level}: {hidden:?} {partly}");
    }
}

fn curtain() -> Vec<ClutterShape> {
    vec![ClutterShape { shape: ClutterOutline::rectangle(Vec2::zeros(), [0.06, 0.06], 0.3), level: 60.0 }]
}

#[test]
fn equal_hidden_parts_reappear_on_their_own_paths() {
    for seed in 0..3 {
        let gap = PENNY_M * 1e3 + 0.3;
        let speed = [1.1 + 0.1 * seed as f64, 1.2];
        let places = |k: f64| {
            vec![
                mm(-24.0 + speed[0] * k, gap),
                mm(24.0 - speed[1] * k, -gap),
                mm(80.0, -70.0 + 0.5 * k),
                mm(-80.0, 80.0),
            ]
        };
        let mut sequence = TrackingSequence::start(small_scene(seed), &places(0.0));
        for k in 1..=60 {
            let hidden = (9..33).contains(&k);
            sequence.next(&places(f64::from(k)), if hidden { curtain() } else { Vec::new() }, 0.5);
            assert_eq!([0, 1].map(|i| sequence.track(i).frames_unseen > 0), [hidden; 2], "seed {seed}, frame {k}");
            if hidden {
                assert_eq!(sequence.track(0).frames_unseen, k - 8);
            }
        }
        let [before, after] = [8.0, 33.0].map(places);
        assert!((after[1] - before[0]).norm() < (after[0] - before[0]).norm(), "the nearest would have been the other");
        assert!(sequence.all_seen());
    }
}

#[test]
fn parts_moved_while_hidden_are_matched_overall_not_one_by_one() {
    let before = [mm(-50.0, 0.0), mm(-22.0, 0.0), mm(80.0, 80.0)];
    // The nearest pair is the second part and the first place; the least total is the other assignment.
    let after = [mm(-24.0, 0.0), mm(15.0, 3.0), mm(80.0, 80.0)];
    let mut sequence = TrackingSequence::start(small_scene(5), &before);
    (0..4).for_each(|_| sequence.next(&before, Vec::new(), 0.5));
    (0..5).for_each(|_| sequence.next(&before, curtain(), 0.5));
    (0..10).for_each(|_| sequence.next(&after, Vec::new(), 0.5));
    assert!(sequence.all_seen());
}

#[test]
fn smeared_parts_are_found_in_the_middle_of_the_exposure() {
    let mut sequence = TrackingSequence::start(small_scene(7), &[mm(-60.0, 40.0), mm(60.0, -20.0)]);
    let noise_sd = std::mem::replace(&mut sequence.scene.noise_sd, 0.0);
    let noise = rand_distr::Normal::new(0.0, noise_sd).unwrap();
    let (mut squares, mut looks) = (0.0, 0.0);
    // 6 px a frame, all of it within the exposure: three tenths of a radius.
    let places = |k: f64| [mm(-60.0 + 2.8 * k, 40.0), mm(60.0 - 2.0 * k, -20.0 + 2.0 * k)];
    for k in 1..=16 {
        let exposures =
            [-0.4, -0.2, 0.0, 0.2, 0.4].map(|part| sequence.scene.frame_with(&discs(&places(f64::from(k) + part))));
        let mut frame = exposures[0].clone();
        let mut dice = Streams::new(k as u64).stream("noise");
        for (i, pixel) in frame.pixels.iter_mut().enumerate() {
            let mean = exposures.iter().map(|e| f64::from(e.pixels[i])).sum::<f64>() / 5.0;
            *pixel = (mean + noise.sample(&mut dice)).round().clamp(0.0, 255.0) as u8;
        }
        sequence.show(&frame, &places(f64::from(k)), 0.5);
        assert!(sequence.all_seen(), "frame {k}");
        squares += (0..2).map(|i| sequence.error_px(i, &places(f64::from(k))).norm_squared()).sum::<f64>();
        looks += 4.0;
    }
    let rms = f64::sqrt(squares / looks);
    eprintln!("parts smeared by 0.3 radii: {rms:.4} px rms an axis");
    assert!(rms < 0.1, "{rms} px");
}

/// Mean of squared errors over variances along both axes, and of the covariance's longer axis over its shorter one.
fn consistency(seeds: std::ops::Range<u64>, cover: impl Fn(usize, Vec2) -> Option<ClutterShape>) -> (f64, f64) {
    let (mut chi, mut stretch, mut n) = (0.0, 0.0, 0.0);
    for seed in seeds {
        let scene = Scene::general(seed).rough();
        let places: Vec<Vec2> =
            (0..9).map(|i| mm(-63.0 + 60.3 * f64::from(i % 3), -61.0 + 59.7 * f64::from(i / 3))).collect();
        let mut sequence = TrackingSequence::start(scene, &places);
        let covers = places.iter().enumerate().filter_map(|(i, &at)| cover(i, at)).collect();
        sequence.next(&places, covers, 1.0);
        for i in 0..places.len() {
            assert_eq!(sequence.track(i).frames_unseen, 0, "seed {seed}, part {i}");
            let (error, covariance) = (sequence.error_px(i, &places), sequence.track(i).seen.covariance_px2);
            chi += (error.transpose() * covariance.try_inverse().unwrap() * error)[0] / 2.0;
            let axes = covariance.symmetric_eigenvalues();
            stretch += (axes.max() / axes.min()).sqrt();
            n += 1.0;
        }
    }
    (chi / n, stretch / n)
}

#[test]
fn covariances_are_as_large_as_the_errors() {
    let (open, round) = consistency(0..20, |_, _| None);
    let (hidden, long) = consistency(20..40, |i, at| {
        let (sin, cos) = libm::sincos(f64::from(i as u32) * 0.7);
        let shape = ClutterOutline::rectangle(
            at + Vec2::new(cos, sin) * (1.3 * PENNY_M),
            [PENNY_M, 1.5 * PENNY_M],
            f64::from(i as u32) * 0.7,
        );
        Some(ClutterShape { shape, level: 60.0 })
    });
    eprintln!("squared error over variance: {open:.2}, half hidden {hidden:.2}; axes {round:.2} and {long:.2}");
    assert!((0.8..1.25).contains(&open) && (0.8..1.25).contains(&hidden), "{open} {hidden}");
    assert!(round < 1.1 && long > 1.3, "{round} {long}");
}
