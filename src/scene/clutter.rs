use std::f64::consts::{FRAC_PI_2, TAU};

use super::generate::SceneSampler;
use super::parts::kinds;
use super::{ClutterOutline, ClutterShape, Glint, Scene, SurfaceTexture};
use upm_core::geometry::{Vec2, perp};

/// Least distance of objects on the ground from the plate, m.
const CLUTTER_GAP_M: f64 = 4e-3;

/// One side of the plate: its outward normal and the direction along it.
fn side(sampler: &mut SceneSampler) -> (Vec2, Vec2) {
    let (sin, cos) = (FRAC_PI_2 * sampler.one_of(4) as f64).sin_cos();
    let outward = Vec2::new(cos, sin);
    (outward, perp(outward))
}

impl Scene {
    /// A bar or a hand over up to a quarter of one side, in a third of the scenes.
    pub(super) fn draw_occluders(&mut self, sampler: &mut SceneSampler) {
        if !sampler.chance(0.35) {
            return;
        }
        let level = if sampler.chance(0.5) { self.levels[0] } else { sampler.within(85.0, 140.0) };
        let (outward, along) = side(sampler);
        let (half_side, hidden) = (self.side_m / 2.0, sampler.within(0.08, 0.24) * self.side_m);
        let at = outward * half_side + along * (sampler.around(0.5) * half_side);
        let inward = sampler.within(0.03, 0.12) * self.side_m;
        let shapes = if sampler.chance(0.5) {
            bar(sampler, at, outward, hidden, inward)
        } else {
            hand(sampler, at, outward, hidden, inward)
        };
        self.occluders.extend(shapes.into_iter().map(|shape| ClutterShape { shape, level }));
    }

    /// Discs, sheets and long stripes beside the plate, in half of the scenes: none of them is a square as large as the
    /// plate.
    pub(super) fn draw_clutter(&mut self, sampler: &mut SceneSampler) {
        if !sampler.chance(0.55) {
            return;
        }
        for _ in 0..1 + sampler.one_of(6) {
            let level = self.stray_level(sampler);
            let (outward, along) = side(sampler);
            let size = self.side_m * sampler.within(0.03, 0.3);
            let at = |away: f64, aside: f64| outward * (self.side_m / 2.0 + away) + along * aside;
            let aside = sampler.around(0.6) * self.side_m;
            let gap = CLUTTER_GAP_M + sampler.within(0.0, 0.25) * self.side_m;
            let across = outward.y.atan2(outward.x);
            let shape = match sampler.one_of(3) {
                0 => ClutterOutline::circle(at(gap + size / 2.0, aside), size / 2.0),
                1 => {
                    let half = [size / 2.0, size * sampler.within(0.2, 1.0)];
                    ClutterOutline::rectangle(at(gap + half[0].hypot(half[1]), aside), half, sampler.within(0.0, TAU))
                }
                _ => {
                    let half = [self.side_m * sampler.within(0.01, 0.06), self.side_m * sampler.within(0.25, 0.7)];
                    let (turn, near) = (sampler.around(0.05), CLUTTER_GAP_M + sampler.within(0.0, 0.1) * self.side_m);
                    ClutterOutline::rectangle(at(near + half[0] + half[1] * turn.abs(), aside), half, across + turn)
                }
            };
            self.clutter.push(ClutterShape { shape, level });
        }
    }

    /// Gray level of an object on the ground: bright on dark ground, else at least 40 levels darker than the ground.
    fn stray_level(&self, sampler: &mut SceneSampler) -> f64 {
        let ground = self.levels[0];
        if ground < 80.0 || (ground < 150.0 && sampler.chance(0.5)) {
            sampler.within(150.0, 255.0)
        } else {
            sampler.within(0.0, ground - 40.0)
        }
    }

    /// Reliefs, glints on parts and glints on the plate, each in about half of the scenes.
    pub(super) fn draw_faces(&mut self, sampler: &mut SceneSampler) {
        let amplitude = if sampler.chance(0.6) { sampler.within(0.03, 0.2) } else { 0.0 };
        let (on_parts, on_plate) = (sampler.chance(0.45), sampler.chance(0.35));
        for part in &mut self.parts {
            part.relief = (amplitude > 0.0).then(|| relief(sampler, amplitude));
            if on_parts && sampler.chance(0.6) {
                part.glints = (0..1 + sampler.one_of(2)).map(|_| glint(sampler, 0.7, 1.0)).collect();
            }
        }
        if on_plate {
            let radius_m = kinds()[0].radius_m;
            self.glints = (0..1 + sampler.one_of(6)).map(|_| glint(sampler, 0.48 * self.side_m, radius_m)).collect();
        }
    }
}

