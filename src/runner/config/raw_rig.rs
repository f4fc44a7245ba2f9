use std::collections::BTreeMap;
use std::fmt;

use schemars::JsonSchema;
use serde::de::{Error, MapAccess, Visitor, value::MapAccessDeserializer};
use serde::{Deserialize, Deserializer, Serialize};

use super::raw_simulation::RawSimulation;
use upm_core::signal::MotorArrangement;
use upm_document::SchemaKey;

/// A rig: a square plate on springs, four voice coils, two accelerometers, a camera above.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "rig")]
pub struct RawRig {
    /// Path or address of this file's schema, for editors. Nothing else reads it.
    #[serde(rename = "$schema", default, skip_serializing)]
    pub schema: SchemaKey,
    /// Name of the rig, for reports and libraries: letters, digits, `.`, `_` and `-`.
    #[schemars(length(min = 1, max = 64), extend("pattern" = "^[A-Za-z0-9._-]+$"))]
    pub name: String,
    /// The moving plate.
    pub plate: RawPlate,
    /// Waveform generator, amplifiers and voice coils.
    pub motors: RawMotors,
    /// Pulses.
    pub drive: RawDrive,
    /// Synthesised motions, for jobs with the planner `synthesized_field`; null or left out for a rig that makes none.
    /// The library has to be measured with them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fields: Option<RawFields>,
    /// Two 2-axis accelerometers under opposite corners.
    pub accelerometers: RawAccelerometers,
    /// Camera and light.
    pub camera: RawCamera,
    /// Friction and impacts. Only the simulated rig knows these.
    #[serde(default)]
    pub friction: RawFriction,
    /// Kinds of part besides penny, nickel, dime and quarter, by name.
    #[serde(default)]
    pub kinds: BTreeMap<String, RawKind>,
    /// The simulation itself.
    #[serde(default)]
    pub simulation: RawSimulation,
    /// COR library measured on this rig: a path relative to this file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub library: Option<String>,
}

/// The moving plate. Each axis is a mass-spring-damper.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawPlate {
    /// Side of the square plate, mm.
    #[schemars(range(min = 20.0, max = 2000.0))]
    pub side_mm: f64,
    /// Moving mass, kg.
    #[schemars(range(min = 0.001, max = 1000.0))]
    pub mass_kg: f64,
    /// Moment of inertia about the centre, kg m². Left out: that of a uniform square, M L²/6.
    #[serde(default)]
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub inertia_kg_m2: Option<f64>,
    /// Undamped natural frequency of each axis, Hz.
    pub resonance_hz: RawResonance,
    /// Damping ratio of each axis.
    pub damping_ratio: RawDamping,
}

/// Undamped natural frequency of each axis, Hz; below the drive's base frequency.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawResonance {
    /// Along x, Hz.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub x: f64,
    /// Along y, Hz.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub y: f64,
    /// About the centre, Hz.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub spin: f64,
}

/// Damping ratio of each axis: 1 is critical.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawDamping {
    /// Along x.
    #[schemars(range(min = 0.0, max = 2.0))]
    pub x: f64,
    /// Along y.
    #[schemars(range(min = 0.0, max = 2.0))]
    pub y: f64,
    /// About the centre.
    #[schemars(range(min = 0.0, max = 2.0))]
    pub spin: f64,
}

