use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Number of values kept of each duration before every other one is dropped.
const KEPT: usize = 4096;

// of a run its durations, in its report the figures of each kind; memory is bounded for any length of the run
/// Wall times of a run, µs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(rename = "TimingsReport")]
pub struct Timings<T: Default = Durations> {
    /// Searches of a whole frame.
    pub localise: T,
    /// Tracking of one frame.
    pub track: T,
    /// Planning of one cycle.
    pub plan: T,
    /// Plans among these that begin a sequence of pulses.
    pub plan_new: T,
    /// Plans among these that correct the current sequence; zeros for planners without sequences.
    pub plan_correction: T,
    /// Whole cycles.
    pub cycle: T,
}

/// `timing_us` of `report.json`.
pub type TimingsReport = Timings<Quantiles>;

impl Timings {
    /// The quantiles of all durations.
    pub fn report(&self) -> TimingsReport {
        TimingsReport {
            localise: self.localise.quantiles(),
            track: self.track.quantiles(),
            plan: self.plan.quantiles(),
            plan_new: self.plan_new.quantiles(),
            plan_correction: self.plan_correction.quantiles(),
            cycle: self.cycle.quantiles(),
        }
    }
}

/// Durations of one kind: an evenly spaced sample of at most 4096 and the exact maximum.
#[derive(Clone, Debug, Default)]
pub struct Durations {
    kept_us: Vec<f64>,
    /// One duration in `2^halvings` is kept.
    halvings: u32,
    seen: u64,
    max_us: f64,
}

impl Durations {
    /// Adds one duration, µs.
    pub fn push(&mut self, us: f64) {
        self.max_us = self.max_us.max(us);
        if self.kept_us.len() == KEPT && self.seen.trailing_zeros() >= self.halvings {
            let mut index = 0;
            self.kept_us.retain(|_| {
                index += 1;
                index % 2 == 1
            });
            self.halvings += 1;
        }
        if self.seen.trailing_zeros() >= self.halvings {
            self.kept_us.push(us);
        }
        self.seen += 1;
    }

    /// Median, 99th percentile (both by nearest rank over the sample) and maximum; zeros without a duration.
    pub fn quantiles(&self) -> Quantiles {
        let mut sorted = self.kept_us.clone();
        sorted.sort_by(f64::total_cmp);
        let rank = |q: f64| {
            let index = (q * sorted.len() as f64).ceil() as usize;
            sorted.get(index.saturating_sub(1)).copied().unwrap_or(0.0)
        };
        let rounded = |us: f64| (us * 10.0).round() / 10.0;
        Quantiles { p50: rounded(rank(0.50)), p99: rounded(rank(0.99)), max: rounded(self.max_us) }
    }
}

/// Quantiles of a duration, µs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Quantiles {
    /// Median.
    pub p50: f64,
    /// 99th percentile.
    pub p99: f64,
    /// Longest.
    pub max: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_runs_stay_small_and_near() {
        let mut durations = Durations::default();
        (0..100_000).for_each(|i| durations.push(f64::from(i * 7919 % 100_000)));
        assert!(durations.kept_us.len() <= KEPT && durations.kept_us.len() > KEPT / 4);
        let quantiles = durations.quantiles();
        assert!((quantiles.p50 - 50_000.0).abs() < 2_500.0, "{quantiles:?}");
        assert!((quantiles.p99 - 99_000.0).abs() < 500.0, "{quantiles:?}");
        assert_eq!(quantiles.max, 99_999.0);
    }
}
