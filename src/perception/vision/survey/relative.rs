//! The plate's averaged picture relative to the bare plate's brightness.

use super::super::binned::{BinnedImage, UNITS};
use super::super::outline::PlateCells;
use super::super::shading::Shading;
use upm_core::geometry::Vec2;

/// The plate's cells over the bare plate's level, 1 off the plate.
pub(super) struct Relative {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Values row by row.
    pub(super) values: Vec<f32>,
}

impl Relative {
    pub(super) fn of(picture: &BinnedImage, plate: &PlateCells) -> Self {
        let (width, height) = (picture.width, picture.height);
        let shading = Shading::fit(picture, plate, true);
        let mut inverse = vec![0.0f32; width];
        let mut values = vec![1.0f32; width * height];
        for (row, values) in values.chunks_exact_mut(width).enumerate() {
            let Some(&(from, to)) = plate.spans.get(row) else { continue };
            let span = from.min(width)..to.min(width);
            shading.inverse_row(row, &mut inverse);
            let levels = picture.row(row)[span.clone()].iter().zip(&inverse[span.clone()]);
            for (value, (&level, inverse)) in values[span].iter_mut().zip(levels) {
                *value = f32::from(level) / f32::from(UNITS) * inverse;
            }
        }
        Self { width, height, values }
    }

    /// Mean within `radius` cells of `at`.
    pub(super) fn under(&self, at: Vec2, radius: f64) -> f64 {
        let rows = (at.y - radius).ceil().max(0.0) as usize..((at.y + radius).max(0.0) as usize + 1).min(self.height);
        let (mut sum, mut count) = (0.0, 0.0);
        for y in rows {
            let half = (radius.powi(2) - (y as f64 - at.y).powi(2)).max(0.0).sqrt();
            let columns = (at.x - half).ceil().max(0.0) as usize..((at.x + half).max(0.0) as usize + 1).min(self.width);
            for value in self.values[y * self.width..][..self.width].get(columns).unwrap_or_default() {
                sum += f64::from(*value);
                count += 1.0;
            }
        }
        if count > 0.0 { sum / count } else { 1.0 }
    }

    /// Darkest and lightest mean over squares of `SQUARE` cells.
    pub(super) fn extremes(&self) -> [f64; 2] {
        const SQUARE: usize = 6;
        let (mut least, mut most) = (1.0f32, 1.0f32);
        for y in (0..self.height.saturating_sub(SQUARE)).step_by(SQUARE / 2) {
            for x in (0..self.width.saturating_sub(SQUARE)).step_by(SQUARE / 2) {
                let rows = (y..y + SQUARE).map(|row| &self.values[row * self.width + x..][..SQUARE]);
                let mean = rows.flatten().sum::<f32>() / (SQUARE * SQUARE) as f32;
                (least, most) = (least.min(mean), most.max(mean));
            }
        }
        [f64::from(least), f64::from(most)]
    }
}
