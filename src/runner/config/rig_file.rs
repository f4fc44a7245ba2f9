//! A rig file as a person writes it.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};

use upm_core::signal::MotorArrangement;

/// A rig: a square plate on springs, four voice coils, two accelerometers, a camera above.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "rig")]
pub struct RigFile {
    /// Path or address of this file's schema, for editors. Nothing else reads it.
    #[serde(rename = "$schema", default, skip_serializing)]
    #[schemars(with = "String")]
    pub(crate) schema: IgnoredAny,
    /// Name of the rig, for reports and libraries: letters, digits, `.`, `_` and `-`.
    #[schemars(length(min = 1, max = 64), extend("pattern" = "^[A-Za-z0-9._-]+$"))]
    pub name: String,
    /// The moving plate.
    pub plate: PlateSection,
    /// Waveform generator, amplifiers and voice coils.
    pub(crate) motors: MotorSection,
    /// Pulses.
    pub(crate) drive: DriveSection,
    /// Synthesised motions, for jobs with the planner `synthesized_field`; null or left out for a rig that makes none.
    /// The library has to be measured with them.
    pub(crate) fields: Option<FieldSection>,
    /// Two 2-axis accelerometers under opposite corners.
    pub(crate) accelerometers: AccelerometerSection,
    /// Camera and light.
    pub camera: CameraSection,
    /// Friction and impacts. Only the simulated rig knows these.
    #[serde(default)]
    pub friction: FrictionSection,
    /// Kinds of part besides penny, nickel, dime and quarter, by name.
    #[serde(default)]
    pub(crate) kinds: BTreeMap<String, KindEntry>,
    /// The simulation itself.
    #[serde(default)]
    pub simulation: SimulationSection,
    /// COR library measured on this rig: a path relative to this file.
    pub library: Option<String>,
}

/// The moving plate. Each axis is a mass-spring-damper.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlateSection {
    /// Side of the square plate, mm.
    #[schemars(range(min = 20.0, max = 2000.0))]
    pub side_mm: f64,
    /// Moving mass, kg.
    #[schemars(range(min = 0.001, max = 1000.0))]
    pub(crate) mass_kg: f64,
    /// Moment of inertia about the centre, kg m². Left out: that of a uniform square, M L²/6.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub inertia_kg_m2: Option<f64>,
    /// Undamped natural frequency of each axis, Hz.
    pub(crate) resonance_hz: ResonanceHz,
    /// Damping ratio of each axis.
    pub(crate) damping_ratio: DampingRatio,
}

/// Undamped natural frequency of each axis, Hz; below the drive's base frequency.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct ResonanceHz {
    /// Along x, Hz.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub(crate) x: f64,
    /// Along y, Hz.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub(crate) y: f64,
    /// About the centre, Hz.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub(crate) spin: f64,
}

/// Damping ratio of each axis: 1 is critical.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct DampingRatio {
    /// Along x.
    #[schemars(range(min = 0.0, max = 2.0))]
    pub(crate) x: f64,
    /// Along y.
    #[schemars(range(min = 0.0, max = 2.0))]
    pub(crate) y: f64,
    /// About the centre.
    #[schemars(range(min = 0.0, max = 2.0))]
    pub(crate) spin: f64,
}

/// Waveform generator, amplifiers and voice coils X1, X2, Y1, Y2.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct MotorSection {
    /// Distance of the motors' lines of action from the plate's centre, mm.
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub(crate) lever_arm_mm: f64,
    /// Where the coils stand.
    #[serde(default, skip_serializing_if = "MotorArrangement::is_default")]
    pub(crate) arrangement: MotorArrangement,
    /// Force of one count, N.
    #[schemars(range(min = 1e-6, max = 1000.0))]
    pub(crate) newtons_per_count: f64,
    /// Error of each motor's force, as a part of it. Only the simulated rig knows this.
    #[serde(default)]
    #[schemars(inner(range(min = -0.5, max = 0.5)))]
    pub(crate) gain_error: [f64; 4],
    /// Samples a second of the waveform generator.
    #[serde(default = "motor_sample_hz")]
    #[schemars(range(min = 100.0, max = 1e6))]
    pub(crate) sample_hz: f64,
    /// Largest sample, counts.
    #[schemars(range(min = 8, max = 32767))]
    pub(crate) count_limit: u32,
    /// Corner of the low-pass behind the PWM, Hz.
    #[serde(default = "low_pass_hz")]
    #[schemars(range(min = 10.0, max = 1e6))]
    pub(crate) low_pass_hz: f64,
    /// Force at which a coil's amplifier saturates, N.
    #[schemars(range(min = 1e-3, max = 1e5))]
    pub(crate) force_limit_n: f64,
}

