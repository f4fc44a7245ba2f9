//! State that the camera keeps from frame to frame.

use proptest::prelude::*;

use super::reference::{camera, pose};
use super::scenes::{self, PLATE_M};
use super::*;
use upm_core::random::Streams;

const TALL: PartParams = PartParams { radius_m: 6e-3, thickness_m: 12e-3, ..PartParams::PENNY };

fn snapshot(plate: Pose, parts: &[Vec2]) -> Snapshot {
    let parts_in_table = parts.iter().map(|p| Some(pose(p.x, p.y, 0.0))).collect();
    Snapshot { plate_in_table: plate, parts_in_table }
}

/// Exposures of every length with motion from none to far, some over the plate's edge.
fn exposure() -> impl Strategy<Value = Vec<Snapshot>> {
    let plate = (prop_oneof![Just(0.0), -3e-3..3e-3f64, -0.05..0.05f64], -3e-3..3e-3f64, -0.03..0.03f64);
    let part = || (0.05..0.115f64, 0.05..0.115f64);
    let speed = prop_oneof![Just(0.0), 0.0..1e-4f64, 0.0..1e-3f64];
    (1_usize..9, plate, part(), part(), speed).prop_map(|(count, (x, y, turn), a, b, step)| {
        let at = |k: usize| {
            let moved = step * k as f64;
            let parts = [Vec2::new(a.0 + moved, a.1), Vec2::new(b.0, b.1 - 2.0 * moved)];
            let (y, turn) = if x == 0.0 { (0.0, 0.0) } else { (y + moved, turn) };
            snapshot(pose(x, y, turn), &parts)
        };
        (0..count).map(at).collect()
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    #[test]
    fn the_clean_picture_depends_on_the_exposure_alone(exposures in prop::collection::vec(exposure(), 1..5)) {
        let params = scenes::small();
        let mut used = camera(&params, &[PartParams::PENNY, TALL]);
        for exposure in &exposures {
            used.shown(exposure);
            let mut fresh = camera(&params, &[PartParams::PENNY, TALL]);
            fresh.shown(exposure);
            let at = used.clean.iter().zip(&fresh.clean).position(|(a, b)| a != b);
            prop_assert!(at.is_none(), "differs in pixel {:?}", at.map(|k| (k % 160, k / 160)));
            prop_assert!(used.sd == fresh.sd);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]
    #[test]
    fn bounds_of_tiles_are_not_seen(params in scenes::any(), x in -0.1..0.1f64, y in -0.1..0.1f64, turn in -0.4..0.4f64) {
        let discs = [PartParams::PENNY, TALL];
        let exposure = [snapshot(pose(x, y, turn), &[Vec2::new(x, y), Vec2::new(x + 0.09, y - 0.09)])];
        let mut bounded = camera(&params, &discs);
        bounded.shown(&exposure);
        let mut exact = camera(&params, &discs);
        exact.grid.tiles.iter_mut().for_each(tiles::Tile::unbind);
        exact.stale.fill(true);
        exact.shown(&exposure);
        prop_assert!(exact.grid.tiles.iter().all(tiles::Tile::is_known));
        prop_assert!(bounded.clean == exact.clean);
    }
}

#[test]
fn an_exposure_is_the_mean_of_its_snapshots() {
    for step_m in [1e-6, 3e-5, 7e-5, 1.2e-4, 3e-4] {
        let params = scenes::small();
        let mut camera = camera(&params, &[PartParams::PENNY, TALL]);
        let at = |k: usize| {
            let s = step_m * k as f64;
            let parts = [Vec2::new(0.07 + s, 0.08 - 0.5 * s), Vec2::new(0.088, 0.066 + s)];
            snapshot(pose(0.8 * s, -s, -4.0 * s), &parts)
        };
        let exposure: Vec<Snapshot> = (0..8).map(at).collect();
        let mut blurred = camera.shown(&exposure);
        for snapshot in exposure {
            let sharp = camera.shown(&[snapshot]);
            blurred.levels.iter_mut().zip(&sharp.levels).for_each(|(sum, level)| *sum -= level / 8.0);
        }
        let off = blurred.levels.iter().fold(0.0_f64, |off, level| off.max(level.abs()));
        // Within a sub-exposure both sides of a corner move together; the product of shares ignores that.
        assert!(off < 1.5, "{step_m}: {off}");
    }
}

#[test]
fn frames_follow_from_seed_and_calls() {
    let params = scenes::small();
    let exposure = [snapshot(Pose::IDENTITY, &[Vec2::new(0.08, 0.08)])];
    let frames = |seed| {
        let noise = Streams::new(seed).stream("camera");
        let mut camera = Renderer::new(params, PLATE_M, &[PartParams::PENNY], noise);
        let mut frames = [Frame::new(0, 0), Frame::new(7, 9)];
        frames.iter_mut().for_each(|frame| camera.render(&exposure, frame));
        frames
    };
    assert_eq!(frames(1), frames(1));
    assert_ne!(frames(1), frames(2));
    let [first, second] = frames(1);
    assert_eq!((first.width, first.height, first.pixels.len()), (150, 110, 150 * 110));
    assert_ne!(first, second, "every frame has noise of its own");
}

#[test]
fn fallen_and_missing_parts_are_not_seen() {
    let params = scenes::small();
    let mut camera = camera(&params, &[PartParams::PENNY]);
    let empty = camera.shown(&[snapshot(Pose::IDENTITY, &[])]);
    let off = |camera: &mut Renderer, plate, x_m| {
        camera.shown(&[snapshot(plate, &[Vec2::new(x_m, 0.08)])]).farthest_from(&empty)
    };
    assert!(off(&mut camera, Pose::IDENTITY, 0.1015) > 100.0);
    assert_eq!(off(&mut camera, Pose::IDENTITY, 0.1017), 0.0);
    assert_eq!(off(&mut camera, Pose::IDENTITY, f64::NAN), 0.0);
    assert!(off(&mut camera, pose(1e-3, 0.0, 0.0), 0.1017) > 100.0, "the plate has come along");
}

#[test]
fn light_falls_from_corner_to_corner() {
    let mut params = scenes::small();
    for direction in [0.3_f64, 2.0, -2.5, -0.4] {
        (params.shading, params.shading_direction_rad) = (0.25, direction);
        let light = Illumination::new(&params);
        let corners = [(0, 0), (149, 0), (0, 109), (149, 109)].map(|(x, y)| light.at(x, y)[0]);
        assert!((corners.iter().copied().fold(f32::MIN, f32::max) - 1.0).abs() < 1e-6);
        assert!((corners.iter().copied().fold(f32::MAX, f32::min) - 0.75).abs() < 1e-6);
        let [_, x, y] = light.at(0, 0);
        assert!((f64::from(-y).atan2(f64::from(-x)) - direction).abs() < 1e-5);
    }
}
