use std::f64::consts::TAU;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::PlateResponse;
use super::raw::rounded;

/// Natural frequencies of a plate on springs; the drive's base frequency has to be higher and ends at 10 kHz.
pub(super) const NATURAL_HZ: (f64, f64) = (0.1, 10_000.0);
/// Damping ratios from undamped to far beyond critical.
pub(super) const DAMPING_RATIO: (f64, f64) = (0.0, 10.0);

/// Resonances of the plate's axes, each a mass-spring-damper.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawPlateResponse {
    /// Undamped natural frequencies, from 0.1 to 10000.
    pub natural_hz: RawAxes,
    /// Damping ratios, from 0 to 10.
    pub damping_ratio: RawAxes,
}

/// One number for each axis of the plate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawAxes {
    /// Along x.
    pub x: f64,
    /// Along y.
    pub y: f64,
    /// About the centre.
    pub spin: f64,
}

impl RawAxes {
    fn rounded([x, y, spin]: [f64; 3]) -> Self {
        Self { x: rounded(x, 4), y: rounded(y, 4), spin: rounded(spin, 4) }
    }

    fn values(self) -> [f64; 3] {
        [self.x, self.y, self.spin]
    }
}

impl From<&PlateResponse> for RawPlateResponse {
    fn from(plate: &PlateResponse) -> Self {
        Self {
            natural_hz: RawAxes::rounded(plate.natural_radps.map(|radps| radps / TAU)),
            damping_ratio: RawAxes::rounded(plate.damping_ratio),
        }
    }
}

impl RawPlateResponse {
    /// The same in SI, nothing checked.
    pub(super) fn response(&self) -> PlateResponse {
        PlateResponse {
            natural_radps: self.natural_hz.values().map(|hz| TAU * hz),
            damping_ratio: self.damping_ratio.values(),
        }
    }
}
