use upm_core::geometry::Vec2;
use upm_core::signal::Frame;

/// Reads gray levels between the pixels of a frame.
#[derive(Clone, Copy)]
pub(super) struct Sampler<'a> {
    pixels: &'a [u8],
    width: usize,
    last: Vec2,
}

impl<'a> Sampler<'a> {
    /// `None` for frames below 2 × 2 px and for frames whose size and pixels do not agree.
    pub(super) fn new(frame: &'a Frame) -> Option<Self> {
        let (width, height) = (frame.width, frame.height);
        let whole = width.checked_mul(height) == Some(frame.pixels.len());
        (whole && width >= 2 && height >= 2).then(|| Self {
            pixels: &frame.pixels,
            width,
            last: Vec2::new((width - 1) as f64, (height - 1) as f64),
        })
    }

    /// Bilinear gray level at `(x, y)` px; outside the picture the border's level continues.
    pub(super) fn at(&self, x: f64, y: f64) -> f32 {
        let (x, y) = (x.max(0.0).min(self.last.x), y.max(0.0).min(self.last.y));
        let (column, row) = ((x as i32).min(self.last.x as i32 - 1), (y as i32).min(self.last.y as i32 - 1));
        let (fx, fy) = ((x - f64::from(column)) as f32, (y - f64::from(row)) as f32);
        let start = row as usize * self.width + column as usize;
        let above = &self.pixels[start..][..2];
        let below = &self.pixels[start + self.width..][..2];
        let mix = |pair: &[u8]| f32::from(pair[0]) + fx * (f32::from(pair[1]) - f32::from(pair[0]));
        let (top, bottom) = (mix(above), mix(below));
        top + fy * (bottom - top)
    }

    /// Bilinear levels at points evenly spaced from `from` to `to`, in fixed-point steps of 1/2048 px: several times
    /// faster than [`Sampler::at`]. `None` unless all points are a pixel or more inside the picture.
    pub(super) fn along<const N: usize>(&self, from: Vec2, to: Vec2) -> Option<[f32; N]> {
        const ONE: f64 = 65536.0;
        if !(self.contains(from, 1.0) && self.contains(to, 1.0)) || self.last.amax() > 32_000.0 {
            return None;
        }
        let step = (to - from) * (ONE / (N.max(2) - 1) as f64);
        let (mut x, mut y) = ((from.x * ONE) as i32, (from.y * ONE) as i32);
        let (dx, dy) = (step.x as i32, step.y as i32);
        let below = self.pixels.get(self.width..)?;
        let above = &self.pixels[..below.len()];
        let most = below.len().checked_sub(1)?;
        let mut levels = [0.0f32; N];
        for level in &mut levels {
            let start = (y >> 16) as usize * self.width + (x >> 16) as usize;
            if start >= most {
                return None;
            }
            let (fx, fy) = ((x & 0xffff) >> 4, (y & 0xffff) >> 5);
            let mix =
                |row: &[u8]| (i32::from(row[start]) << 12) + (i32::from(row[start + 1]) - i32::from(row[start])) * fx;
            let (top, bottom) = (mix(above), mix(below));
            // 8 bits of level, 12 and 11 of position: just fits a signed 32-bit integer.
            *level = ((top << 11) + (bottom - top) * fy) as f32 * (1.0 / 8_388_608.0);
            x += dx;
            y += dy;
        }
        Some(levels)
    }

    /// Levels as of [`Sampler::along`], or of [`Sampler::at`] where points are near or beyond the border.
    pub(super) fn profile<const N: usize>(&self, from: Vec2, to: Vec2) -> [f32; N] {
        self.along::<N>(from, to).unwrap_or_else(|| {
            std::array::from_fn(|k| {
                let p = from + (to - from) * (k as f64 / (N as f64 - 1.0));
                self.at(p.x, p.y)
            })
        })
    }

    /// True when `p_px` is in the picture, at least `margin_px` off its border.
    pub(super) fn contains(&self, p_px: Vec2, margin_px: f64) -> bool {
        p_px.x >= margin_px
            && p_px.y >= margin_px
            && p_px.x <= self.last.x - margin_px
            && p_px.y <= self.last.y - margin_px
    }
}

/// Position where a profile rises through the half-way level from `dark` to `light`: the crossing nearest its middle,
/// in samples from the first.
pub(super) fn rising_crossing(profile: &[f32], dark: f32, light: f32) -> Option<f64> {
    let level = (dark + light) / 2.0;
    let i = rise_nearest_middle(profile, level)?;
    let share = share_of_rise(profile[i] - level, profile[i + 1] - level, light - dark);
    share.is_finite().then(|| i as f64 + f64::from(share))
}

