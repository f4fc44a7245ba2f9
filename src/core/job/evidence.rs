use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How near a run came to the findings that rest on chance. The limits follow from the false alarms that its job
/// accepts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Evidence {
    /// Pulses whose motion was read.
    pub pulses: u64,
    /// Largest deviation of a pulse's motion from its plan, in tolerances.
    pub motion: f64,
    /// Deviation from which on a motion is not as planned.
    pub motion_limit: f64,
    /// Largest logarithm of the likelihood that pictures are late over that they are not.
    pub late: f64,
    /// Its limit.
    pub late_limit: f64,
    /// Steps of parts that were compared with their forecast.
    pub steps: u64,
    /// Those of them that hardly went.
    pub steps_missed: u64,
    /// Such steps in a row that make a finding.
    pub steps_limit: u32,
}

/// The explanation that the senses can tell least from a finding.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct RunnerUp {
    /// The coil, channel or pair of coils, for people.
    pub what: String,
    /// Odds of the finding over it; the most that are told stand for higher ones.
    pub odds: u32,
}

impl RunnerUp {
    /// Largest odds that are told: an explanation that is a thousand times less likely need not be checked.
    pub const MOST_ODDS: u32 = 1000;
}

impl fmt::Display for RunnerUp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let more = if self.odds < Self::MOST_ODDS { "" } else { "more than " };
        write!(f, "{more}{}:1 over {}", self.odds, self.what)
    }
}
