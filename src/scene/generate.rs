use std::f64::consts::TAU;

use nalgebra::Vector3;
use rand::RngExt;

use super::Scene;
use upm_core::geometry::{Lens, Vec2};
use upm_core::random::{Rng, Streams};
use upm_core::units::INCH_M;

/// Frame kept free around the table, as a fraction of its height or width, both sides taken together.
const FREE_SHARE: f64 = 0.03;
/// Largest fraction of the frame's height or width that the table's outline may take up.
const LARGEST_SHARE: f64 = 0.955;

upm_core::coded_enum! {
    /// Families of scenes by difficulty.
    pub enum Difficulty {
        /// Four kinds of black parts on a white plate, tilted and distorted, no noise, even light, blur 0.8 px.
        Clean = "clean",
        /// The clean scene of the same seed with noise of 8 levels, blur 1.5 px, light that falls off by 40 %.
        Rough = "rough",
        /// Table from 40 to 95 % of the frame's height, tilt to 10°, turn to 40°, light that falls off by up to 50 %,
        /// noise to 8 levels, both polarities; reliefs, glints, objects on the ground, part of one side hidden, each in
        /// some scenes.
        Hard = "hard",
        /// The papers' table: 8 in, 16 pennies, seen straight from above by an ideal lens of 4 picture widths focal
        /// length.
        Papers = "papers",
    }
}

impl Scene {
    /// The scene of `seed` in this difficulty; equal seeds give equal pictures.
    pub fn generate(difficulty: Difficulty, seed: u64) -> Self {
        let streams = Streams::new(seed);
        let stream = |name: &str| SceneSampler(streams.stream(name));
        let mut scene = Self::plain(seed);
        match difficulty {
            Difficulty::Clean | Difficulty::Rough => {
                // black parts on a white plate on dark ground
                let mut levels = stream("clean levels");
                scene.levels = [levels.within(10.0, 40.0), levels.within(190.0, 230.0), levels.within(20.0, 50.0)];
                scene.draw_view(&mut stream("clean view"), [0.6, 0.95], 5.0, [1.5, 3.5]);
                scene.draw_parts(&mut stream("clean parts"), None);
                if difficulty == Difficulty::Rough {
                    (scene.noise_sd, scene.blur_px, scene.shading) = (8.0, 1.5, 0.4);
                    scene.shading_direction_rad = stream("rough light").within(0.0, TAU);
                }
            }
            Difficulty::Hard => {
                scene.draw_hard_light(&mut stream("hard light"));
                scene.draw_view(&mut stream("hard view"), [0.4, 0.95], 10.0, [1.2, 4.0]);
                scene.draw_occluders(&mut stream("hard covers"));
                scene.draw_parts(&mut stream("hard parts"), None);
                scene.draw_clutter(&mut stream("hard strays"));
                scene.draw_faces(&mut stream("hard faces"));
            }
            Difficulty::Papers => {
                let mut sampler = stream("papers view");
                let [width, height] = scene.size_px.map(|n| n as f64);
                scene.lens = Lens::ideal(4.0 * width, Vec2::new(0.5 * (width - 1.0), 0.5 * (height - 1.0)));
                scene.tilt_rad = [0.0, 0.0, sampler.around(0.15)];
                scene.hang(sampler.within(0.7, 0.9), [sampler.around(1.0), sampler.around(1.0)]);
                (scene.noise_sd, scene.shading) = (2.0, 0.15);
                scene.shading_direction_rad = sampler.within(0.0, TAU);
                scene.draw_parts(&mut stream("papers parts"), Some(16));
            }
        }
        scene
    }

    /// Both polarities, any light.
    fn draw_hard_light(&mut self, sampler: &mut SceneSampler) {
        let white_parts = sampler.chance(0.4);
        self.levels = if white_parts {
            let ground = if sampler.chance(0.5) { sampler.within(95.0, 140.0) } else { sampler.within(170.0, 230.0) };
            [ground, sampler.within(15.0, 40.0), sampler.within(150.0, 235.0)]
        } else {
            [sampler.within(8.0, 60.0), sampler.within(150.0, 235.0), sampler.within(15.0, 60.0)]
        };
        self.shading = sampler.within(0.0, 0.5);
        self.shading_direction_rad = sampler.within(0.0, TAU);
        self.noise_sd = sampler.within(0.0, 8.0);
        self.blur_px = sampler.within(0.6, 1.5);
    }

