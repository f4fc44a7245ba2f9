//! Gray level of every pixel by the area of it that each surface covers. Squares of pixels are halved until no outline
//! crosses them; of single pixels that one does cross, the area is found.

use super::layers::Layer;
use super::paint::Paint;
use super::{Disc, Scene};
use crate::geometry::Vec2;

/// Side of the squares begun with, and of those that are evaluated pixel by pixel, px.
const LARGEST: usize = 64;
const SMALLEST: usize = 8;
/// Table coordinates are exact at the corners of squares of so many pixels, bilinear between: off by 0.001 px or less for
/// lenses and tilts as they are drawn.
const CELL: usize = 4;
/// Lines across a pixel along which one outline is intersected, and points a side where several meet.
const LINES: u32 = 12;
const POINTS: u32 = 12;

impl Scene {
    /// Gray levels before light, lens and noise, row by row.
    pub(super) fn levels_by_area(&self, parts: &[Disc]) -> Vec<f32> {
        let layers = self.layers(parts);
        let [width, height] = self.size_px;
        let mut raster = Raster {
            layers: &layers,
            ground: Paint::flat(self.levels[0]),
            places: Places::new(self),
            size: self.size_px,
            levels: vec![0.0; width * height],
        };
        let all: Vec<usize> = (0..layers.len()).collect();
        for y in (0..height).step_by(LARGEST) {
            for x in (0..width).step_by(LARGEST) {
                raster.square([x, y], LARGEST, &all, None);
            }
        }
        raster.levels
    }
}

/// Table coordinates of pixel corners: `(x, y)` is the top left corner of pixel `(x, y)`.
struct Places {
    exact: Vec<Vec2>,
    columns: usize,
}

impl Places {
    fn new(scene: &Scene) -> Self {
        let table_from_ideal = scene.ideal_from_table().inverse();
        let [columns, rows] = scene.size_px.map(|n| n.next_multiple_of(LARGEST) / CELL + 2);
        let place = |i: usize| {
            let p = Vec2::new((i % columns * CELL) as f64 - 0.5, (i / columns * CELL) as f64 - 0.5);
            let ideal = if scene.lens.is_ideal() { p } else { scene.lens.ideal_from_image(p) };
            table_from_ideal.map_or(ideal, |map| map.apply(ideal))
        };
        Self { exact: (0..columns * rows).map(place).collect(), columns }
    }

    fn at(&self, x: usize, y: usize) -> Vec2 {
        let (i, u, v) =
            (y / CELL * self.columns + x / CELL, (x % CELL) as f64 / CELL as f64, (y % CELL) as f64 / CELL as f64);
        let below = i + self.columns;
        let top = self.exact[i] * (1.0 - u) + self.exact[i + 1] * u;
        let bottom = self.exact[below] * (1.0 - u) + self.exact[below + 1] * u;
        top * (1.0 - v) + bottom * v
    }

    /// Corners of a square of pixels: top left, top right, bottom left, bottom right.
    fn corners(&self, [x, y]: [usize; 2], side: usize) -> [Vec2; 4] {
        [self.at(x, y), self.at(x + side, y), self.at(x, y + side), self.at(x + side, y + side)]
    }
}

struct Raster<'a> {
    layers: &'a [Layer<'a>],
    ground: Paint<'a>,
    places: Places,
    size: [usize; 2],
    levels: Vec<f32>,
}

