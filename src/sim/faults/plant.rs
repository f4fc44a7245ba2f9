use upm_core::geometry::Vec2;
use upm_core::signal::MOTORS;

/// All present faults of the plant. The default has none.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct PlantFaults {
    /// Wrong gains, exchanged signals, held samples and low-passes of the coils.
    pub coils: CoilFaults,
    /// Factor on the friction of each part; parts beyond its end have 1.
    pub friction: Vec<f64>,
    /// Acceleration of parts by the plate's tilt, m/s².
    pub pull_mps2: Vec2,
    /// Factor on the plate's natural frequencies; 0 means 1.
    pub resonance: f64,
    /// Factor on the camera's exposure time; 0 means 1.
    pub exposure: f64,
    /// Slippery spot, if any.
    pub oil: Option<Oil>,
    /// Indices of parts that are taken off the plate.
    pub removed: Vec<usize>,
}

/// Present faults of the coils.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CoilFaults {
    /// Factor on each coil's force.
    pub gain: [f64; MOTORS],
    /// For each coil the index of the motor whose counts it plays.
    pub source: [usize; MOTORS],
    /// True for each coil that holds its last sample.
    pub stuck: [bool; MOTORS],
    /// Corner of an additional low-pass of each coil, Hz; infinite for none.
    pub low_pass_hz: [f64; MOTORS],
}

impl Default for CoilFaults {
    fn default() -> Self {
        Self {
            gain: [1.0; MOTORS],
            source: std::array::from_fn(|i| i),
            stuck: [false; MOTORS],
            low_pass_hz: [f64::INFINITY; MOTORS],
        }
    }
}

/// A slippery spot on the plate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Oil {
    /// Position of its centre, m.
    pub center_m: Vec2,
    /// Distance from the centre to the spot's rim, m.
    pub radius_m: f64,
    /// Factor on the friction there.
    pub friction: f64,
}