    /// Plate, lens and camera: the table's side as a share of the frame's height, largest tilt, focal length in picture
    /// widths.
    fn draw_view(
        &mut self,
        sampler: &mut SceneSampler,
        side_share: [f64; 2],
        most_tilt_deg: f64,
        focal_widths: [f64; 2],
    ) {
        self.side_m = INCH_M * if sampler.chance(0.5) { 8.0 } else { 12.0 };
        let [width, height] = self.size_px.map(|n| n as f64);
        let focal_px =
            width * (focal_widths[0].ln() + sampler.within(0.0, 1.0) * (focal_widths[1] / focal_widths[0]).ln()).exp();
        let principal_px = Vec2::new(0.5 * width + sampler.around(10.0), 0.5 * height + sampler.around(10.0));
        let radial = [sampler.within(-0.18, 0.06), sampler.around(0.03)];
        let tangential = [sampler.around(4e-4), sampler.around(4e-4)];
        self.lens = Lens { focal_px, principal_px, radial, tangential };
        let (sin, cos) = sampler.within(0.0, TAU).sin_cos();
        let (tilt, turn) = (sampler.within(0.0, most_tilt_deg).to_radians(), sampler.around(40.0).to_radians());
        // Only a table that is hardly turned can fill the frame.
        let turn = if sampler.chance(0.25) { 0.05 * turn } else { turn };
        self.tilt_rad = [tilt * cos, tilt * sin, turn];
        self.hang(sampler.within(side_share[0], side_share[1]), [sampler.around(1.0), sampler.around(1.0)]);
    }

    /// Places the camera so that the mean side is `side_share` of the frame's height, or less where the table would not
    /// be wholly in the frame; `place` is the table's position in the frame, from -1 to 1 along either axis.
    fn hang(&mut self, side_share: f64, place: [f64; 2]) {
        let size = Vec2::new(self.size_px[0] as f64, self.size_px[1] as f64);
        let to_table = self.camera_from_table().transpose();
        let focal_px = self.lens.focal_px;
        let mut table_in_camera_m = Vector3::new(0.0, 0.0, focal_px * self.side_m / (side_share * size.y));
        for _ in 0..8 {
            self.camera_m = -to_table * table_in_camera_m;
            let outline = self.table_outline_px();
            let (first, last) = outline.iter().fold((outline[0], outline[0]), |(a, b), p| (a.inf(p), b.sup(p)));
            let extent = last - first;
            let corners = self.corners_px();
            let side_px = (0..4).map(|i| (corners[(i + 1) % 4] - corners[i]).norm()).sum::<f64>() / 4.0;
            let too_large = extent.component_div(&(size * LARGEST_SHARE)).max();
            let farther = too_large.max(side_px / (side_share * size.y));
            let room = ((size * (1.0 - FREE_SHARE) - extent / farther) / 2.0).sup(&Vec2::zeros());
            let center = (size - Vec2::repeat(1.0)) / 2.0 + room.component_mul(&Vec2::from(place));
            let seen = self.lens.principal_px + ((first + last) / 2.0 - self.lens.principal_px) / farther;
            table_in_camera_m *= farther;
            let shift = (center - seen) * table_in_camera_m.z / focal_px;
            table_in_camera_m += Vector3::new(shift.x, shift.y, 0.0);
        }
        self.camera_m = -to_table * table_in_camera_m;
    }

    /// Points along the sides in the picture, px; 16 a side.
    pub(super) fn table_outline_px(&self) -> [Vec2; 64] {
        std::array::from_fn(|i| {
            let along = (i % 16) as f64 / 8.0 - 1.0;
            let (sin, cos) = (TAU * (i / 16) as f64 / 4.0).sin_cos();
            let p = Vec2::new(cos - along * sin, sin + along * cos);
            self.image_from_table(p * (self.side_m / 2.0))
        })
    }
}

/// Random numbers for drawing scenes.
pub(super) struct SceneSampler(Rng);

impl SceneSampler {
    pub(super) fn within(&mut self, from: f64, to: f64) -> f64 {
        self.0.random_range(from..to)
    }

