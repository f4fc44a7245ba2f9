use multiversion::multiversion;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::rand_core::Rng as _;

use super::super::CameraParams;
use upm_core::random::Rng;

/// Fixed-point units of one gray level in the clean picture.
pub(super) const UNITS: f32 = 128.0;
/// Half a level, already added to the clean picture so that the last shift rounds to nearest.
pub(super) const HALF: i16 = 64;

/// Counts of one standard deviation in the bank; its samples end at ±5.4 of them.
const BANK_SD: f64 = 6000.0;
/// Number of possible start positions in the bank.
const BANK: usize = 1 << 19;
/// Pixels processed at once.
const STRIP: usize = 32;
/// Steps per gray level in the table of standard deviations.
const SD_STEPS: usize = 4;

/// Read and shot noise, [`CameraParams::noise_sd`].
///
/// A bank of normal samples is drawn once. Every row of every frame starts at another position in it, so that noise
/// costs one product per pixel, `noise = (sd · 2^shift · sample) >> 16` in units of 1/128 level. Its rounding down does
/// not change the final rounding to the nearest level.
#[derive(Clone, Debug)]
pub(super) struct Noise {
    rng: Rng,
    /// `BANK` samples, then the first ones repeated over the width of a row.
    bank: Vec<i16>,
    /// Standard deviation of each quarter level, in the counts of the product above.
    sd_of_level: [u8; 256 * SD_STEPS],
    shift: u32,
}

impl Noise {
    pub(super) fn new(params: &CameraParams, mut rng: Rng, width: usize) -> Self {
        const COUNTS_PER_LEVEL: f64 = UNITS as f64 * 65_536.0 / BANK_SD;
        const LARGEST_SHIFT: u32 = 7;
        let counts_at = |level: f64| COUNTS_PER_LEVEL * params.noise_sd(level);
        // The finest scale at which the strongest noise still fits; noise beyond 23 levels is clipped.
        let fits = |&shift: &u32| counts_at(255.0) <= f64::from(255 << shift);
        let shift = (0..LARGEST_SHIFT).find(fits).unwrap_or(LARGEST_SHIFT);
        let sd_of_step = |k: usize| counts_at((k as f64 + 0.5) / SD_STEPS as f64) / f64::from(1 << shift);
        let sd_of_level = std::array::from_fn(|k| sd_of_step(k).round() as u8);
        Self { bank: normal_bank(&mut rng, width), rng, sd_of_level, shift }
    }

    /// Standard deviations of clean pixels, in the counts [`Noise::apply_to_row`] takes.
    pub(super) fn deviations<const N: usize>(&self, clean: &[i16; N]) -> [u8; N] {
        std::array::from_fn(|i| {
            let step = clean[i].wrapping_sub(HALF) as usize / (UNITS as usize / SD_STEPS);
            self.sd_of_level[step % (256 * SD_STEPS)]
        })
    }

    /// Adds noise to one row: `clean` is in units of 1/128 level plus [`HALF`].
    pub(super) fn apply_to_row(&mut self, clean: &[i16], sd: &[u8], out: &mut [u8]) {
        let start = self.rng.next_u64() as usize % BANK;
        let samples = self.bank.get(start..).unwrap_or_default();
        apply_sensor_noise(clean, (sd, self.shift), samples, out);
    }
}

#[multiversion(targets("x86_64+avx2"))]
fn apply_sensor_noise(clean: &[i16], (sd, shift): (&[u8], u32), samples: &[i16], out: &mut [u8]) {
    let (strips, rest) = out.as_chunks_mut();
    let done = strips.as_flattened().len();
    let whole = clean.as_chunks().0.iter().zip(sd.as_chunks().0).zip(samples.as_chunks().0);
    for (out, ((clean, sd), samples)) in strips.iter_mut().zip(whole) {
        apply_to_strip::<STRIP>(clean, (sd, shift), samples, out);
    }
    let after = clean.iter().zip(sd).zip(samples).skip(done);
    for (out, ((clean, sd), sample)) in rest.iter_mut().zip(after) {
        apply_to_strip(&[*clean], (&[*sd], shift), &[*sample], std::array::from_mut(out));
    }
}

/// Processes a few pixels at once, step by step, so that every step fills whole vectors.
#[inline(always)]
fn apply_to_strip<const N: usize>(
    clean: &[i16; N],
    (sd, shift): (&[u8; N], u32),
    samples: &[i16; N],
    out: &mut [u8; N],
) {
    let mut noise = [0; N];
    for ((noise, sd), sample) in noise.iter_mut().zip(sd).zip(samples) {
        let sd = i16::from(*sd).wrapping_shl(shift);
        *noise = ((i32::from(sd) * i32::from(*sample)) >> 16) as i16;
    }
    for ((out, clean), noise) in out.iter_mut().zip(clean).zip(&noise) {
        *out = (clean.saturating_add(*noise) >> 7).clamp(0, 255) as u8;
    }
}

