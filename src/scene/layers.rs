//! The surfaces of a scene, and their gray levels.

use super::{ClutterOutline, ClutterShape, Glint, Scene, SceneDisc, SurfaceTexture};
use upm_core::geometry::Vec2;

/// A surface and its outline.
pub(super) struct PaintLayer<'a> {
    pub(super) shape: ClutterOutline,
    pub(super) paint: Paint<'a>,
}

impl Scene {
    /// All surfaces on the ground, later ones in front.
    pub(super) fn layers<'a>(&'a self, parts: &'a [SceneDisc]) -> Vec<PaintLayer<'a>> {
        let things = |things: &'a [ClutterShape]| {
            things.iter().map(|thing| PaintLayer { shape: thing.shape.clone(), paint: Paint::flat(thing.level) })
        };
        let [_, level, _] = self.levels;
        let plate_paint = Paint { level, frame: (Vec2::zeros(), 1.0), relief: None, glints: &self.glints };
        let plate = PaintLayer { shape: ClutterOutline::square(self.side_m), paint: plate_paint };
        // the hull of a part's foot and of its top as the camera projects it
        let silhouette = |part| ClutterOutline::Hull(self.seen_circles(part));
        let parts = parts.iter().map(|part| PaintLayer { shape: silhouette(part), paint: self.face(part) });
        things(&self.clutter).chain([plate]).chain(parts).chain(things(&self.occluders)).collect()
    }

    fn face<'a>(&self, part: &'a SceneDisc) -> Paint<'a> {
        let [_, plate, level] = self.levels;
        let [_, top] = self.seen_circles(part);
        let relief = part.relief.map(|relief| (relief, plate - level));
        Paint { level, frame: top, relief, glints: &part.glints }
    }
}

/// Gray levels of a surface.
pub(super) struct Paint<'a> {
    /// Gray level outside relief and glints.
    pub(super) level: f64,
    /// Origin of relief and glints, m, and the length of their unit, m.
    pub(super) frame: (Vec2, f64),
    /// Texture, and the step in level of which its amplitude is a fraction.
    pub(super) relief: Option<(SurfaceTexture, f64)>,
    pub(super) glints: &'a [Glint],
}

impl Paint<'_> {
    /// One gray level all over.
    pub(super) fn flat(level: f64) -> Self {
        Self { level, frame: (Vec2::zeros(), 1.0), relief: None, glints: &[] }
    }

    /// True when it is one gray level within `reach_m` of `p_m`.
    pub(super) fn is_flat_near(&self, p_m: Vec2, reach_m: f64) -> bool {
        let (origin, unit) = self.frame;
        let q = (p_m - origin) / unit;
        let reach = reach_m / unit;
        let far = |glint: &Glint| (q - glint.at).norm() > reach + glint.half_axes[0].max(glint.half_axes[1]);
        self.relief.is_none() && self.glints.iter().all(far)
    }

    pub(super) fn level_at(&self, p_m: Vec2) -> f64 {
        let (origin, unit) = self.frame;
        let q = (p_m - origin) / unit;
        let relief = self.relief.as_ref().map_or(0.0, |(relief, step)| step * relief.height_at(q));
        self.glints.iter().fold(self.level + relief, |level, glint| level + (glint.level - level) * glint.share_at(q))
    }
}

impl SurfaceTexture {
    /// Height at `q`, at most the amplitude in magnitude.
    fn height_at(&self, q: Vec2) -> f64 {
        let waves: f64 = self.waves.iter().map(|(k, phase)| (k.dot(&q) + phase).cos()).sum();
        let [radius, width] = self.ring;
        let ring = (-0.5 * ((q.norm() - radius) / width).powi(2)).exp();
        self.amplitude * (waves / 3.0 + ring) / 2.0
    }
}

impl Glint {
    /// Smooth weight, from 1 in its middle half to 0 at its outline.
    fn share_at(&self, q: Vec2) -> f64 {
        let (sin, cos) = self.direction_rad.sin_cos();
        let d = q - self.at;
        let [a, b] = self.half_axes;
        let r = ((d.x * cos + d.y * sin) / a).hypot((d.y * cos - d.x * sin) / b);
        let t = (2.0 - 2.0 * r).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    }
}
