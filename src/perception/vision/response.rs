use super::convolution::DiskConvolver;
use super::disk::DiskKernel;
use super::run_length_sums::{LARGEST_AREA, RunLengthSums};

/// Method that computes the means under the disks. Both give the same response to within rounding.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ResponseMethod {
    /// The method with fewer operations by an estimate from the sizes. For coins, whose sizes are within a factor of
    /// two of each other, that is always [`Self::Chords`]: the picture is averaged until the smallest disk has a radius
    /// of 7 to 14 cells, and the FFT is cheaper only for disks of some 40 cells and more.
    #[default]
    Auto,
    /// Differences of running sums, a row of the disk at a time.
    Chords,
    /// Products of spectra, by `realfft`.
    Fft,
}

/// Means under solid disks at every cell of a rectangle. Data shared between disks (running sums, or the picture's
/// spectrum) is computed once per picture.
pub(super) struct DiskResponder {
    disks: Vec<DiskKernel>,
    way: PlannedMethod,
}

enum PlannedMethod {
    Chords(RunLengthSums),
    Spectrum(DiskConvolver),
}

impl DiskResponder {
    /// For rectangles of `width` by `height` cells and these kernels. Beyond the rectangle values are 0. Disks whose
    /// sums would overflow the chords' integers use the FFT, whatever the `method`.
    pub(super) fn new(width: usize, height: usize, disks: Vec<DiskKernel>, method: ResponseMethod) -> Self {
        let reach = disks.iter().map(DiskKernel::reach).max().unwrap_or(0);
        let wanted = match method {
            ResponseMethod::Auto => chords_are_faster(width, height, &disks),
            ResponseMethod::Chords => true,
            ResponseMethod::Fft => false,
        };
        let way = if wanted && disks.iter().all(|disk| disk.area() <= LARGEST_AREA) {
            PlannedMethod::Chords(RunLengthSums::new(width, height, reach))
        } else {
            PlannedMethod::Spectrum(DiskConvolver::new(width.max(1), height.max(1), &disks))
        };
        Self { disks, way }
    }

    /// The method in use: chords or FFT.
    pub(super) fn method(&self) -> ResponseMethod {
        match self.way {
            PlannedMethod::Chords(_) => ResponseMethod::Chords,
            PlannedMethod::Spectrum(_) => ResponseMethod::Fft,
        }
    }

    /// Loads rows of `width` values of 0 to 1, each written by `fill`.
    pub(super) fn load(&mut self, fill: impl FnMut(usize, &mut [f32])) {
        match &mut self.way {
            PlannedMethod::Chords(sums) => sums.load(fill),
            PlannedMethod::Spectrum(convolver) => convolver.load(fill),
        }
    }

    /// Mean of the loaded values under the disk of kernel `index`, for every cell of the rectangle.
    pub(super) fn respond(&mut self, index: usize, out: &mut [f32]) {
        match &mut self.way {
            PlannedMethod::Chords(sums) => sums.respond(&self.disks[index], out),
            PlannedMethod::Spectrum(convolver) => convolver.respond(index, out),
        }
    }
}

/// Estimates whether chords are cheaper. They cost one operation per row of the disk and cell, the FFT some operations
/// per cell for each doubling of the size, forward and back, and its plans about as much again. The factor follows
/// measurements for a single picture, plans included: about even at a radius of 40 cells over 150 × 150 cells, at 60 to
/// 90 over 400 × 400.
fn chords_are_faster(width: usize, height: usize, disks: &[DiskKernel]) -> bool {
    const STEPS_A_DOUBLING: f64 = 4.5;
    let reach = disks.iter().map(DiskKernel::reach).max().unwrap_or(0);
    let rows: usize = disks.iter().map(|disk| 2 * disk.reach() + 1).sum();
    let cells = (width * height) as f64;
    let padded = ((width + reach) * (height + reach)).max(4) as f64;
    rows as f64 * cells < STEPS_A_DOUBLING * (disks.len() + 1) as f64 * padded * padded.log2() / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn both_ways_equal_the_direct_sum(
            width in 1usize..70, height in 1usize..70, radii in proptest::collection::vec(0.3..20.0f64, 1..4),
            seed in 0u32..1000,
        ) {
            let values: Vec<f32> =
                (0..width * height).map(|i| ((i as u32 ^ seed).wrapping_mul(2_654_435_761) >> 8) as f32 / 16_777_216.0).collect();
            let disks: Vec<DiskKernel> = radii.iter().map(|&r| DiskKernel::new(r)).collect();
            let reach = disks.iter().map(DiskKernel::reach).max().unwrap();
            let mut chords = RunLengthSums::new(width, height, reach);
            let mut spectrum = DiskConvolver::new(width, height, &disks);
            let fill = |y: usize, row: &mut [f32]| row.copy_from_slice(&values[y * width..][..width]);
            chords.load(fill);
            spectrum.load(fill);
            let [mut by_chords, mut by_spectrum] = [(); 2].map(|()| vec![0.0; width * height]);
            for (k, disk) in disks.iter().enumerate() {
                chords.respond(disk, &mut by_chords);
                spectrum.respond(k, &mut by_spectrum);
                for i in 0..width * height {
                    let direct = disk.mean_under(&values, width, height, i % width, i / width);
                    let (a, b) = (by_chords[i], by_spectrum[i]);
                    prop_assert!((a - direct).abs() < 1e-4, "chords {a}, directly {direct} at {i} of {width} x {height}");
                    prop_assert!((b - direct).abs() < 1e-4, "spectrum {b}, directly {direct} at {i} of {width} x {height}");
                }
            }
        }
    }
}
