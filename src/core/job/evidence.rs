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
    /// Those of them that hardly went, or went the other way.
    pub steps_missed: u64,
    /// Such steps in a row that make a finding.
    pub steps_limit: u32,
}
