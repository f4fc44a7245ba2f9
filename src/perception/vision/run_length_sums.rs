//! Convolution of a rectangle with a solid disk by running sums: each chord of the disk contributes one difference of a
//! row's running sum. Integer arithmetic, hence exact. Equation sheet, section 7.

use super::disk::DiskKernel;

/// Integer that represents a value of 1 for disks of up to [`FULL_AREA`] cells, whose sums then fit 31 bits; a smaller
/// one does for larger disks.
const ONE: f32 = 65_535.0;
const FULL_AREA: usize = 32_000;

/// Running sums of the rows of a rectangle, and scratch.
pub(super) struct RunLengthSums {
    width: usize,
    /// Zero cells to the left and right of each row.
    margin: usize,
    /// Integer that represents a value of 1.
    one: f32,
    /// Row by row, `width + 2 margin + 1` sums each: at every place that of all cells to the left.
    sums: Vec<u32>,
    row: Vec<u32>,
    values: Vec<f32>,
}

impl RunLengthSums {
    /// For rectangles of `width` by `height` cells and these disks.
    pub(super) fn new(width: usize, height: usize, disks: &[DiskKernel]) -> Self {
        let margin = disks.iter().map(DiskKernel::reach).max().unwrap_or(0);
        let area = disks.iter().map(|disk| disk.area).fold(FULL_AREA, usize::max);
        Self {
            width,
            margin,
            one: ONE * (FULL_AREA as f32 / area as f32),
            sums: vec![0; (width + 2 * margin + 1) * height],
            row: vec![0; width],
            values: vec![0.0; width],
        }
    }

    /// Loads rows of `width` values of 0 to 1, each written by `fill`.
    pub(super) fn load(&mut self, mut fill: impl FnMut(usize, &mut [f32])) {
        let (width, margin) = (self.width, self.margin);
        let stride = width + 2 * margin + 1;
        for (y, sums) in self.sums.chunks_exact_mut(stride).enumerate() {
            fill(y, &mut self.values);
            let mut sum = 0u32;
            for (to, &value) in sums[margin + 1..].iter_mut().zip(&self.values) {
                sum += (value * self.one + 0.5) as i32 as u32;
                *to = sum;
            }
            sums[margin + width + 1..].fill(sum);
        }
    }

    /// Mean of the loaded values under `disk`, one of those of [`Self::new`], at every cell; 0 beyond the rectangle.
    pub(super) fn respond(&mut self, disk: &DiskKernel, out: &mut [f32]) {
        let (width, margin) = (self.width, self.margin);
        let stride = width + 2 * margin + 1;
        let height = self.sums.len() / stride;
        let scale = 1.0 / (self.one * disk.area as f32);
        for (y, target) in out.chunks_exact_mut(width.max(1)).take(height).enumerate() {
            self.row.fill(0);
            for (dy, &half) in disk.half.iter().enumerate() {
                let half = half.min(margin);
                let ends = |row: usize| {
                    let sums = &self.sums[row * stride..][..stride];
                    (&sums[margin - half..][..width], &sums[margin + half + 1..][..width])
                };
                let (above, below) = (y.checked_sub(dy), (y + dy < height && dy > 0).then_some(y + dy));
                match (above, below) {
                    (Some(above), Some(below)) => add_pair(&mut self.row, ends(above), ends(below)),
                    (Some(one), None) | (None, Some(one)) => add(&mut self.row, ends(one)),
                    (None, None) => {}
                }
            }
            target.iter_mut().zip(&self.row).for_each(|(to, &sum)| *to = sum as i32 as f32 * scale);
        }
    }
}

fn add(row: &mut [u32], (from, to): (&[u32], &[u32])) {
    for ((sum, from), to) in row.iter_mut().zip(from).zip(to) {
        *sum = sum.wrapping_add(to.wrapping_sub(*from));
    }
}

fn add_pair(row: &mut [u32], above: (&[u32], &[u32]), below: (&[u32], &[u32])) {
    let ends = above.0.iter().zip(above.1).zip(below.0.iter().zip(below.1));
    for (sum, ((a, b), (c, d))) in row.iter_mut().zip(ends) {
        *sum = sum.wrapping_add(b.wrapping_sub(*a)).wrapping_add(d.wrapping_sub(*c));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn means_equal_the_direct_sum(
            width in 1usize..70, height in 1usize..70, radii in proptest::collection::vec(0.3..20.0f64, 1..4),
            large in proptest::option::of(110.0..150.0f64), seed in 0u32..1000,
        ) {
            let values: Vec<f32> =
                (0..width * height).map(|i| ((i as u32 ^ seed).wrapping_mul(2_654_435_761) >> 8) as f32 / 16_777_216.0).collect();
            let disks: Vec<DiskKernel> = radii.into_iter().chain(large).map(DiskKernel::new).collect();
            let mut sums = RunLengthSums::new(width, height, &disks);
            sums.load(|y, row| row.copy_from_slice(&values[y * width..][..width]));
            let mut found = vec![0.0; width * height];
            for disk in &disks {
                sums.respond(disk, &mut found);
                for (i, found) in found.iter().enumerate() {
                    let direct = disk.mean_under(&values, width, height, i % width, i / width);
                    prop_assert!((found - direct).abs() < 1e-4, "{found}, directly {direct} at {i} of {width} x {height}");
                }
            }
        }
    }
}
