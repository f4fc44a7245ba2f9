//! Intervals of confidence.

use libm::sqrt;
use serde::Serialize;

/// Two-sided 95 % of the normal distribution.
const Z_95: f64 = 1.959_963_985;

/// An estimate with the ends of its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Interval {
    /// The estimate.
    pub value: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl Interval {
    /// Share of `found` in `all` (Wilson's interval); `None` of nothing.
    pub fn of_share(found: usize, all: usize) -> Option<Self> {
        let (n, share) = (all as f64, found as f64 / all as f64);
        let middle = (share + Z_95 * Z_95 / (2.0 * n)) / (1.0 + Z_95 * Z_95 / n);
        let half = Z_95 / (1.0 + Z_95 * Z_95 / n) * sqrt(share * (1.0 - share) / n + Z_95 * Z_95 / (4.0 * n * n));
        (all > 0).then(|| Self { value: share, low: (middle - half).max(0.0), high: (middle + half).min(1.0) })
    }

    /// Median of `sorted`, between the two of them that a binomial distribution says hold it; `None` of nothing.
    pub fn of_median(sorted: &[f64]) -> Option<Self> {
        let n = sorted.len();
        let value = 0.5 * (sorted.get((n.max(1) - 1) / 2)? + sorted.get(n / 2)?);
        let below = (0.5 * (n as f64) - 0.5 * Z_95 * sqrt(n as f64)).floor().max(0.0) as usize;
        Some(Self { value, low: sorted[below], high: sorted[n - 1 - below] })
    }

    /// Mean of values with this number, sum and sum of squares.
    pub fn of_mean(n: f64, sum: f64, squares: f64) -> Option<Self> {
        let mean = sum / n;
        let error = sqrt(((squares / n - mean * mean).max(0.0)) / (n - 1.0).max(1.0));
        (n > 0.0).then_some(Self { value: mean, low: mean - Z_95 * error, high: mean + Z_95 * error })
    }
}
