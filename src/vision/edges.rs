//! Edge map: smoothed, Scharr gradient, thinned along the gradient, kept by hysteresis (Canny, 1986).
//! Thresholds follow the picture's own strongest edges and its noise, so light and contrast do not matter.

use super::Plane;
use crate::geometry::Vec2;
use crate::signal::Frame;

/// Longest side of the picture edges are looked for in; larger frames are averaged down to it.
const LONGEST_PX: usize = 2048;
/// Weakest gradient that counts as an edge at all, levels/px.
const FAINTEST: f32 = 1.5;

/// One edge pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct EdgePoint {
    /// Where, px of the frame, below a pixel.
    pub(super) at_px: Vec2,
    /// Gradient there: towards the light, levels/px of the averaged picture.
    pub(super) gradient: Vec2,
}

/// All edges of a frame.
pub(super) struct EdgeMap {
    pub(super) points: Vec<EdgePoint>,
    pub(super) plane: Plane,
    /// Pixels of the frame along one side of a pixel of `plane`.
    pub(super) bin: usize,
}

struct Gradient {
    width: usize,
    height: usize,
    x: Vec<f32>,
    y: Vec<f32>,
    size: Vec<f32>,
}

/// The edges of `frame`, whose size and pixels must agree.
pub(super) fn edge_map(frame: &Frame) -> EdgeMap {
    let bin = frame.width.max(frame.height).div_ceil(LONGEST_PX).max(1);
    let gradient = scharr(&smoothed(averaged(frame, bin)));
    let (low, high) = thresholds(&gradient);
    let (points, plane) = linked(&gradient, low, high, bin);
    EdgeMap { points, plane, bin }
}

/// The frame averaged over squares of `bin` pixels; what does not fill a square is left out.
pub(super) fn averaged(frame: &Frame, bin: usize) -> Plane {
    let (width, height) = (frame.width / bin, frame.height / bin);
    let mut values = vec![0.0f32; width * height];
    if width == 0 {
        return Plane { width, height, values };
    }
    let share = 1.0 / (bin * bin) as f32;
    for (y, row) in values.chunks_exact_mut(width).enumerate() {
        for source in y * bin..(y + 1) * bin {
            for (value, square) in row.iter_mut().zip(frame.row(source).chunks_exact(bin)) {
                *value += square.iter().map(|&level| f32::from(level)).sum::<f32>();
            }
        }
        row.iter_mut().for_each(|value| *value *= share);
    }
    Plane { width, height, values }
}

/// Binomial smoothing over five pixels each way, a Gaussian of 1 px standard deviation.
fn smoothed(plane: Plane) -> Plane {
    const TAPS: [f32; 5] = [1.0 / 16.0, 4.0 / 16.0, 6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0];
    let Plane { width, height, mut values } = plane;
    if width == 0 || height == 0 {
        return Plane { width, height, values };
    }
    let mut padded = vec![0.0f32; width + 4];
    for row in values.chunks_exact_mut(width) {
        padded[..2].fill(row[0]);
        padded[2..width + 2].copy_from_slice(row);
        padded[width + 2..].fill(row[width - 1]);
        for (value, w) in row.iter_mut().zip(padded.windows(5)) {
            *value = TAPS[0] * (w[0] + w[4]) + TAPS[1] * (w[1] + w[3]) + TAPS[2] * w[2];
        }
    }
    let mut out = vec![0.0f32; values.len()];
    for (y, target) in out.chunks_exact_mut(width).enumerate() {
        for (k, tap) in TAPS.iter().enumerate() {
            let source = (y + k).saturating_sub(2).min(height - 1);
            for (t, s) in target.iter_mut().zip(&values[source * width..][..width]) {
                *t += tap * s;
            }
        }
    }
    Plane { width, height, values: out }
}

/// Scharr's 3 × 3 derivative, the one of its size whose direction is truest (Scharr, 2000); 0 on the border.
fn scharr(plane: &Plane) -> Gradient {
    let (width, height) = (plane.width, plane.height);
    let [mut gx, mut gy, mut size] = [(); 3].map(|()| vec![0.0f32; width * height]);
    for y in 1..height.saturating_sub(1) {
        let [a, b, c] = [y - 1, y, y + 1].map(|row| &plane.values[row * width..][..width]);
        let range = y * width..(y + 1) * width;
        let (gx, gy, size) = (&mut gx[range.clone()], &mut gy[range.clone()], &mut size[range]);
        for x in 1..width.saturating_sub(1) {
            let h = 3.0 * (a[x + 1] - a[x - 1] + c[x + 1] - c[x - 1]) + 10.0 * (b[x + 1] - b[x - 1]);
            let v = 3.0 * (c[x - 1] - a[x - 1] + c[x + 1] - a[x + 1]) + 10.0 * (c[x] - a[x]);
            gx[x] = h / 32.0;
            gy[x] = v / 32.0;
            size[x] = (h * h + v * v).sqrt() / 32.0;
        }
    }
    Gradient { width, height, x: gx, y: gy, size }
}