impl Raster<'_> {
    /// Paints a square of pixels. `crossing` are the layers, in order, whose outline may cross it, `behind` is what
    /// covers it behind those.
    fn square(&mut self, at: [usize; 2], side: usize, crossing: &[usize], behind: Option<usize>) {
        let [x, y] = at;
        if x >= self.size[0] || y >= self.size[1] {
            return;
        }
        let corners = self.places.corners(at, side);
        let middle = corners.iter().sum::<Vec2>() / 4.0;
        let reach = 1.05 * corners.iter().map(|corner| (corner - middle).norm()).fold(0.0, f64::max);
        let (mut behind, mut left) = (behind, Vec::new());
        for &layer in crossing {
            let depth = self.layers[layer].shape.depth(middle);
            if depth > reach {
                left.clear();
                behind = Some(layer);
            } else if depth > -reach {
                left.push(layer);
            }
        }
        let flat = self.paint(behind).is_flat_near(middle, reach);
        if side > 1 && !(left.is_empty() && (flat || side <= SMALLEST)) {
            let half = side / 2;
            for (dx, dy) in [(0, 0), (half, 0), (0, half), (half, half)] {
                self.square([x + dx, y + dy], half, &left, behind);
            }
        } else if left.is_empty() {
            self.fill(at, side, behind, flat);
        } else {
            self.levels[y * self.size[0] + x] = self.crossed_pixel(corners, middle, reach, &left, behind) as f32;
        }
    }

    fn paint(&self, layer: Option<usize>) -> &Paint<'_> {
        layer.map_or(&self.ground, |layer| &self.layers[layer].paint)
    }

    fn fill(&mut self, [x, y]: [usize; 2], side: usize, layer: Option<usize>, flat: bool) {
        let [width, height] = self.size;
        for row in y..(y + side).min(height) {
            for column in x..(x + side).min(width) {
                let paint = self.paint(layer);
                let level = if flat {
                    paint.level
                } else {
                    paint.level_at(self.places.corners([column, row], 1).iter().sum::<Vec2>() / 4.0)
                };
                self.levels[row * width + column] = level as f32;
            }
        }
    }

    fn crossed_pixel(
        &self,
        corners: [Vec2; 4],
        middle: Vec2,
        reach: f64,
        crossing: &[usize],
        behind: Option<usize>,
    ) -> f64 {
        let back = self.paint(behind).level_at(middle);
        if let &[layer] = crossing
            && !self.layers[layer].shape.has_corner_near(middle, reach)
        {
            let layer = &self.layers[layer];
            return back + (layer.paint.level_at(middle) - back) * area_inside(layer, corners);
        }
        let fronts: Vec<(usize, f64)> =
            crossing.iter().rev().map(|&layer| (layer, self.layers[layer].paint.level_at(middle))).collect();
        let (n, m) = (f64::from(POINTS), f64::from(POINTS * POINTS));
        let sum: f64 = (0..POINTS * POINTS)
            .map(|i| {
                let (column, row) = (f64::from(i % POINTS), f64::from(i / POINTS));
                // Sheared both ways: every point has a column and a row of its own, so that edges along the pixels
                // are seen as finely as others.
                let (u, v) = (column / n + (row + 0.5) / m, row / n + (column + 0.5) / m);
                let p = within(corners, u, v);
                fronts.iter().find(|front| self.layers[front.0].shape.depth(p) > 0.0).map_or(back, |front| front.1)
            })
            .sum();
        sum / m
    }
}

/// A point of the square between four corners.
fn within(corners: [Vec2; 4], u: f64, v: f64) -> Vec2 {
    let top = corners[0] + (corners[1] - corners[0]) * u;
    let bottom = corners[2] + (corners[3] - corners[2]) * u;
    top + (bottom - top) * v
}

/// Share of a pixel that lies inside a smooth outline: along lines across it, which meet it once, exactly.
fn area_inside(layer: &Layer, corners: [Vec2; 4]) -> f64 {
    let depth = |p: Vec2| layer.shape.depth(p);
    let [a, b, c, d] = corners.map(depth);
    let upright = (c - a + d - b).abs() > (b - a + d - c).abs();
    let lines = (0..LINES).map(|i| {
        let s = (f64::from(i) + 0.5) / f64::from(LINES);
        let at = |t: f64| depth(if upright { within(corners, s, t) } else { within(corners, t, s) });
        let (from, to) = (at(0.0), at(1.0));
        match (from > 0.0, to > 0.0) {
            (true, true) => 1.0,
            (false, false) => 0.0,
            (inside_first, _) => {
                let chord = from / (from - to);
                // One step more, for rims are round.
                let meets = (chord + at(chord) / (from - to)).clamp(0.0, 1.0);
                if inside_first { meets } else { 1.0 - meets }
            }
        }
    });
    lines.sum::<f64>() / f64::from(LINES)
}
