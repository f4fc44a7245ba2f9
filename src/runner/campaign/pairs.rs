use libm::log;
use serde::Serialize;

use super::line::RunLine;
use super::statistics::Interval;

/// Probability of telling two that are equal apart, either way: half of it by plate time, half by success.
const FALSE_ALARM: f64 = 0.01;
/// Probability of not telling a difference as large as the one that is asked about.
const MISS: f64 = 0.005;
/// Pairs before the scatter of the ratios is believed.
const LEAST_PAIRS: u64 = 30;
/// Share of the pairs with one success in which the other campaign has it, where a difference counts.
const DIFFERS_SHARE: f64 = 0.75;

/// Sequential comparison of another campaign with this one, over pairs of runs of the same number.
///
/// Plate times: for each sign a sequential probability ratio test (Wald 1945) of the mean logarithm of the ratio, zero
/// against the difference that is asked about, normal with the scatter seen so far. Success: the same test of the pairs
/// of which one succeeded. Pairs count in the order in which they are added, which is that of their numbers.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Pairs {
    /// Logarithm of the ratio of plate times that is told.
    #[serde(skip)]
    difference: f64,
    /// Pairs so far.
    pub pairs: u64,
    /// Pairs of which both succeeded.
    pub both: u64,
    /// Pairs of which the other campaign alone succeeded.
    pub other_alone: u64,
    /// Pairs of which this campaign alone succeeded.
    pub this_alone: u64,
    #[serde(skip)]
    sum: f64,
    #[serde(skip)]
    squares: f64,
    /// Verdict so far.
    pub verdict: PairsVerdict,
}

/// Verdict on the other campaign.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum PairsVerdict {
    /// Nothing yet.
    #[default]
    Open,
    /// It takes longer.
    Slower,
    /// It takes less time.
    Faster,
    /// The plate times differ by less than what is asked about.
    Equal,
    /// It succeeds more often.
    MoreSuccess,
    /// It succeeds less often.
    LessSuccess,
}

impl Pairs {
    /// No pairs yet; a share of plate time of `tells` is to be told, as 0.03.
    pub fn new(tells: f64) -> Self {
        Self { difference: log(1.0 + tells), ..Self::default() }
    }

    /// Counts a pair, unless the comparison is over.
    pub fn add(&mut self, this: &RunLine, other: &RunLine) -> PairsVerdict {
        let times = this.figures.plate_time_s.zip(other.figures.plate_time_s).filter(|&(a, b)| a > 0.0 && b > 0.0);
        let ratio = times.filter(|_| this.success && other.success).map(|(this_s, other_s)| log(other_s / this_s));
        self.add_ratio(this.success, other.success, ratio)
    }

    pub(super) fn add_ratio(&mut self, this: bool, other: bool, ratio: Option<f64>) -> PairsVerdict {
        if self.verdict != PairsVerdict::Open {
            return self.verdict;
        }
        self.pairs += 1;
        self.other_alone += u64::from(other && !this);
        self.this_alone += u64::from(this && !other);
        if let Some(ratio) = ratio {
            self.both += 1;
            self.sum += ratio;
            self.squares += ratio * ratio;
        }
        self.verdict = self.told();
        self.verdict
    }

    fn told(&self) -> PairsVerdict {
        // half of the false alarms for each test, half of these for each sign
        let (accept, reject) = (log((1.0 - MISS) / (0.25 * FALSE_ALARM)), log(MISS));
        let odds =
            |yes: u64, no: u64| yes as f64 * log(2.0 * DIFFERS_SHARE) + no as f64 * log(2.0 * (1.0 - DIFFERS_SHARE));
        if odds(self.other_alone, self.this_alone) >= accept {
            return PairsVerdict::MoreSuccess;
        }
        if odds(self.this_alone, self.other_alone) >= accept {
            return PairsVerdict::LessSuccess;
        }
        if self.both < LEAST_PAIRS {
            return PairsVerdict::Open;
        }
        let n = self.both as f64;
        let scatter = ((self.squares - self.sum * self.sum / n) / (n - 1.0)).max(1e-12);
        let odds = |sum: f64| self.difference / scatter * (sum - 0.5 * n * self.difference);
        match [odds(self.sum), odds(-self.sum)] {
            [slower, _] if slower >= accept => PairsVerdict::Slower,
            [_, faster] if faster >= accept => PairsVerdict::Faster,
            [slower, faster] if slower.max(faster) <= reject => PairsVerdict::Equal,
            _ => PairsVerdict::Open,
        }
    }

    /// Mean logarithm of the ratio of plate times, the other campaign's to this one's.
    pub fn mean_log_ratio(&self) -> Option<Interval> {
        Interval::of_mean(self.both as f64, self.sum, self.squares)
    }
}
