//! The paper's experiment: fifteen trials per speed, the highest speed at which no part topples and the lowest at which
//! all do.

use rand_distr::{Distribution, StandardNormal};

use upm_core::random::{Rng, Streams};
use upm_core::units::GRAVITY_MPS2;

/// Trials at one speed.
pub const TRIALS: u32 = 15;
/// Speeds that are tried, in units of the critical one: the first, their step and their number.
const FIRST: f64 = 0.8;
const STEP: f64 = 0.005;
const SPEEDS: u32 = 80;

/// Scatter of the experiment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrialScatter {
    /// Standard deviation of the belt's speed, as a fraction of it.
    pub belt: f64,
    /// Mean friction between belt and part, and its standard deviation.
    pub friction: f64,
    pub friction_sd: f64,
    /// Mean distance on the belt before the ledge, m, and its standard deviation as a fraction of it.
    pub way_m: f64,
    pub way_sd: f64,
}

impl TrialScatter {
    /// Speed at which one part meets the ledge when the belt should move at `belt_mps`: that of the belt, unless
    /// friction has not yet accelerated the part to it.
    pub fn approach_mps(&self, belt_mps: f64, rng: &mut Rng) -> f64 {
        let mut normal = || -> f64 { StandardNormal.sample(rng) };
        let belt_mps = belt_mps * (1.0 + self.belt * normal());
        let friction = (self.friction + self.friction_sd * normal()).max(0.0);
        let way_m = (self.way_m * (1.0 + self.way_sd * normal())).max(0.0);
        belt_mps.min((2.0 * friction * GRAVITY_MPS2 * way_m).sqrt())
    }
}

/// Result of the experiment, m/s.
#[derive(Clone, Debug, PartialEq)]
pub struct Band {
    /// Highest speed at which none topples.
    pub none_mps: f64,
    /// Lowest speed at which all topple.
    pub all_mps: f64,
    /// Speeds and shares of parts that toppled.
    pub shares: Vec<[f64; 2]>,
}

impl Band {
    /// Middle of the band, m/s.
    pub fn middle_mps(&self) -> f64 {
        0.5 * (self.none_mps + self.all_mps)
    }

    /// Width of the band, as a fraction of its middle.
    pub fn width(&self) -> f64 {
        (self.all_mps - self.none_mps) / self.middle_mps()
    }
}

/// The experiment with a part that topples from `critical_mps` on.
pub fn band(scatter: &TrialScatter, critical_mps: f64, streams: &Streams) -> Band {
    let mut rng = streams.stream("ledge trials");
    let mut shares = Vec::new();
    for i in 0..SPEEDS {
        let belt_mps = critical_mps * (FIRST + STEP * f64::from(i));
        let falls = |_: &u32| scatter.approach_mps(belt_mps, &mut rng) > critical_mps;
        let fallen = (0..TRIALS).filter(falls).count();
        shares.push([belt_mps, fallen as f64 / f64::from(TRIALS)]);
    }
    let none_mps = shares.iter().rev().find(|share| share[1] == 0.0).map_or(f64::NAN, |share| share[0]);
    let all_mps = shares.iter().find(|share| share[1] == 1.0).map_or(f64::NAN, |share| share[0]);
    Band { none_mps, all_mps, shares }
}
