//! Tests of the renderer against a slow one that traces a ray back from each of many points of a pixel.

use nalgebra::Vector3;

use super::layers::Paint;
use super::testing::penny;
use super::{ClutterOutline, ClutterShape, Glint, Scene, SceneDisc, ScenePartTruth, SurfaceTexture};
use upm_core::geometry::{Lens, Vec2};

/// Points along each side of a pixel, and of one whose levels differ by less than this: no outline of a surface that
/// stands out crosses it.
const POINTS: usize = 64;
const FEW_POINTS: usize = 16;
const SMOOTH: f64 = 20.0;

/// A small picture with all kinds of objects.
fn small() -> Scene {
    let mut scene = Scene::plain(3);
    scene.size_px = [168, 144];
    scene.side_m = 0.06;
    scene.lens = Lens { radial: [-0.12, 0.03], tangential: [4e-4, -3e-4], ..Lens::ideal(225.0, Vec2::new(81.0, 73.5)) };
    scene.tilt_rad = [0.15, -0.08, 0.3];
    scene.camera_m = -scene.camera_from_table().transpose() * Vector3::new(0.002, -0.001, 0.12);
    let relief = SurfaceTexture { amplitude: 0.2, waves: [(Vec2::new(4.0, 2.0), 1.0); 3], ring: [0.6, 0.2] };
    let glint = Glint { at: Vec2::new(0.2, -0.1), half_axes: [0.3, 0.25], direction_rad: 0.5, level: 330.0 };
    scene.parts = vec![
        SceneDisc { relief: Some(relief), ..penny(-0.01, -0.008) },
        SceneDisc { glints: vec![glint], ..penny(-0.01, -0.008 + 2.0 * 0.009525) },
        penny(0.03 - 0.009525 - 1e-4, 0.0),
    ];
    scene.glints = vec![Glint { at: Vec2::new(0.01, -0.02), half_axes: [0.004, 0.003], ..glint }];
    scene.clutter = vec![ClutterShape {
        shape: ClutterOutline::rectangle(Vec2::new(-0.036, 0.0), [0.003, 0.02], 0.1),
        level: 180.0,
    }];
    let finger = ClutterOutline::capsule(Vec2::new(0.01, 0.027), Vec2::new(0.02, 0.06), 0.004);
    scene.occluders = vec![ClutterShape { shape: finger, level: 100.0 }];
    scene
}

/// Level along the ray from a point of the picture.
fn traced(scene: &Scene, image_px: Vec2) -> f64 {
    let in_camera = (scene.lens.ideal_from_image(image_px) - scene.lens.principal_px) / scene.lens.focal_px;
    let direction = scene.camera_from_table().transpose() * in_camera.push(1.0);
    let at_height = |z: f64| (scene.camera_m + direction * ((z - scene.camera_m.z) / direction.z)).xy();
    let p = at_height(0.0);
    if let Some(cover) = scene.occluders.iter().find(|cover| cover.shape.depth(p) > 0.0) {
        return cover.level;
    }
    let [ground, plate, part_level] = scene.levels;
    for part in scene.parts.iter().rev() {
        let top = at_height(part.thickness_m);
        let way = top - p;
        let t = ((part.at_m - p).dot(&way) / way.norm_squared()).clamp(0.0, 1.0);
        if (p + way * t - part.at_m).norm() < part.radius_m {
            let relief = part.relief.map(|relief| (relief, plate - part_level));
            let frame = (part.at_m, part.radius_m);
            return Paint { level: part_level, frame, relief, glints: &part.glints }.level_at(top);
        }
    }
    if p.amax() < scene.side_m / 2.0 {
        let frame = (Vec2::zeros(), 1.0);
        return Paint { level: plate, frame, relief: None, glints: &scene.glints }.level_at(p);
    }
    scene.clutter.iter().find(|item| item.shape.depth(p) > 0.0).map_or(ground, |item| item.level)
}

/// Mean level of a pixel by its top left corner; many points where its corners differ.
fn traced_pixel(scene: &Scene, corner: Vec2) -> f64 {
    let at = |x: f64, y: f64| traced(scene, corner + Vec2::new(x, y));
    let level = at(0.5, 0.5);
    let corners = [at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0), at(1.0, 1.0)];
    if corners == [level; 4] {
        return level;
    }
    let points = if corners.iter().all(|corner| (corner - level).abs() < SMOOTH) { FEW_POINTS } else { POINTS };
    let n = points as f64;
    // No two points share a column or a row.
    let sum: f64 = (0..points * points)
        .map(|k| ((k % points) as f64, (k / points) as f64))
        .map(|(x, y)| at((x + (y + 0.5) / n) / n, (y + (x + 0.5) / n) / n))
        .sum();
    sum / (n * n)
}

