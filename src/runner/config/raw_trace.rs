use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use upm_document::SchemaKey;

/// A trace: what the accelerometers saw during one pulse on any rig, and what is needed to read it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "trace")]
pub struct RawTrace {
    /// Path or address of this file's schema, for editors. Nothing else reads it.
    #[serde(rename = "$schema", default, skip_serializing)]
    pub schema: SchemaKey,
    /// Samples a second in every channel; 16 or more to a period of `base_hz`.
    #[schemars(range(min = 16.0, max = 1e6))]
    pub sample_hz: f64,
    /// Time of the first sample after the start of the pulse, s.
    #[serde(default)]
    #[schemars(range(min = -60.0, max = 60.0))]
    pub first_sample_s: f64,
    /// Acceleration of one count, m/s², as the data sheet has it.
    #[schemars(range(max = 1e5), extend("exclusiveMinimum" = 0.0))]
    pub mps2_per_count: f64,
    /// Largest count the converter shows; a sample there is clipped.
    #[schemars(range(min = 1, max = 32767))]
    pub count_limit: i16,
    /// Base frequency of the vibration, Hz.
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub base_hz: f64,
    /// Attack and decay of the pulse, s.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub attack_s: f64,
    /// Length at full height, s.
    #[schemars(range(min = 0.0, max = 60.0))]
    pub sustain_s: f64,
    /// Place of accelerometer 1 on the plate, mm; number 2 sits at minus that.
    #[schemars(inner(range(min = -1000.0, max = 1000.0)))]
    pub position_mm: [f64; 2],
    /// Readings of x1, y1, x2 and y2 per true 1.
    #[serde(default = "no_gain_error")]
    #[schemars(inner(range(min = 0.1, max = 10.0)))]
    pub channel_gain: [f64; 4],
    /// The samples.
    pub counts: RawCounts,
}

fn no_gain_error() -> [f64; 4] {
    [1.0; 4]
}

/// Counts of the four channels, equally many in each; null for a sample that is missing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawCounts {
    /// Along x, accelerometer 1.
    #[schemars(length(min = 1), inner(range(min = -32767, max = 32767)))]
    pub x1: Vec<Option<i16>>,
    /// Along y, accelerometer 1.
    #[schemars(length(min = 1), inner(range(min = -32767, max = 32767)))]
    pub y1: Vec<Option<i16>>,
    /// Along x, accelerometer 2.
    #[schemars(length(min = 1), inner(range(min = -32767, max = 32767)))]
    pub x2: Vec<Option<i16>>,
    /// Along y, accelerometer 2.
    #[schemars(length(min = 1), inner(range(min = -32767, max = 32767)))]
    pub y2: Vec<Option<i16>>,
}

impl RawCounts {
    /// Each channel with its name.
    pub(super) fn named(&self) -> [(&'static str, &[Option<i16>]); 4] {
        [("x1", &self.x1), ("y1", &self.y1), ("x2", &self.x2), ("y2", &self.y2)]
    }
}
