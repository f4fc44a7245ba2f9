use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::raw_rig::RigSource;
use upm_core::job::PlateMode;
use upm_document::SchemaKey;

/// An open-loop experiment: given pulses on given parts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "simulate")]
pub struct RawSimulate {
    /// Path or address of this file's schema, for editors. Nothing else reads it.
    #[serde(rename = "$schema", default, skip_serializing)]
    pub schema: SchemaKey,
    /// The rig: a path relative to this file, or the object itself.
    pub rig: RigSource,
    /// How the plate moves.
    #[serde(default)]
    pub plate: PlateMode,
    /// Base frequency w of every pulse, Hz. Left out: the rig's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub base_hz: Option<f64>,
    /// Parts on the plate.
    #[schemars(length(min = 1, max = 64))]
    pub parts: Vec<RawPlaced>,
    /// Pulses, one after another.
    #[schemars(length(min = 1, max = 1000))]
    pub pulses: Vec<RawPulse>,
    /// Samples a second of the trajectories put out.
    #[serde(default = "sample_hz")]
    #[schemars(range(min = 1.0, max = 100_000.0))]
    pub sample_hz: f64,
}

fn sample_hz() -> f64 {
    1000.0
}

/// A part and where it starts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawPlaced {
    /// penny, nickel, dime, quarter or a kind of the rig's.
    pub kind: String,
    /// Where it starts, mm; its centre lies on the plate.
    #[schemars(inner(range(min = -1000.0, max = 1000.0)))]
    pub position_mm: [f64; 2],
}

/// A pulse: a rotation (`cor_mm`, `omega_rad_s`) or a translation (`direction_deg`, `speed_mps`), both with the wave
/// `cos wt - ½ cos 2wt`; or any periodic motion of the plate (`harmonics`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawPulse {
    /// Centre of rotation, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(inner(range(min = -1e6, max = 1e6)))]
    pub cor_mm: Option<[f64; 2]>,
    /// Amplitude of the spin, rad/s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    pub omega_rad_s: Option<f64>,
    /// Direction of a translation, degrees counter-clockwise from x.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = -360.0, max = 360.0))]
    pub direction_deg: Option<f64>,
    /// Amplitude of a translation's speed, m/s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(max = 100.0), extend("exclusiveMinimum" = 0.0))]
    pub speed_mps: Option<f64>,
    /// The plate's velocity at full height: harmonic k of the base frequency at index k - 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 1, max = 16))]
    pub harmonics: Option<Vec<RawHarmonic>>,
    /// 1 as said, parts of a rotation flow counter-clockwise; -1 in reverse.
    #[serde(default = "forwards")]
    #[schemars(extend("enum" = [-1, 1]))]
    pub rotation: i32,
    /// Length at full height, s.
    #[schemars(range(min = 0.0, max = 60.0))]
    pub sustain_s: f64,
    /// Attack and decay, s. Left out: the rig's.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 10.0))]
    pub attack_s: Option<f64>,
    /// Rest after it, s. Left out: the rig's.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 60.0))]
    pub rest_s: Option<f64>,
}

/// One harmonic of the plate's velocity: `cos` and `sin` times `cos kwt` and `sin kwt`. Each is the velocity of the
/// plate's centre along x and y, m/s, and its spin, rad/s, counter-clockwise.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RawHarmonic {
    /// Amplitudes of `cos kwt`: m/s, m/s, rad/s.
    #[schemars(inner(range(min = -1000.0, max = 1000.0)))]
    pub cos: [f64; 3],
    /// Amplitudes of `sin kwt`: m/s, m/s, rad/s.
    #[schemars(inner(range(min = -1000.0, max = 1000.0)))]
    pub sin: [f64; 3],
}

fn forwards() -> i32 {
    1
}
