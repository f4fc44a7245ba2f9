use upm_core::geometry::Vec2;
use upm_core::signal::MOTORS;

/// All present faults of the plant. The default has none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlantFaults {
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
pub struct CoilFaults {
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
pub struct Oil {
    /// Position of its centre, m.
    pub center_m: Vec2,
    /// Distance from the centre to the spot's rim, m.
    pub radius_m: f64,
    /// Factor on the friction there.
    pub friction: f64,
}

/// A sudden change of the plant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PlantChange {
    /// A part is moved by hand.
    Moved {
        /// Index of the part.
        part: usize,
        /// Displacement, m.
        by_m: Vec2,
    },
    /// Two parts, by index, exchange their positions.
    Swapped([usize; 2]),
    /// The plate is pushed out of its rest position, m.
    Bumped(Vec2),
}

/// A disc as the camera sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenDisc {
    /// Position of its centre, px.
    pub center_px: Vec2,
    /// Radius of its outline in the picture, px.
    pub radius_px: f64,
    /// Its gray level.
    pub level: f64,
}

/// A plant that can be made to fail: the simulated rig.
pub trait FaultyPlant {
    /// Replaces all present faults by `faults`.
    fn set_faults(&mut self, faults: &PlantFaults);

    /// Applies a sudden change now.
    fn change(&mut self, change: PlantChange);

    /// Image of a part of the first kind at `place_m`; `None` without parts.
    fn seen_disc(&self, place_m: Vec2) -> Option<SeenDisc>;

    /// Number of parts.
    fn parts(&self) -> usize;
}
