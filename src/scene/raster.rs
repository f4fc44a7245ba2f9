//! Gray level of every pixel by the area of it that each surface covers. Squares of pixels are halved until no outline
//! crosses them; for single pixels crossed by one, the covered area is computed.

use super::layers::{Paint, PaintLayer};
use super::{Scene, SceneDisc};
use upm_core::geometry::{Homography, Lens, Vec2};

/// Side of the initial squares, and of those that are evaluated pixel by pixel, px.
const LARGEST: usize = 64;
const SMALLEST: usize = 8;
/// Lines across a pixel along which one outline is intersected, and points a side where several outlines meet.
const LINES: u32 = 12;
const POINTS: u32 = 16;

impl Scene {
    /// Gray levels before light, lens and noise, row by row.
    pub(super) fn levels_by_area(&self, parts: &[SceneDisc]) -> Vec<f32> {
        let layers = self.layers(parts);
        let [width, height] = self.size_px;
        let mut raster = CoverageRaster {
            layers: &layers,
            ground: Paint::flat(self.levels[0]),
            lens: self.lens,
            table_from_ideal: self.ideal_from_table().inverse(),
            size: self.size_px,
            levels: vec![0.0; width * height],
        };
        let all: Vec<usize> = (0..layers.len()).collect();
        for y in (0..height).step_by(LARGEST) {
            for x in (0..width).step_by(LARGEST) {
                let (right, below) = (x + LARGEST, y + LARGEST);
                let corners = [(x, y), (right, y), (x, below), (right, below)].map(|(x, y)| raster.place(x, y));
                raster.square(PixelSquare { at: [x, y], side: LARGEST, corners }, &all, None);
            }
        }
        raster.levels
    }
}

/// Region of the picture that is filled at once or split into quarters.
#[derive(Clone, Copy)]
struct PixelSquare {
    /// Its first column and row.
    at: [usize; 2],
    /// Pixels along each side.
    side: usize,
    /// Table coordinates of its corners, m: top left, top right, bottom left, bottom right.
    corners: [Vec2; 4],
}

struct CoverageRaster<'a> {
    layers: &'a [PaintLayer<'a>],
    ground: Paint<'a>,
    lens: Lens,
    table_from_ideal: Option<Homography>,
    size: [usize; 2],
    levels: Vec<f32>,
}

impl CoverageRaster<'_> {
    /// Table coordinates of the top left corner of a pixel, m.
    fn place(&self, x: usize, y: usize) -> Vec2 {
        let p = Vec2::new(x as f64 - 0.5, y as f64 - 0.5);
        let ideal = if self.lens.is_ideal() { p } else { self.lens.ideal_from_image(p) };
        self.table_from_ideal.map_or(ideal, |map| map.apply(ideal))
    }

    /// Paints a square of pixels. `crossing` are the layers, in order, whose outline may cross it, `behind` is the
    /// layer that covers it behind those.
    fn square(&mut self, square: PixelSquare, crossing: &[usize], behind: Option<usize>) {
        let PixelSquare { at: [x, y], side, corners } = square;
        if x >= self.size[0] || y >= self.size[1] {
            return;
        }
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
            for quarter in self.quarters(square) {
                self.square(quarter, &left, behind);
            }
        } else if left.is_empty() {
            self.fill(square, behind, flat);
        } else {
            let back = self.paint(behind).level_at(middle);
            let level = match left[..] {
                [layer] if !self.layers[layer].shape.has_corner_near(middle, reach) => {
                    let layer = &self.layers[layer];
                    back + (layer.paint.level_at(middle) - back) * area_inside(layer, corners)
                }
                _ => {
                    let front = |&layer: &usize| (layer, self.layers[layer].paint.level_at(middle));
                    let fronts: Vec<(usize, f64)> = left.iter().rev().map(front).collect();
                    let (n, m) = (f64::from(POINTS), f64::from(POINTS * POINTS));
                    let level = |i: u32| {
                        let (column, row) = (f64::from(i % POINTS), f64::from(i / POINTS));
                        // Sheared along both axes: no two points share a column or a row, so that edges along the
                        // pixels are resolved as finely as others.
                        let (u, v) = (column / n + (row + 0.5) / m, row / n + (column + 0.5) / m);
                        let p = within(corners, u, v);
                        let covers = |front: &&(usize, f64)| self.layers[front.0].shape.depth(p) > 0.0;
                        fronts.iter().find(covers).map_or(back, |front| front.1)
                    };
                    (0..POINTS * POINTS).map(level).sum::<f64>() / m
                }
            };
            self.levels[y * self.size[0] + x] = level as f32;
        }
    }

    fn quarters(&self, PixelSquare { at: [x, y], side, corners: [a, b, c, d] }: PixelSquare) -> [PixelSquare; 4] {
        let half = side / 2;
        let [top, left, middle, right, bottom] =
            [(half, 0), (0, half), (half, half), (side, half), (half, side)].map(|(dx, dy)| self.place(x + dx, y + dy));
        let quarter = |dx: usize, dy: usize, corners| PixelSquare { at: [x + dx, y + dy], side: half, corners };
        [
            quarter(0, 0, [a, top, left, middle]),
            quarter(half, 0, [top, b, middle, right]),
            quarter(0, half, [left, middle, c, bottom]),
            quarter(half, half, [middle, right, bottom, d]),
        ]
    }

    fn paint(&self, layer: Option<usize>) -> &Paint<'_> {
        layer.map_or(&self.ground, |layer| &self.layers[layer].paint)
    }

    /// Paints a square that one surface covers; inside it pixels are evenly spaced on the plate.
    fn fill(&mut self, PixelSquare { at: [x, y], side, corners }: PixelSquare, layer: Option<usize>, flat: bool) {
        let [width, height] = self.size;
        for row in y..(y + side).min(height) {
            for column in x..(x + side).min(width) {
                let paint = self.paint(layer);
                let at = |u: f64, v: f64| {
                    let n = side as f64;
                    within(corners, ((column - x) as f64 + u) / n, ((row - y) as f64 + v) / n)
                };
                self.levels[row * width + column] = if flat { paint.level } else { mean_level(paint, at) } as f32;
            }
        }
    }
}

/// Mean over a pixel by four-point Gauss quadrature; `at` maps positions in the pixel, 0 to 1, to the plate.
fn mean_level(paint: &Paint, at: impl Fn(f64, f64) -> Vec2) -> f64 {
    let off = 0.5 / 3f64.sqrt();
    let (near, far) = (0.5 - off, 0.5 + off);
    let points = [(near, near), (near, far), (far, near), (far, far)];
    points.map(|(u, v)| paint.level_at(at(u, v))).iter().sum::<f64>() / 4.0
}

/// A point of the square between four corners.
fn within(corners: [Vec2; 4], u: f64, v: f64) -> Vec2 {
    let top = corners[0] + (corners[1] - corners[0]) * u;
    let bottom = corners[2] + (corners[3] - corners[2]) * u;
    top + (bottom - top) * v
}

/// Share of a pixel inside a smooth outline: by lines across it, each of which meets the outline once; exact for a
/// straight outline.
fn area_inside(layer: &PaintLayer, corners: [Vec2; 4]) -> f64 {
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
                // One further step, since rims are round.
                let meets = (chord + at(chord) / (from - to)).clamp(0.0, 1.0);
                if inside_first { meets } else { 1.0 - meets }
            }
        }
    });
    lines.sum::<f64>() / f64::from(LINES)
}