fn motor_sample_hz() -> f64 {
    10_000.0
}

fn low_pass_hz() -> f64 {
    1000.0
}

/// Pulses: base frequency and envelope.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct DriveSection {
    /// Base frequency of the vibration, Hz.
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub(crate) base_hz: f64,
    /// Attack and decay of every pulse, s; one period of the drive or more: shorter ones ask for much more force.
    #[serde(default = "attack_s")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub(crate) attack_s: f64,
    /// Rest after the longest pulse, until parts stand still, s; shorter ones rest down to half as long.
    #[serde(default = "rest_s")]
    #[schemars(range(min = 0.0, max = 5.0))]
    pub(crate) rest_s: f64,
    /// Longest time at full height, s.
    #[serde(default = "max_sustain_s")]
    #[schemars(range(min = 0.01, max = 10.0))]
    pub(crate) max_sustain_s: f64,
}

fn attack_s() -> f64 {
    0.02
}

fn rest_s() -> f64 {
    0.04
}

fn max_sustain_s() -> f64 {
    0.5
}

/// Synthesised motions: periodic ones of many harmonics, each as long as it takes under an envelope of its own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct FieldSection {
    /// Base frequency of the motions, Hz.
    #[schemars(range(min = 5.0, max = 200.0))]
    pub(crate) base_hz: f64,
    /// Harmonics of it.
    #[schemars(range(min = 2, max = 16))]
    pub(crate) harmonics: usize,
    /// Attack and decay of every pulse, s; half a period of the base frequency or more.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub(crate) attack_s: f64,
    /// Rest after every pulse, until parts stand still, s.
    #[schemars(range(min = 0.0, max = 5.0))]
    pub(crate) rest_s: f64,
}

/// Two 2-axis accelerometers; number 2 sits at minus the position of number 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct AccelerometerSection {
    /// Place of number 1 on the plate, mm.
    #[schemars(inner(range(min = -1000.0, max = 1000.0)))]
    pub(crate) position_mm: [f64; 2],
    /// Samples a second in every channel.
    #[schemars(range(min = 100.0, max = 1e6))]
    pub(crate) sample_hz: f64,
    /// Bits of the converter, sign included.
    #[schemars(range(min = 6, max = 16))]
    pub(crate) bits: u32,
    /// Largest acceleration shown, m/s².
    #[schemars(range(min = 0.1, max = 1e5))]
    pub(crate) range_mps2: f64,
    /// White noise, m/s² a sample. Only the simulated rig knows this and the next two.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 1e4))]
    pub(crate) noise_mps2: f64,
    /// Standard deviation of each channel's constant offset, m/s².
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 1e4))]
    pub(crate) bias_sd_mps2: f64,
    /// Standard deviation of each channel's gain error.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 0.2))]
    pub(crate) gain_sd: f64,
}

