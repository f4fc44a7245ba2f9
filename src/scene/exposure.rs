use rand_distr::{Distribution, StandardNormal};

use super::{Scene, SceneDisc};
use upm_core::random::Streams;
use upm_core::signal::Frame;

impl Scene {
    /// Renders the picture.
    pub fn frame(&self) -> Frame {
        self.frame_with(&self.parts)
    }

    /// Renders the picture with `parts` in place of the scene's.
    pub fn frame_with(&self, parts: &[SceneDisc]) -> Frame {
        let [width, height] = self.size_px;
        let mut levels = self.levels_by_area(parts);
        self.shade(&mut levels);
        blur(&mut levels, width, self.blur_px);
        let mut rng = Streams::new(self.seed).stream("test camera");
        let mut frame = Frame::new(width, height);
        for (pixel, level) in frame.pixels.iter_mut().zip(&levels) {
            let noise: f32 = if self.noise_sd > 0.0 { StandardNormal.sample(&mut rng) } else { 0.0 };
            let level = (level + self.noise_sd as f32 * noise).clamp(0.0, 255.0);
            // as `round` does, which without SSE4 is a call for every pixel
            let whole = level as u8;
            *pixel = whole + u8::from(level - f32::from(whole) >= 0.5);
        }
        frame
    }

    /// Darkens evenly by `shading` from one corner of the picture to the opposite one.
    fn shade(&self, levels: &mut [f32]) {
        let [width, height] = self.size_px.map(|n| n as f64);
        let (sin, cos) = self.shading_direction_rad.sin_cos();
        let across = sin.abs() + cos.abs();
        let light =
            |x: f64, y: f64| 1.0 - self.shading * (0.5 + (cos * (x / width - 0.5) + sin * (y / height - 0.5)) / across);
        let slope = (light(1.0, 0.0) - light(0.0, 0.0)) as f32;
        for (y, row) in levels.chunks_exact_mut(self.size_px[0]).enumerate() {
            let first = light(0.0, y as f64) as f32;
            row.iter_mut().enumerate().for_each(|(x, level)| *level *= first + slope * x as f32);
        }
    }
}

/// Gaussian blur; outside the picture the border's level continues.
fn blur(levels: &mut [f32], width: usize, sd_px: f64) {
    if sd_px <= 0.0 {
        return;
    }
    let reach = (4.0 * sd_px).ceil() as usize;
    let taps: Vec<f64> = (0..=2 * reach).map(|k| (-0.5 * ((k as f64 - reach as f64) / sd_px).powi(2)).exp()).collect();
    let sum: f64 = taps.iter().sum();
    let taps: Vec<f32> = taps.iter().map(|tap| (tap / sum) as f32).collect();
    let mut padded = vec![0.0; width + 2 * reach];
    for row in levels.chunks_exact_mut(width) {
        let (first, last) = (row[0], row[width - 1]);
        padded[..reach].fill(first);
        padded[reach..reach + width].copy_from_slice(row);
        padded[reach + width..].fill(last);
        row.fill(0.0);
        for (tap, from) in taps.iter().zip(padded.windows(width)) {
            row.iter_mut().zip(from).for_each(|(to, from)| *to += tap * from);
        }
    }
    let (across, last) = (levels.to_vec(), levels.len() / width - 1);
    for (y, to) in levels.chunks_exact_mut(width).enumerate() {
        to.fill(0.0);
        for (k, tap) in taps.iter().enumerate() {
            let row = (y + k).saturating_sub(reach).min(last);
            to.iter_mut().zip(&across[row * width..][..width]).for_each(|(to, from)| *to += tap * from);
        }
    }
}
