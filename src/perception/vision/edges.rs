//! Edges of an averaged picture: Scharr gradient, thinned to ridges, selected by hysteresis (Canny, 1986). Thresholds
//! follow the picture's own strongest edges and its noise, so light and contrast do not matter.

use super::binned::{BinnedImage, UNITS};
use upm_core::geometry::Vec2;

/// Weakest gradient that counts as an edge at all, levels a cell.
const FAINTEST: f32 = 1.5;
/// Units of the gradient's size in one level a cell: Scharr's weights add up to 32.
const GRADIENT_UNITS: f32 = 32.0 * UNITS as f32;

/// One point of an edge.
#[derive(Clone, Copy, Debug)]
pub(super) struct EdgePoint {
    /// Position, px of the frame, to a fraction of a cell.
    pub(super) at_px: Vec2,
    /// Unit vector towards the dark.
    pub(super) outward: Vec2,
}

/// Gradient of the picture, cell by cell.
struct Gradient<'a> {
    width: usize,
    height: usize,
    /// Levels of which it is the gradient.
    levels: &'a [i16],
    /// Larger magnitude of the two components plus half the smaller: the length to -0 and +12 %.
    size: Vec<i16>,
}

/// A cell whose gradient is larger than on both sides along its own direction.
struct Ridge {
    cell: usize,
    /// The gradient at the cell, columns and rows.
    slope: [i16; 2],
    /// Offset of the ridge from the cell's middle, cells, along the axis nearer to the gradient.
    offset: f32,
}

/// The edges of a picture.
pub(super) fn edges(picture: &BinnedImage) -> Vec<EdgePoint> {
    edge_points(picture, |gradient| match thresholds(gradient) {
        Some((low, high)) => linked(gradient, ridges(gradient, low), high),
        None => Vec::new(),
    })
}

/// The steepest edges of a picture that may have texture everywhere: those among that share of its cells.
pub(super) fn steepest_edges(picture: &BinnedImage, share: f64) -> Vec<EdgePoint> {
    edge_points(picture, |gradient| {
        let sizes = Sizes::of(gradient);
        let least = sizes.exceeded_by((share * sizes.counted as f64) as usize).max(FAINTEST * GRADIENT_UNITS);
        ridges(gradient, least as i16)
    })
}

fn edge_points(picture: &BinnedImage, chosen: impl Fn(&Gradient) -> Vec<Ridge>) -> Vec<EdgePoint> {
    let smooth;
    // Averaged levels are smooth enough; single pixels are not.
    let levels = if picture.bin == 1 {
        smooth = smoothed(picture);
        &smooth
    } else {
        &picture.levels
    };
    let gradient = scharr(levels, picture.width, picture.height);
    chosen(&gradient).iter().map(|ridge| gradient.edge_at(ridge, picture)).collect()
}

/// Binomial smoothing over three cells along each axis.
fn smoothed(picture: &BinnedImage) -> Vec<i16> {
    let (width, height) = (picture.width, picture.height);
    let mut across = picture.levels.clone();
    if width < 3 || height < 3 {
        return across;
    }
    for (to, from) in across.chunks_exact_mut(width).zip(picture.levels.chunks_exact(width)) {
        let inner = to.get_mut(1..width - 1).into_iter().flatten();
        inner.zip(from.windows(3)).for_each(|(to, w)| *to = (w[0] + 2 * w[1] + w[2]) >> 2);
    }
    let mut out = across.clone();
    for y in 1..height - 1 {
        let [above, here, below] = [y - 1, y, y + 1].map(|row| &across[row * width..][..width]);
        let rows = above.iter().zip(here).zip(below);
        let target = out[y * width..][..width].iter_mut();
        target.zip(rows).for_each(|(to, ((a, b), c))| *to = (a + 2 * b + c) >> 2);
    }
    out
}

/// Scharr's 3 × 3 derivative, the one of its size with the least error of direction (Scharr, 2000); 0 on the border.
fn scharr(levels: &[i16], width: usize, height: usize) -> Gradient<'_> {
    let mut size = vec![0i16; width * height];
    if width < 3 || height < 3 {
        return Gradient { width, height, levels, size };
    }
    // Down the columns first: smoothed, and the difference.
    let [mut sum, mut step, mut gx, mut gy] = [(); 4].map(|()| vec![0i16; width]);
    for y in 1..height - 1 {
        let [above, here, below] = [y - 1, y, y + 1].map(|row| &levels[row * width..][..width]);
        let columns = above.iter().zip(here).zip(below);
        sum.iter_mut().zip(columns).for_each(|(sum, ((a, b), c))| *sum = 3 * (a + c) + 10 * b);
        step.iter_mut().zip(above.iter().zip(below)).for_each(|(step, (a, c))| *step = c - a);
        gx.iter_mut().zip(sum.windows(3)).for_each(|(gx, w)| *gx = w[2] - w[0]);
        gy.iter_mut().zip(step.windows(3)).for_each(|(gy, w)| *gy = 3 * (w[0] + w[2]) + 10 * w[1]);
        let target = &mut size[y * width + 1..][..width - 2];
        for (size, (gx, gy)) in target.iter_mut().zip(gx.iter().zip(&gy)) {
            let (x, y) = (gx.wrapping_abs(), gy.wrapping_abs());
            *size = x.max(y) + (x.min(y) >> 1);
        }
    }
    Gradient { width, height, levels, size }
}

