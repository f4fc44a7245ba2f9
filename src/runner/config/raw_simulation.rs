use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The simulation itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RawSimulation {
    /// Time step of motors, plate and parts, s.
    #[schemars(range(min = 1e-6, max = 1e-3))]
    pub step_s: f64,
    /// Knocks against the plate from outside. Left out: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub knocks: Option<RawKnocks>,
}

/// Knocks from one side that push the plate out of its rest position, at random times and more or less hard.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawKnocks {
    /// Mean time between two knocks, s; each time is between half and one and a half of it.
    #[schemars(range(min = 0.1, max = 1000.0))]
    pub every_s: f64,
    /// How far a knock pushes the plate on average, mm along x and y; each between half and one and a half of it.
    /// Not both 0.
    #[schemars(inner(range(min = -13.0, max = 13.0)))]
    pub push_mm: [f64; 2],
}

impl Default for RawSimulation {
    fn default() -> Self {
        Self { step_s: 5e-5, knocks: None }
    }
}
