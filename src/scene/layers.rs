use super::paint::Paint;
use super::{Disc, Scene, Shape};
use upm_core::geometry::Vec2;

/// A surface and how far it goes.
pub(super) struct Layer<'a> {
    pub(super) shape: Shape,
    pub(super) paint: Paint<'a>,
}

impl Scene {
    /// All that lies on the ground, later ones in front.
    pub(super) fn layers<'a>(&'a self, parts: &'a [Disc]) -> Vec<Layer<'a>> {
        let things = |things: &'a [super::Thing]| {
            things.iter().map(|thing| Layer { shape: thing.shape.clone(), paint: Paint::flat(thing.level) })
        };
        let [_, level, _] = self.levels;
        let plate_paint = Paint { level, frame: (Vec2::zeros(), 1.0), relief: None, glints: &self.glints };
        let plate = Layer { shape: Shape::square(self.side_m), paint: plate_paint };
        let parts = parts.iter().map(|part| Layer { shape: self.silhouette(part), paint: self.face(part) });
        things(&self.strays).chain([plate]).chain(parts).chain(things(&self.covers)).collect()
    }

    fn face<'a>(&self, part: &'a Disc) -> Paint<'a> {
        let [_, plate, level] = self.levels;
        let [_, top] = self.seen_circles(part);
        let relief = part.relief.map(|relief| (relief, plate - level));
        Paint { level, frame: top, relief, glints: &part.glints }
    }
}
