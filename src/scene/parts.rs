use super::generate::SceneSampler;
use super::{Scene, SceneDisc};
use upm_core::geometry::Vec2;
use upm_core::rig::PartKind;

/// US coins: name, radius and thickness, mm.
const COINS: [(&str, f64, f64); 4] =
    [("penny", 9.525, 1.52), ("nickel", 10.605, 1.95), ("dime", 8.955, 1.35), ("quarter", 12.13, 1.75)];
/// Most parts in a scene.
const MOST_PARTS: usize = 40;
/// Gap between parts that touch, m: covers rounding errors.
const TOUCH_M: f64 = 1e-7;
/// Least distance of parts from objects in front, m.
const CLEAR_M: f64 = 2e-3;
/// Positions tried for one part.
const TRIES: usize = 300;

/// The kinds of part: penny, nickel, dime, quarter.
pub fn kinds() -> Vec<PartKind> {
    let kind = |(name, radius_mm, thickness_mm): (&str, f64, f64)| PartKind {
        name: name.to_owned(),
        radius_m: radius_mm * 1e-3,
        thickness_m: thickness_mm * 1e-3,
    };
    COINS.map(kind).into()
}

impl Scene {
    /// So many pennies, some of them touching; without a number 1 to 40 parts of any kind, which touch in most scenes.
    pub(super) fn draw_parts(&mut self, sampler: &mut SceneSampler, pennies: Option<usize>) {
        let (touching, count) = match pennies {
            Some(count) => (true, count),
            None => (sampler.chance(0.75), 1 + sampler.one_of(MOST_PARTS)),
        };
        for _ in 0..count {
            let kind = if pennies.is_some() { 0 } else { sampler.one_of(COINS.len()) };
            let (_, radius_mm, thickness_mm) = COINS[kind];
            let radius_m = radius_mm * 1e-3;
            let place =
                (0..TRIES).map(|_| self.place(sampler, radius_m, touching)).find(|&at_m| self.fits(at_m, radius_m));
            if let Some(at_m) = place {
                self.parts.push(SceneDisc { kind, ..SceneDisc::new(at_m, radius_m, thickness_mm * 1e-3) });
            }
        }
        // Tops lean away from below the camera, over the feet of parts farther out.
        let below_camera_m = self.camera_m.xy();
        let out = |part: &SceneDisc| (part.at_m - below_camera_m).norm();
        self.parts.sort_by(|a, b| out(b).total_cmp(&out(a)));
    }

    /// A position beside another part, near the plate's edge or anywhere.
    fn place(&self, sampler: &mut SceneSampler, radius_m: f64, touching: bool) -> Vec2 {
        let reach_m = self.side_m / 2.0 - radius_m;
        if touching && !self.parts.is_empty() && (self.parts.len() == 1 || sampler.chance(0.6)) {
            let other = &self.parts[sampler.one_of(self.parts.len())];
            return other.at_m + sampler.direction() * (other.radius_m + radius_m + TOUCH_M);
        }
        let anywhere = Vec2::new(sampler.around(reach_m), sampler.around(reach_m));
        if !sampler.chance(0.12) {
            return anywhere;
        }
        let edge = (reach_m - sampler.within(2e-5, 5e-4)) * if sampler.chance(0.5) { 1.0 } else { -1.0 };
        if sampler.chance(0.5) { Vec2::new(edge, anywhere.y) } else { Vec2::new(anywhere.x, edge) }
    }

    /// True when a part there is wholly on the plate, over no other and clear of objects in front.
    fn fits(&self, at_m: Vec2, radius_m: f64) -> bool {
        at_m.amax() + radius_m <= self.side_m / 2.0
            && self.parts.iter().all(|other| (other.at_m - at_m).norm() >= other.radius_m + radius_m)
            && self.occluders.iter().all(|cover| cover.shape.depth(at_m) < -radius_m - CLEAR_M)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Difficulty;
    use super::*;

    /// Pairs of parts less than 1 µm apart.
    fn touching(scene: &Scene) -> usize {
        let gap = |a: &SceneDisc, b: &SceneDisc| (a.at_m - b.at_m).norm() - a.radius_m - b.radius_m;
        let pairs = scene.parts.iter().enumerate().flat_map(|(i, a)| scene.parts[..i].iter().map(move |b| gap(a, b)));
        pairs.filter(|gap| *gap < 1e-6).count()
    }

    #[test]
    fn parts_are_on_the_plate_and_do_not_overlap() {
        for difficulty in Difficulty::ALL {
            let (mut with_touching, mut at_edge, mut parts) = (0, 0, 0);
            for scene in (0..100).map(|seed| Scene::generate(difficulty, seed)) {
                for (i, part) in scene.parts.iter().enumerate() {
                    let to_edge = scene.side_m / 2.0 - part.at_m.amax() - part.radius_m;
                    assert!(to_edge >= 0.0, "{difficulty:?} {}", scene.seed);
                    at_edge += usize::from(to_edge < 5e-4);
                    let apart = |other: &SceneDisc| (other.at_m - part.at_m).norm() >= other.radius_m + part.radius_m;
                    assert!(scene.parts[..i].iter().all(apart), "{difficulty:?} {}", scene.seed);
                    let clear =
                        |cover: &super::super::ClutterShape| cover.shape.depth(part.at_m) < -part.radius_m - 1e-3;
                    assert!(scene.occluders.iter().all(clear), "{difficulty:?} {}", scene.seed);
                    let kind = &kinds()[part.kind];
                    assert_eq!((part.radius_m, part.thickness_m), (kind.radius_m, kind.thickness_m));
                }
                assert!((1..=MOST_PARTS).contains(&scene.parts.len()));
                with_touching += usize::from(touching(&scene) > 0);
                parts += scene.parts.len();
            }
            assert!(
                with_touching >= 50 && at_edge > 30 && parts > 1200,
                "{difficulty:?}: {with_touching} {at_edge} {parts}"
            );
        }
    }
}