/// A straight bar from outside that ends on the plate.
fn bar(sampler: &mut SceneSampler, at: Vec2, outward: Vec2, hidden: f64, inward: f64) -> Vec<ClutterOutline> {
    let turn = sampler.around(0.25);
    let direction = outward.y.atan2(outward.x) + turn;
    let (sin, cos) = direction.sin_cos();
    let length = 30.0 * hidden;
    let middle = at + Vec2::new(cos, sin) * (length / 2.0 - inward);
    vec![ClutterOutline::rectangle(middle, [length / 2.0, hidden * turn.cos() / 2.0], direction)]
}

/// Fingers side by side, and the hand they belong to, outside the plate.
fn hand(sampler: &mut SceneSampler, at: Vec2, outward: Vec2, hidden: f64, inward: f64) -> Vec<ClutterOutline> {
    let fingers = 2 + sampler.one_of(3);
    let (radius, along) = (hidden / (2.0 * fingers as f64), perp(outward));
    let palm = at + outward * (1.2 * hidden + 2.5 * radius);
    let mut shapes = vec![ClutterOutline::capsule(palm, palm + outward * (30.0 * hidden), 0.9 * hidden)];
    for finger in 0..fingers {
        let aside = along * ((2.0 * finger as f64 + 1.0) * radius - hidden / 2.0);
        let tip = at + aside - outward * (inward * sampler.within(0.6, 1.0) - radius).max(0.0);
        shapes.push(ClutterOutline::capsule(tip, palm + aside, radius));
    }
    shapes
}

fn relief(sampler: &mut SceneSampler, amplitude: f64) -> SurfaceTexture {
    let mut wave = || (sampler.direction() * sampler.within(2.0, 14.0), sampler.within(0.0, TAU));
    let waves = [wave(), wave(), wave()];
    SurfaceTexture { amplitude, waves, ring: [sampler.within(0.5, 0.85), sampler.within(0.04, 0.1)] }
}

/// A glint within `reach` of the origin, its half axes up to a quarter of `unit`.
fn glint(sampler: &mut SceneSampler, reach: f64, unit: f64) -> Glint {
    Glint {
        at: sampler.direction() * (reach * sampler.within(0.0, 1.0).sqrt()),
        half_axes: [sampler.within(0.08, 0.25) * unit, sampler.within(0.08, 0.25) * unit],
        direction_rad: sampler.within(0.0, TAU),
        level: sampler.within(260.0, 400.0),
    }
}

#[cfg(test)]
mod tests {
    use super::super::Difficulty;
    use super::*;

    /// Points of the plate's outline, side by side, equally many on each.
    fn outline(scene: &Scene) -> Vec<Vec2> {
        let half = scene.side_m / 2.0;
        let corners = [(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)].map(|(x, y)| Vec2::new(x, y) * half);
        (0..4 * STEPS)
            .map(|i| corners[i / STEPS].lerp(&corners[(i / STEPS + 1) % 4], (i % STEPS) as f64 / STEPS as f64))
            .collect()
    }

    const STEPS: usize = 400;

    #[test]
    fn at_most_a_quarter_of_one_side_is_hidden() {
        let mut most = 0.0f64;
        for scene in (0..300).map(|seed| Scene::generate(Difficulty::Hard, seed)) {
            let hidden = |p: &Vec2| scene.occluders.iter().any(|cover| cover.shape.depth(*p) > 0.0);
            let outline = outline(&scene);
            let shares: Vec<f64> = outline
                .chunks(STEPS)
                .map(|side| side.iter().filter(|p| hidden(p)).count() as f64 / STEPS as f64)
                .collect();
            let sides = shares.iter().filter(|&&share| share > 0.0).count();
            assert_eq!(sides, usize::from(!scene.occluders.is_empty()), "{}: {shares:?}", scene.seed);
            most = shares.iter().fold(most, |a, &b| a.max(b));
        }
        assert!(most > 0.2 && most < 0.25, "{most}");
    }

    #[test]
    fn things_on_the_ground_keep_off_the_plate() {
        for scene in (0..300).map(|seed| Scene::generate(Difficulty::Hard, seed)) {
            for p in outline(&scene) {
                let deepest = scene.clutter.iter().map(|item| item.shape.depth(p)).fold(f64::NEG_INFINITY, f64::max);
                assert!(deepest < -3e-3, "{}: {deepest}", scene.seed);
            }
        }
    }
}
