use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How fast plate time passes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Pace {
    /// Plate time is wall time.
    #[default]
    RealTime,
    /// As fast as the machine can.
    Max,
}

impl Pace {
    /// Every pace.
    pub const ALL: [Self; 2] = [Self::RealTime, Self::Max];

    /// As it is written: `real-time`.
    pub fn name(self) -> &'static str {
        match self {
            Self::RealTime => "real-time",
            Self::Max => "max",
        }
    }

    /// The pace of that name.
    pub fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|pace| pace.name() == name)
    }
}