#[test]
fn levels_are_those_of_rays() {
    let scene = small();
    let levels = scene.levels_by_area(&scene.parts);
    let (mut squares, mut worst) = (0.0, 0.0f64);
    for (i, level) in levels.iter().enumerate() {
        let corner = Vec2::new((i % 168) as f64 - 0.5, (i / 168) as f64 - 0.5);
        let off = f64::from(*level) - traced_pixel(&scene, corner);
        squares += off * off;
        worst = worst.max(off.abs());
    }
    let rms = (squares / levels.len() as f64).sqrt();
    eprintln!("renderer against rays: {rms:.4} levels rms, {worst:.3} worst");
    // Of a step of 197; the worst are the few pixels where outlines meet.
    assert!(rms < 0.15 && worst < 3.0, "{rms} {worst}");
}

/// Area and centroid of the region that a part covers in a rendered picture.
fn rendered(scene: &Scene) -> (f64, Vec2) {
    let [_, plate, part] = scene.levels;
    let share = |(i, level): (usize, &f32)| {
        let p = Vec2::new((i % scene.size_px[0]) as f64, (i / scene.size_px[0]) as f64);
        let on_plate = ClutterOutline::square(scene.side_m).depth(on_plate(scene, p)) > 2e-3;
        (if on_plate { (f64::from(*level) - plate) / (part - plate) } else { 0.0 }, p)
    };
    let levels = scene.levels_by_area(&scene.parts);
    let (area, moment) = levels
        .iter()
        .enumerate()
        .map(share)
        .fold((0.0, Vec2::zeros()), |(area, moment), (share, p)| (area + share, moment + p * share));
    (area, moment / area)
}

fn on_plate(scene: &Scene, image_px: Vec2) -> Vec2 {
    scene.ideal_from_table().inverse().unwrap().apply(scene.lens.ideal_from_image(image_px))
}

#[test]
fn truth_is_where_a_lone_part_is_rendered() {
    for (seed, tilt, at) in
        [(1, [0.0, 0.0], (0.0, 0.0)), (2, [0.17, -0.02], (-0.07, 0.06)), (3, [-0.05, 0.16], (0.06, -0.075))]
    {
        let mut scene = Scene::general(seed);
        scene.tilt_rad = [tilt[0], tilt[1], 0.4];
        scene.camera_m = -scene.camera_from_table().transpose() * Vector3::new(0.0, 0.0, 0.65);
        scene.parts = vec![SceneDisc { thickness_m: 2e-3, ..penny(at.0, at.1) }];
        let ScenePartTruth { center_px, radius_px, .. } = scene.truth()[0];
        let (area, center) = rendered(&scene);
        assert!((center - center_px).norm() < 2e-3, "{seed}: {}", center - center_px);
        assert!(((area / std::f64::consts::PI).sqrt() - radius_px).abs() < 2e-3, "{seed}: {area}");
    }
}

#[test]
fn light_lens_and_saturation() {
    let scene =
        Scene { side_m: 1.0, levels: [0.0, 200.0, 0.0], shading: 0.5, shading_direction_rad: 0.0, ..Scene::plain(0) };
    let frame = scene.frame();
    assert!((frame.row(500)[0], frame.row(500)[640], frame.row(1023)[1279]) == (200, 150, 100));
    let bright = Scene { levels: [0.0, 300.0, 0.0], ..scene };
    assert!(bright.frame().row(3)[0] == 255);
    let edge = Scene { blur_px: 2.0, noise_sd: 3.0, ..Scene::plain(0) };
    let frame = edge.frame();
    let mean = |x: usize| (300..700).map(|y| f64::from(frame.row(y)[x])).sum::<f64>() / 400.0;
    // The step's integral: the left side is at 639.5 - 0.1016 * 4200 px.
    let side = 639.5 - 0.1016 * 4200.0;
    for x in 205..221 {
        let share: f64 = (0..600)
            .map(|i| (f64::from(i) - 299.5) / 50.0)
            .filter(|z| 2.0 * z < x as f64 - side)
            .map(|z| (-0.5 * z * z).exp() / 50.0 / 2.5066)
            .sum();
        let off = mean(x) - (18.0 + 197.0 * share);
        assert!(off.abs() < 1.6, "{x}: {off}");
    }
    let sd = (300..700).map(|y| (f64::from(frame.row(y)[640]) - mean(640)).powi(2)).sum::<f64>() / 400.0;
    assert!((sd.sqrt() - 3.0).abs() < 0.35, "{sd}");
}
