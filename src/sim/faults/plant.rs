use upm_core::geometry::Vec2;
use upm_core::signal::MOTORS;

/// All present faults of the plant. The default has none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlantFaults {
    /// The coils.
    pub coils: CoilFaults,
    /// Factor on the friction of each part; parts behind its end have 1.
    pub friction: Vec<f64>,
    /// Acceleration of parts by the plate's tilt, m/s².
    pub pull_mps2: Vec2,
    /// Factor on the plate's natural frequencies; 0 stands for 1.
    pub resonance: f64,
    /// Factor on the camera's exposure time; 0 stands for 1.
    pub exposure: f64,
    /// A slippery spot.
    pub oil: Option<Oil>,
    /// Parts that are taken off, by index.
    pub removed: Vec<usize>,
}

/// Present faults of the coils.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoilFaults {
    /// Factor on the force of each.
    pub gain: [f64; MOTORS],
    /// The motor whose counts each plays.
    pub source: [usize; MOTORS],
    /// True for one whose last sample stays.
    pub stuck: [bool; MOTORS],
    /// Corner of a further low-pass, Hz; infinite for none.
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
    /// Its middle, m.
    pub center_m: Vec2,
    /// Its radius, m.
    pub radius_m: f64,
    /// Factor on the friction there.
    pub friction: f64,
}

/// A sudden change of the plant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PlantChange {
    /// A part is moved by hand, by so much, m.
    Moved {
        /// Which.
        part: usize,
        /// By how much.
        by_m: Vec2,
    },
    /// Two parts exchange their places.
    Swapped([usize; 2]),
    /// The plate is pushed out of its place, m.
    Bumped(Vec2),
}

/// A disc as the camera sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenDisc {
    /// Its middle, px.
    pub center_px: Vec2,
    /// Its radius, px.
    pub radius_px: f64,
    /// Its gray level.
    pub level: f64,
}

/// A plant that can be made to fail: the simulated rig.
pub trait FaultyPlant {
    /// From now on this is wrong, and nothing else.
    fn set_faults(&mut self, faults: &PlantFaults);

    /// This happens now.
    fn change(&mut self, change: PlantChange);

    /// A part of the first kind at `place_m`, as the camera would see it; `None` without parts.
    fn seen_disc(&self, place_m: Vec2) -> Option<SeenDisc>;

    /// Number of parts.
    fn parts(&self) -> usize;
}