/// Counts of the gradient's sizes in every fourth row.
struct Sizes {
    counts: [usize; (i16::MAX >> Sizes::SHIFT) as usize + 1],
    counted: usize,
}

impl Sizes {
    const SHIFT: i16 = 4;
    const EVERY: usize = 4;

    fn of(gradient: &Gradient) -> Self {
        let mut sizes = Self { counts: [0; (i16::MAX >> Self::SHIFT) as usize + 1], counted: 0 };
        for row in gradient.size.chunks_exact(gradient.width.max(1)).step_by(Self::EVERY) {
            row.iter().for_each(|&size| sizes.counts[(size.max(0) >> Self::SHIFT) as usize] += 1);
            sizes.counted += row.len();
        }
        sizes
    }

    /// The size that as many of the counted cells exceed.
    fn exceeded_by(&self, wanted: usize) -> f32 {
        let mut seen = 0;
        let bin = (0..self.counts.len()).rev().find(|&bin| {
            seen += self.counts[bin];
            seen >= wanted.max(1)
        });
        (bin.unwrap_or(0) << Self::SHIFT) as f32
    }
}

/// Low and high threshold, in the units of the gradient's size; `None` without an edge above the noise. The strongest
/// gradients set the scale: as many cells as an eighth of the picture's half circumference exceed it. The median
/// gradient is that of the noise, which must be below the threshold.
fn thresholds(gradient: &Gradient) -> Option<(i16, i16)> {
    let sizes = Sizes::of(gradient);
    let strongest = sizes.exceeded_by((gradient.width + gradient.height).div_ceil(8 * Sizes::EVERY));
    let noise = sizes.exceeded_by(sizes.counted / 2);
    if sizes.counted == 0 || strongest < 5.0 * noise || strongest < FAINTEST * GRADIENT_UNITS {
        return None;
    }
    let [low, high] = [(0.1 * strongest).max(3.0 * noise), (0.25 * strongest).max(4.5 * noise)];
    Some((low.max(1.0) as i16, high.max(1.0) as i16))
}

fn ridges(gradient: &Gradient, low: i16) -> Vec<Ridge> {
    /// Cells tested at once: most stretches hold no edge and are skipped as a whole.
    const STRETCH: usize = 16;
    let (width, height) = (gradient.width, gradient.height);
    let mut found = Vec::new();
    for y in 2..height.saturating_sub(2) {
        let first = y * width + 2;
        let inner = &gradient.size[first..first + width.saturating_sub(4)];
        for (stretch, sizes) in inner.chunks(STRETCH).enumerate() {
            if sizes.iter().fold(0, |largest, &size| largest.max(size)) < low {
                continue;
            }
            for (x, _) in sizes.iter().enumerate().filter(|(_, size)| **size >= low) {
                found.extend(gradient.ridge_through(first + stretch * STRETCH + x));
            }
        }
    }
    found
}

/// The ridges connected to one above `high`.
fn linked(gradient: &Gradient, mut ridges: Vec<Ridge>, high: i16) -> Vec<Ridge> {
    const WEAK: u8 = 1;
    const KEPT: u8 = 2;
    let width = gradient.width;
    let mut marks = vec![0u8; gradient.size.len()];
    let mut open = Vec::new();
    for ridge in &ridges {
        let strong = gradient.size[ridge.cell] >= high;
        marks[ridge.cell] = if strong { KEPT } else { WEAK };
        open.extend(strong.then_some(ridge.cell));
    }
    while let Some(i) = open.pop() {
        for row in [i - width, i, i + width] {
            for (j, mark) in (row - 1..).zip(&mut marks[row - 1..=row + 1]) {
                if *mark == WEAK {
                    *mark = KEPT;
                    open.push(j);
                }
            }
        }
    }
    ridges.retain(|ridge| marks[ridge.cell] == KEPT);
    ridges
}

impl Gradient<'_> {
    /// Both components at a cell off the border.
    fn at(&self, cell: usize) -> [i16; 2] {
        let row = |cell: usize| [self.levels[cell - 1], self.levels[cell], self.levels[cell + 1]];
        let (a, b, c) = (row(cell - self.width), row(cell), row(cell + self.width));
        let x = 3 * (a[2] - a[0] + c[2] - c[0]) + 10 * (b[2] - b[0]);
        let y = 3 * (c[0] - a[0] + c[2] - a[2]) + 10 * (c[1] - a[1]);
        [x, y]
    }

    /// The ridge through a cell two or more cells off the border; `None` where there is no ridge.
    fn ridge_through(&self, cell: usize) -> Option<Ridge> {
        let slope = self.at(cell);
        let across = slope[0].abs() >= slope[1].abs();
        let step = if across { 1 } else { self.width };
        let [before, here, after] = [cell - step, cell, cell + step].map(|i| f32::from(self.size[i]));
        let offset = 0.5 * (after - before) / (2.0 * here - after - before);
        (here > after && here >= before).then_some(Ridge { cell, slope, offset })
    }

    fn edge_at(&self, ridge: &Ridge, picture: &BinnedImage) -> EdgePoint {
        let (x, y) = ((ridge.cell % self.width) as f64, (ridge.cell / self.width) as f64);
        let slope = Vec2::new(f64::from(ridge.slope[0]), f64::from(ridge.slope[1]));
        let off = f64::from(ridge.offset);
        let cell = if slope.x.abs() >= slope.y.abs() { Vec2::new(x + off, y) } else { Vec2::new(x, y + off) };
        EdgePoint { at_px: picture.frame_from_cell(cell), outward: slope / -slope.norm() }
    }
}