    /// A number from `-most` to `most`.
    pub(super) fn around(&mut self, most: f64) -> f64 {
        self.within(-most, most)
    }

    /// One of `0..n`.
    pub(super) fn one_of(&mut self, n: usize) -> usize {
        self.0.random_range(0..n)
    }

    pub(super) fn chance(&mut self, share: f64) -> bool {
        self.within(0.0, 1.0) < share
    }

    pub(super) fn direction(&mut self) -> Vec2 {
        let (sin, cos) = self.within(0.0, TAU).sin_cos();
        Vec2::new(cos, sin)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SEEDS: u64 = 150;

    fn scenes(difficulty: Difficulty) -> impl Iterator<Item = Scene> {
        (0..SEEDS).map(move |seed| Scene::generate(difficulty, seed))
    }

    #[test]
    fn table_is_wholly_in_the_frame_and_large_enough() {
        for (difficulty, least, most_tilt) in
            [(Difficulty::Clean, 0.55, 5.0), (Difficulty::Hard, 0.4, 10.0), (Difficulty::Papers, 0.7, 0.0)]
        {
            let mut shares = Vec::new();
            for scene in scenes(difficulty) {
                let [width, height] = scene.size_px.map(|n| n as f64);
                for p in scene.table_outline_px() {
                    let margin = p.x.min(p.y).min(width - 1.0 - p.x).min(height - 1.0 - p.y);
                    assert!(margin > 0.012 * height, "{difficulty:?} {}: {margin} px", scene.seed);
                }
                let corners = scene.corners_px();
                let side_px = (0..4).map(|i| (corners[(i + 1) % 4] - corners[i]).norm()).sum::<f64>() / 4.0;
                shares.push(side_px / height);
                let axis = scene.camera_from_table().row(2).transpose();
                assert!((-axis.z).acos().to_degrees() < most_tilt + 1e-6);
                let [a, b, c, d] = corners;
                let right = b - a + c - d;
                assert!(right.y.atan2(right.x).to_degrees().abs() < 45.0, "{difficulty:?} {}", scene.seed);
            }
            let (smallest, largest) = shares.iter().fold((1.0f64, 0.0f64), |(a, b), &s| (a.min(s), b.max(s)));
            assert!(smallest > least - 0.005 && smallest < least + 0.1, "{difficulty:?}: {smallest}");
            assert!(largest > 0.88 && largest < 0.955, "{difficulty:?}: {largest}");
        }
    }

    #[test]
    fn rough_scenes_are_clean_ones_in_worse_light() {
        for (clean, rough) in scenes(Difficulty::Clean).zip(scenes(Difficulty::Rough)) {
            assert_eq!(
                (clean.corners_px(), clean.truth(), clean.levels),
                (rough.corners_px(), rough.truth(), rough.levels)
            );
            assert_eq!((clean.noise_sd, clean.blur_px, clean.shading), (0.0, 0.8, 0.0));
            assert_eq!((rough.noise_sd, rough.blur_px, rough.shading), (8.0, 1.5, 0.4));
        }
    }

    #[test]
    fn equal_seeds_give_equal_pictures() {
        for difficulty in Difficulty::ALL {
            let draw = |seed| Scene::generate(difficulty, seed);
            assert_eq!(draw(5), draw(5));
            assert_ne!(draw(5), draw(6));
            assert_eq!(draw(5).frame(), draw(5).frame());
        }
    }

    #[test]
    fn all_difficulties_come_up() {
        let hard: Vec<Scene> = scenes(Difficulty::Hard).collect();
        let share =
            |has: &dyn Fn(&Scene) -> bool| hard.iter().filter(|scene| has(scene)).count() as f64 / hard.len() as f64;
        assert!((0.2..0.8).contains(&share(&|scene| scene.dark_parts())));
        assert!(share(&|scene| !scene.occluders.is_empty()) > 0.2);
        assert!(share(&|scene| !scene.clutter.is_empty()) > 0.3);
        assert!(share(&|scene| !scene.glints.is_empty()) > 0.2);
        assert!(share(&|scene| scene.parts.iter().any(|part| part.relief.is_some())) > 0.3);
        assert!(share(&|scene| scene.parts.iter().any(|part| !part.glints.is_empty())) > 0.3);
    }
}