/// Low and high threshold. The strongest gradients set the scale: as many pixels as an eighth of the frame's
/// half circumference exceed it. The median gradient is that of the noise, which must stay below.
fn thresholds(gradient: &Gradient) -> (f32, f32) {
    const BINS: usize = 2048;
    let largest = gradient.size.iter().fold(0.0f32, |a, &b| a.max(b));
    if largest < FAINTEST {
        return (f32::INFINITY, f32::INFINITY);
    }
    let mut counts = [0usize; BINS];
    let per_bin = largest / (BINS - 1) as f32;
    for &size in &gradient.size {
        counts[((size / per_bin) as usize).min(BINS - 1)] += 1;
    }
    let exceeded_by = |wanted: usize| {
        let mut seen = 0;
        let bin = (0..BINS).rev().find(|&bin| {
            seen += counts[bin];
            seen >= wanted
        });
        bin.unwrap_or(0) as f32 * per_bin
    };
    let strongest = exceeded_by((gradient.width + gradient.height).div_ceil(8));
    let noise = exceeded_by(gradient.size.len() / 2);
    if strongest < 5.0 * noise || strongest < FAINTEST {
        return (f32::INFINITY, f32::INFINITY);
    }
    ((0.1 * strongest).max(3.0 * noise), (0.25 * strongest).max(4.5 * noise))
}

/// Thins edges to ridges of the gradient and keeps ridges above `low` that hang together with one above `high`.
fn linked(gradient: &Gradient, low: f32, high: f32, bin: usize) -> (Vec<EdgePoint>, Plane) {
    let (width, height) = (gradient.width, gradient.height);
    let mut offset = vec![f32::NAN; width * height];
    let mut open = Vec::new();
    for y in 2..height.saturating_sub(2) {
        for x in 2..width.saturating_sub(2) {
            let i = y * width + x;
            if gradient.size[i] >= low
                && let Some(ridge) = ridge_offset(gradient, x, y)
            {
                offset[i] = ridge;
                if gradient.size[i] >= high {
                    open.push(i);
                }
            }
        }
    }
    let mut plane = Plane { width, height, values: vec![0.0; width * height] };
    open.iter().for_each(|&i| plane.values[i] = gradient.size[i]);
    while let Some(i) = open.pop() {
        for j in [i - width, i, i + width].into_iter().flat_map(|row| row - 1..=row + 1) {
            if plane.values[j] == 0.0 && !offset[j].is_nan() {
                plane.values[j] = gradient.size[j];
                open.push(j);
            }
        }
    }
    let points = (0..plane.values.len()).filter(|&i| plane.values[i] > 0.0).map(|i| {
        let slope = Vec2::new(f64::from(gradient.x[i]), f64::from(gradient.y[i]));
        let cell = Vec2::new((i % width) as f64, (i / width) as f64) + slope.normalize() * f64::from(offset[i]);
        EdgePoint { at_px: frame_from_binned(cell, bin), gradient: slope }
    });
    (points.collect(), plane)
}

/// Frame coordinates of a point of a picture averaged over squares of `bin` pixels.
pub(super) fn frame_from_binned(p: Vec2, bin: usize) -> Vec2 {
    let bin = bin as f64;
    p * bin + Vec2::repeat((bin - 1.0) / 2.0)
}

/// How far along its gradient the ridge runs from pixel `(x, y)`, px; `None` when the pixel is not on a ridge.
fn ridge_offset(gradient: &Gradient, x: usize, y: usize) -> Option<f32> {
    let i = y * gradient.width + x;
    let size = gradient.size[i];
    let (dx, dy) = (gradient.x[i] / size, gradient.y[i] / size);
    let at = |dx: f32, dy: f32| {
        let (column, row) = (x as f32 + dx, y as f32 + dy);
        let (fx, fy) = (column - column.floor(), row - row.floor());
        let start = row as usize * gradient.width + column as usize;
        let mix = |j: usize| gradient.size[j] + fx * (gradient.size[j + 1] - gradient.size[j]);
        mix(start) + fy * (mix(start + gradient.width) - mix(start))
    };
    let (ahead, behind) = (at(dx, dy), at(-dx, -dy));
    (size > ahead && size >= behind).then(|| 0.5 * (ahead - behind) / (2.0 * size - ahead - behind))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_one_line_of_edges_in_the_right_place() {
        let mut frame = Frame::new(40, 30);
        for row in frame.pixels.chunks_exact_mut(40) {
            row[17..].fill(200);
        }
        let map = edge_map(&frame);
        assert_eq!(map.points.len(), 26);
        for point in &map.points {
            assert!((point.at_px.x - 16.5).abs() < 0.05, "{point:?}");
            assert!(point.gradient.x > 40.0 && point.gradient.y.abs() < 1e-3);
        }
        assert_eq!(map.plane.values.iter().filter(|&&v| v > 0.0).count(), 26);
    }

    #[test]
    fn flat_and_tiny_pictures_have_no_edges() {
        for (width, height) in [(1, 1), (2, 50), (5000, 3), (64, 64)] {
            assert!(edge_map(&Frame::new(width, height)).points.is_empty());
        }
    }

    #[test]
    fn averaging_keeps_places() {
        let mut frame = Frame::new(6, 4);
        frame.pixels[6 + 3] = 40;
        let plane = averaged(&frame, 2);
        assert_eq!((plane.width, plane.height), (3, 2));
        assert_eq!(plane.values, [0.0, 10.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(frame_from_binned(Vec2::new(1.0, 0.0), 2), Vec2::new(2.5, 0.5));
    }
}