/// Normal samples; half of them are the negatives of the others, so that the bank's mean is exactly zero.
fn normal_bank(rng: &mut Rng, width: usize) -> Vec<i16> {
    let mut bank: Vec<i16> = Vec::with_capacity(BANK + width);
    for _ in 0..BANK / 2 {
        let sample: f64 = StandardNormal.sample(rng);
        bank.push((sample * BANK_SD).round().clamp(-32_767.0, 32_767.0) as i16);
    }
    bank.extend_from_within(..);
    bank.iter_mut().skip(BANK / 2).for_each(|sample| *sample = -*sample);
    (0..width).for_each(|i| bank.push(bank[i % BANK]));
    bank
}

#[cfg(test)]
mod tests {
    use super::super::scenes;
    use super::*;
    use upm_core::random::Streams;

    /// Mean, variance, skewness and excess kurtosis of a flat picture, at a level at which rounding does not hide them.
    fn moments(level: f64, read_noise: f64, full_well_e: f64) -> [f64; 4] {
        let mut params = scenes::full();
        (params.read_noise, params.full_well_e) = (read_noise, full_well_e);
        let mut noise = Noise::new(&params, Streams::new(3).stream("camera"), 1280);
        let clean = [(level * f64::from(UNITS)).round() as i16 + HALF; 1280];
        let (sd, mut out) = (noise.deviations(&clean), [0; 1280]);
        let mut sums = [0.0; 5];
        for _ in 0..1024 {
            noise.apply_to_row(&clean, &sd, &mut out);
            for value in out {
                let off = f64::from(value) - level;
                (0..5).for_each(|k| sums[k] += off.powi(k as i32));
            }
        }
        let [n, s1, s2, s3, s4] = sums;
        let (mean, variance) = (s1 / n, s2 / n);
        [mean, variance - mean * mean, s3 / n / variance.powf(1.5), s4 / n / variance.powi(2) - 3.0]
    }

    #[test]
    fn noise_is_normal_without_bias() {
        for (level, read_noise, full_well_e) in
            [(100.0, 1.0, f64::INFINITY), (200.3, 1.2, 10_000.0), (20.7, 0.6, 20_000.0), (128.0, 6.0, 3000.0)]
        {
            let [mean, variance, skewness, kurtosis] = moments(level, read_noise, full_well_e);
            let wanted = read_noise * read_noise + level * 255.0 / full_well_e + 1.0 / 12.0;
            assert!(mean.abs() < 0.008 * wanted.sqrt() + 0.003, "{level}: mean {mean}");
            assert!((variance / wanted - 1.0).abs() < 0.02, "{level}: variance {variance} for {wanted}");
            assert!(skewness.abs() < 0.02 && kurtosis.abs() < 0.06, "{level}: {skewness}, {kurtosis}");
        }
    }

    #[test]
    fn levels_saturate_at_both_ends() {
        let mut params = scenes::full();
        (params.read_noise, params.full_well_e) = (20.0, f64::INFINITY);
        let mut noise = Noise::new(&params, Streams::new(3).stream("camera"), 1280);
        for (level, end) in [(0.0, 0), (255.0, 255)] {
            let clean = [(level * UNITS) as i16 + HALF; 1280];
            let (sd, mut out) = (noise.deviations(&clean), [0; 1280]);
            noise.apply_to_row(&clean, &sd, &mut out);
            let at_end = out.iter().filter(|&&value| value == end).count();
            assert!((540..740).contains(&at_end), "{at_end}");
            assert!(out.iter().all(|&value| value.abs_diff(end) < 120));
        }
    }

    #[test]
    fn rows_and_frames_share_nothing() {
        let params = scenes::full();
        let mut noise = Noise::new(&params, Streams::new(3).stream("camera"), 1280);
        let clean = [(200.0 * UNITS) as i16 + HALF; 1280];
        let (sd, mut rows) = (noise.deviations(&clean), vec![[0; 1280]; 256]);
        rows.iter_mut().for_each(|out| noise.apply_to_row(&clean, &sd, out));
        let off = |row: &[u8; 1280]| row.map(|value| f64::from(value) - 200.0);
        let correlation = |a: &[f64; 1280], b: &[f64; 1280]| {
            let dot = |a: &[f64; 1280], b: &[f64; 1280]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            dot(a, b) / (dot(a, a) * dot(b, b)).sqrt()
        };
        for pair in rows.windows(2) {
            assert!(correlation(&off(&pair[0]), &off(&pair[1])).abs() < 0.15);
        }
    }
}
