//! A rig file as a person writes it. Units as in `job_file.rs`.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::read::NAME_PATTERN;
use upm_core::geometry::Vec2;
use upm_core::rig::FieldDriveModel;
use upm_core::units::{grams, hertz, mm, mm_point, thousandths};
use upm_sim::{AccelerometerParams, CameraParams, MotorParams, PlateParams};

/// A rig: a square plate on springs, four voice coils, two accelerometers, a camera above.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "rig")]
pub struct RigFile {
    /// Name of the rig, for reports and libraries: letters, digits, `.`, `_` and `-`, not first `.` or `-`.
    #[schemars(length(min = 1, max = 64), extend("pattern" = NAME_PATTERN))]
    pub name: String,
    /// The moving plate.
    pub plate: PlateParams,
    /// Waveform generator, amplifiers and voice coils.
    pub(crate) motors: MotorParams,
    /// Pulses.
    pub(crate) drive: DriveSection,
    /// Synthesised motions, for jobs with the planner `synthesized_field`; null or left out for a rig that makes none.
    /// The library has to be measured with them.
    pub(crate) fields: Option<FieldDriveModel>,
    /// Two 2-axis accelerometers under opposite corners.
    pub(crate) accelerometers: AccelerometerParams,
    /// Camera and light.
    pub camera: CameraParams,
    /// Friction and impacts. Only the simulated rig knows these.
    #[serde(default)]
    pub friction: FrictionSection,
    /// Kinds of part besides penny, nickel, dime and quarter, by name, which is as the rig's.
    #[serde(default)]
    #[schemars(extend("propertyNames" = {"minLength": 1, "maxLength": 64, "pattern": NAME_PATTERN}))]
    pub(crate) kinds: BTreeMap<String, KindEntry>,
    /// The simulation itself.
    #[serde(default)]
    pub simulation: SimulationSection,
    /// COR library measured on this rig: a path relative to this file.
    pub library: Option<String>,
}

/// Pulses: base frequency and envelope.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub(crate) struct DriveSection {
    /// Base frequency of the vibration, Hz.
    #[serde(rename = "base_hz", with = "hertz")]
    #[schemars(with = "f64", range(min = 1.0, max = 1000.0))]
    pub(crate) base_radps: f64,
    /// Attack and decay of every pulse, s; one period of the drive or more: shorter ones ask for much more force.
    #[serde(default = "thousandths::<20>")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub(crate) attack_s: f64,
    /// Rest after the longest pulse, until parts stand still, s; shorter ones rest down to half as long.
    #[serde(default = "thousandths::<40>")]
    #[schemars(range(min = 0.0, max = 5.0))]
    pub(crate) rest_s: f64,
    /// Longest time at full height, s.
    #[serde(default = "thousandths::<500>")]
    #[schemars(range(min = 0.01, max = 10.0))]
    pub(crate) max_sustain_s: f64,
}

/// Coulomb friction and impacts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct FrictionSection {
    /// Friction between parts and plate.
    #[schemars(range(min = 0.01, max = 2.0))]
    pub(crate) coefficient: f64,
    /// Relative standard deviation of that from part to part.
    #[schemars(range(min = 0.0, max = 0.3))]
    pub spread: f64,
    /// Restitution between parts.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub(crate) restitution: f64,
    /// Friction between rims.
    #[schemars(range(min = 0.0, max = 2.0))]
    pub(crate) rim: f64,
}

impl Default for FrictionSection {
    fn default() -> Self {
        Self { coefficient: 0.3, spread: 0.0, restitution: 0.3, rim: 0.2 }
    }
}

/// A kind of part: a disc, or a point that slides by Coulomb's law and neither spins nor touches others.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub(crate) struct KindEntry {
    /// Diameter, mm; 0 is a point. A part for the camera has 1 mm or more.
    #[serde(rename = "diameter_mm", with = "mm")]
    #[schemars(with = "f64", range(min = 0.0, max = 1000.0))]
    pub(crate) diameter_m: f64,
    /// Mass of one part, g.
    #[serde(rename = "mass_g", with = "grams")]
    #[schemars(with = "f64", range(min = 0.01, max = 10000.0))]
    pub(crate) mass_kg: f64,
    /// Height, mm.
    #[serde(rename = "thickness_mm", with = "mm")]
    #[schemars(with = "f64", range(min = 0.05, max = 100.0))]
    pub(crate) thickness_m: f64,
    /// Friction against the plate. Left out: the rig's coefficient.
    #[schemars(range(min = 0.01, max = 2.0))]
    pub(crate) friction: Option<f64>,
}

/// The simulation itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct SimulationSection {
    /// Time step of motors, plate and parts, s.
    #[schemars(range(min = 1e-6, max = 1e-3))]
    pub(crate) step_s: f64,
    /// Knocks against the plate from outside. Left out: none.
    pub knocks: Option<Knocks>,
}

/// Knocks from one side that push the plate out of its rest position, at random times and more or less hard.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Knocks {
    /// Mean time between two knocks, s; each time is between half and one and a half of it.
    #[schemars(range(min = 0.1, max = 1000.0))]
    pub(crate) every_s: f64,
    /// How far a knock pushes the plate on average, mm along x and y; each between half and one and a half of it.
    /// Not both 0.
    #[serde(rename = "push_mm", with = "mm_point")]
    #[schemars(with = "[f64; 2]", inner(range(min = -13.0, max = 13.0)))]
    pub(crate) push_m: Vec2,
}

impl Default for SimulationSection {
    fn default() -> Self {
        Self { step_s: 5e-5, knocks: None }
    }
}

// faults inside the object are found by its schema, with their places
/// A rig named by its file or written out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum RigSource {
    /// Path of a rig file, relative to the file it stands in.
    #[schemars(title = "path")]
    File(String),
    /// The rig itself.
    Inline(Box<RigFile>),
}