/// The sample after which a profile rises from below `level` to it or above, nearest the middle; only the first 64
/// count.
#[inline]
pub(super) fn rise_nearest_middle(profile: &[f32], level: f32) -> Option<usize> {
    let below = profile.iter().take(64).enumerate().fold(0u64, |bits, (i, &v)| bits | u64::from(v < level) << i);
    let pairs = profile.len().min(64).saturating_sub(1);
    let mut rises = below & !(below >> 1) & !(u64::MAX << pairs);
    let off = |i: usize| {
        let (a, b) = (level - profile[i], profile[i + 1] - level);
        (i as f32 + a / (a + b) - (profile.len() as f32 - 1.0) / 2.0).abs()
    };
    let mut best = None;
    while rises != 0 {
        let i = rises.trailing_zeros() as usize;
        rises &= rises - 1;
        if best.is_none_or(|best| off(i) < off(best)) {
            best = Some(i);
        }
    }
    best
}

/// Fraction of a sample step, 0 to 1, at which the half-way level is crossed, from the differences of the two samples
/// below and above it. Uses the normal distribution's quantile, `q + π/3 q³ + 7π²/30 q⁵` for a share of `1/2 + q`:
/// exact for an edge blurred by a Gaussian. Linear interpolation would be off by some hundredths of a sample, in one
/// direction all along an edge parallel to the pixels.
pub(super) fn share_of_rise(below: f32, above: f32, contrast: f32) -> f32 {
    const CUBIC: f32 = std::f32::consts::FRAC_PI_3;
    const QUINTIC: f32 = 7.0 * std::f32::consts::PI * std::f32::consts::PI / 30.0;
    let quantile = |off: f32| {
        let q = (off / contrast).clamp(-0.6, 0.6);
        q * (1.0 + q * q * (CUBIC + q * q * QUINTIC))
    };
    let (from, to) = (quantile(below), quantile(above));
    from / (from - to)
}

/// Quantile `q` of `values`, which are reordered; 0 for no values.
pub(super) fn quantile(values: &mut [f64], q: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let nth = ((values.len() - 1) as f64 * q).round() as usize;
    *values.select_nth_unstable_by(nth.min(values.len() - 1), f64::total_cmp).1
}

/// Tukey's biweight of a residual measured in standard deviations.
pub(super) fn biweight(residual_sd: f64) -> f64 {
    let share = 1.0 - (residual_sd / 4.685).powi(2);
    if share > 0.0 { share * share } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fast_profiles_equal_plain_sampling() {
        let mut frame = Frame::new(60, 40);
        frame.pixels.iter_mut().enumerate().for_each(|(i, p)| *p = (i.wrapping_mul(2_654_435_761) >> 9) as u8);
        let sampler = Sampler::new(&frame).unwrap();
        for k in 0..40 {
            let (sin, cos) = (f64::from(k) * 0.157).sin_cos();
            let (from, to) =
                (Vec2::new(30.3 + 9.7 * cos, 20.1 + 9.3 * sin), Vec2::new(30.3 + 18.0 * cos, 20.1 + 17.7 * sin));
            let fast = sampler.along::<9>(from, to).unwrap();
            for (i, fast) in fast.into_iter().enumerate() {
                let p = from + (to - from) * (i as f64 / 8.0);
                assert!((fast - sampler.at(p.x, p.y)).abs() < 0.1);
            }
        }
        assert!(sampler.along::<9>(Vec2::new(5.0, 5.0), Vec2::new(5.0, 38.5)).is_none());
    }

    #[test]
    fn blurred_edge_is_located_at_any_phase() {
        // A step blurred by a Gaussian of 0.85 px, its integral by the midpoint rule.
        let share = |x: f64| {
            let slice = |i: u32| (-0.5 * ((f64::from(i) + 0.5) / 100.0 - 6.0f64).powi(2)).exp() * 0.01;
            (0..1200).filter(|&i| (f64::from(i) + 0.5) / 100.0 - 6.0 < x / 0.85).map(slice).sum::<f64>() / 2.5066
        };
        for k in 0..20 {
            let edge = 4.0 + f64::from(k) / 20.0;
            let profile: [f32; 9] = std::array::from_fn(|i| (200.0 * share(i as f64 - edge)) as f32);
            let off = rising_crossing(&profile, 0.0, 200.0).unwrap() - edge;
            assert!(off.abs() < 0.006, "{off} at {edge}");
        }
    }
}