/// Waveform generator, amplifiers and voice coils X1, X2, Y1, Y2.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawMotors {
    /// Distance of the motors' lines of action from the plate's centre, mm.
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub lever_arm_mm: f64,
    /// Where the coils stand.
    #[serde(default, skip_serializing_if = "MotorArrangement::is_default")]
    pub arrangement: MotorArrangement,
    /// Force of one count, N.
    #[schemars(range(min = 1e-6, max = 1000.0))]
    pub newtons_per_count: f64,
    /// Error of each motor's force, as a part of it. Only the simulated rig knows this.
    #[serde(default)]
    #[schemars(inner(range(min = -0.5, max = 0.5)))]
    pub gain_error: [f64; 4],
    /// Samples a second of the waveform generator.
    #[serde(default = "motor_sample_hz")]
    #[schemars(range(min = 100.0, max = 1e6))]
    pub sample_hz: f64,
    /// Largest sample, counts.
    #[schemars(range(min = 8, max = 32767))]
    pub count_limit: u32,
    /// Corner of the low-pass behind the PWM, Hz.
    #[serde(default = "low_pass_hz")]
    #[schemars(range(min = 10.0, max = 1e6))]
    pub low_pass_hz: f64,
    /// Force at which a coil's amplifier saturates, N.
    #[schemars(range(min = 1e-3, max = 1e5))]
    pub force_limit_n: f64,
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
pub struct RawDrive {
    /// Base frequency of the vibration, Hz.
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub base_hz: f64,
    /// Attack and decay of every pulse, s; one period of the drive or more: shorter ones ask for much more force.
    #[serde(default = "attack_s")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub attack_s: f64,
    /// Rest after the longest pulse, until parts stand still, s; shorter ones rest down to half as long.
    #[serde(default = "rest_s")]
    #[schemars(range(min = 0.0, max = 5.0))]
    pub rest_s: f64,
    /// Longest time at full height, s.
    #[serde(default = "max_sustain_s")]
    #[schemars(range(min = 0.01, max = 10.0))]
    pub max_sustain_s: f64,
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
pub struct RawFields {
    /// Base frequency of the motions, Hz.
    #[schemars(range(min = 5.0, max = 200.0))]
    pub base_hz: f64,
    /// Harmonics of it.
    #[schemars(range(min = 2, max = 16))]
    pub harmonics: usize,
    /// Attack and decay of every pulse, s; half a period of the base frequency or more.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub attack_s: f64,
    /// Rest after every pulse, until parts stand still, s.
    #[schemars(range(min = 0.0, max = 5.0))]
    pub rest_s: f64,
}

/// Two 2-axis accelerometers; number 2 sits at minus the position of number 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawAccelerometers {
    /// Place of number 1 on the plate, mm.
    #[schemars(inner(range(min = -1000.0, max = 1000.0)))]
    pub position_mm: [f64; 2],
    /// Samples a second in every channel.
    #[schemars(range(min = 100.0, max = 1e6))]
    pub sample_hz: f64,
    /// Bits of the converter, sign included.
    #[schemars(range(min = 6, max = 16))]
    pub bits: u32,
    /// Largest acceleration shown, m/s².
    #[schemars(range(min = 0.1, max = 1e5))]
    pub range_mps2: f64,
    /// White noise, m/s² a sample. Only the simulated rig knows this and the next two.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 1e4))]
    pub noise_mps2: f64,
    /// Standard deviation of each channel's constant offset, m/s².
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 1e4))]
    pub bias_sd_mps2: f64,
    /// Standard deviation of each channel's gain error.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 0.2))]
    pub gain_sd: f64,
}

/// A camera that looks down on the plate, and the light. Control knows size, rate and lens, and finds out the rest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawCamera {
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
    #[serde(default)]
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
    pub levels: RawLevels,
    /// How much darker the light's far corner is than its near one.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 0.9))]
    pub shading: f64,
    /// Direction in which light falls off, degrees, in the image.
    #[serde(default)]
    #[schemars(range(min = -360.0, max = 360.0))]
    pub shading_direction_deg: f64,
    /// Electrons at gray level 255, which set the shot noise; null for none.
    #[serde(default)]
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
pub struct RawLevels {
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

impl Default for RawLevels {
    fn default() -> Self {
        Self { ground: 12.0, plate: 225.0, part: 30.0 }
    }
}

/// Coulomb friction and impacts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RawFriction {
    /// Friction between parts and plate.
    #[schemars(range(min = 0.01, max = 2.0))]
    pub coefficient: f64,
    /// Relative standard deviation of that from part to part.
    #[schemars(range(min = 0.0, max = 0.3))]
    pub spread: f64,
    /// Restitution between parts.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub restitution: f64,
    /// Friction between rims.
    #[schemars(range(min = 0.0, max = 2.0))]
    pub rim: f64,
}

impl Default for RawFriction {
    fn default() -> Self {
        Self { coefficient: 0.3, spread: 0.0, restitution: 0.3, rim: 0.2 }
    }
}

/// A kind of part: a disc, or a point that slides by Coulomb's law and neither spins nor touches others.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawKind {
    /// Diameter, mm; 0 is a point. A part for the camera has 1 mm or more.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub diameter_mm: f64,
    /// Mass of one part, g.
    #[schemars(range(min = 0.01, max = 10000.0))]
    pub mass_g: f64,
    /// Height, mm.
    #[schemars(range(min = 0.05, max = 100.0))]
    pub thickness_mm: f64,
    /// Friction against the plate. Left out: the rig's coefficient.
    #[serde(default)]
    #[schemars(range(min = 0.01, max = 2.0))]
    pub friction: Option<f64>,
}

/// A rig named by its file or written out.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum RigSource {
    /// Path of a rig file, relative to the file it stands in.
    #[schemars(title = "path")]
    File(String),
    /// The rig itself.
    Inline(Box<RawRig>),
}

/// By hand, so that a fault inside the object keeps its place; an untagged enum would lose it.
impl<'de> Deserialize<'de> for RigSource {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct PathOrObject;
        impl<'de> Visitor<'de> for PathOrObject {
            type Value = RigSource;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a path or a rig object")
            }

            fn visit_str<E: Error>(self, path: &str) -> Result<RigSource, E> {
                Ok(RigSource::File(path.to_owned()))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<RigSource, A::Error> {
                RawRig::deserialize(MapAccessDeserializer::new(map)).map(|rig| RigSource::Inline(Box::new(rig)))
            }
        }
        deserializer.deserialize_any(PathOrObject)
    }
}