/// A camera that looks down on the plate, and the light. Control knows size, rate and lens, and finds out the rest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraSection {
    /// Columns and rows, px.
    #[schemars(inner(range(min = 64, max = 8192)))]
    pub size_px: [usize; 2],
    /// Frames a second.
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub frame_hz: f64,
    /// Time the shutter is open, s.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub exposure_s: f64,
    /// Focal length, px.
    #[schemars(range(min = 50.0, max = 1e5))]
    pub focal_px: f64,
    /// Where the optical axis meets the image, px. Left out: the middle.
    #[schemars(inner(range(min = -8192.0, max = 16384.0)))]
    pub principal_px: Option<[f64; 2]>,
    /// Radial distortion: factors of r² and r⁴, r in focal lengths.
    #[serde(default)]
    #[schemars(inner(range(min = -100.0, max = 100.0)))]
    pub radial: [f64; 2],
    /// Tangential distortion.
    #[serde(default)]
    #[schemars(inner(range(min = -1.0, max = 1.0)))]
    pub tangential: [f64; 2],
    /// Where the camera's centre is, mm: x right and y up from the plate's centre, z above the plate.
    #[schemars(inner(range(min = -20000.0, max = 20000.0)))]
    pub position_mm: [f64; 3],
    /// Rotation from looking straight down, about the image's x and y axes and about the optical axis, degrees.
    #[serde(default)]
    #[schemars(inner(range(min = -45.0, max = 45.0)))]
    pub tilt_deg: [f64; 3],
    /// Standard deviation of the lens's blur, px.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 10.0))]
    pub blur_px: f64,
    /// Gray levels in full light.
    #[serde(default)]
    pub levels: GrayLevels,
    /// How much darker the light's far corner is than its near one.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 0.9))]
    pub shading: f64,
    /// Direction in which light falls off, degrees, in the image.
    #[serde(default)]
    #[schemars(range(min = -360.0, max = 360.0))]
    pub shading_direction_deg: f64,
    /// Electrons at gray level 255, which set the shot noise; null for none.
    #[schemars(range(min = 100.0, max = 1e9))]
    pub full_well_e: Option<f64>,
    /// Read noise, gray levels.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 50.0))]
    pub read_noise: f64,
}

/// Gray levels in full light, 0 black, 255 white.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct GrayLevels {
    /// The ground under the plate.
    #[schemars(range(min = 0.0, max = 255.0))]
    pub ground: f64,
    /// The plate's face beside the parts.
    #[schemars(range(min = 0.0, max = 255.0))]
    pub plate: f64,
    /// Parts of every kind.
    #[schemars(range(min = 0.0, max = 255.0))]
    pub part: f64,
}

impl Default for GrayLevels {
    fn default() -> Self {
        Self { ground: 12.0, plate: 225.0, part: 30.0 }
    }
}

/// Coulomb friction and impacts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
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
#[serde(deny_unknown_fields)]
pub(crate) struct KindEntry {
    /// Diameter, mm; 0 is a point. A part for the camera has 1 mm or more.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub(crate) diameter_mm: f64,
    /// Mass of one part, g.
    #[schemars(range(min = 0.01, max = 10000.0))]
    pub(crate) mass_g: f64,
    /// Height, mm.
    #[schemars(range(min = 0.05, max = 100.0))]
    pub(crate) thickness_mm: f64,
    /// Friction against the plate. Left out: the rig's coefficient.
    #[schemars(range(min = 0.01, max = 2.0))]
    pub(crate) friction: Option<f64>,
}

/// The simulation itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SimulationSection {
    /// Time step of motors, plate and parts, s.
    #[schemars(range(min = 1e-6, max = 1e-3))]
    pub(crate) step_s: f64,
    /// Knocks against the plate from outside. Left out: none.
    pub knocks: Option<Knocks>,
}

/// Knocks from one side that push the plate out of its rest position, at random times and more or less hard.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Knocks {
    /// Mean time between two knocks, s; each time is between half and one and a half of it.
    #[schemars(range(min = 0.1, max = 1000.0))]
    pub(crate) every_s: f64,
    /// How far a knock pushes the plate on average, mm along x and y; each between half and one and a half of it.
    /// Not both 0.
    #[schemars(inner(range(min = -13.0, max = 13.0)))]
    pub(crate) push_mm: [f64; 2],
}

impl Default for SimulationSection {
    fn default() -> Self {
        Self { step_s: 5e-5, knocks: None }
    }
}
