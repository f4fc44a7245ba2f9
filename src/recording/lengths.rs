//! Statistics of lengths for the report, and its rounding.

use upm_core::geometry::Vec2;
use upm_core::units::mm_from_m;

/// Mean, root mean square and maximum of lengths, m.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Lengths {
    count: u64,
    sum_m: f64,
    sum_m2: f64,
    max_m: f64,
}

impl Lengths {
    pub fn push(&mut self, length_m: f64) {
        self.count += 1;
        self.sum_m += length_m;
        self.sum_m2 += length_m * length_m;
        self.max_m = self.max_m.max(length_m);
    }

    /// Mean, m; `None` without a length.
    pub fn mean_m(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum_m / self.count as f64)
    }

    pub fn mean_mm(&self) -> Option<f64> {
        self.mean_m().map(mm)
    }

    pub fn rms_mm(&self) -> Option<f64> {
        (self.count > 0).then(|| mm((self.sum_m2 / self.count as f64).sqrt()))
    }

    pub fn max_mm(&self) -> Option<f64> {
        (self.count > 0).then(|| mm(self.max_m))
    }
}

/// The value rounded to four decimals: 0.1 µm for lengths in mm.
pub fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4 + 0.0
}

pub(crate) fn mm(length_m: f64) -> f64 {
    rounded(mm_from_m(length_m))
}

pub(crate) fn point_mm(p_m: Vec2) -> [f64; 2] {
    [mm(p_m.x), mm(p_m.y)]
}
