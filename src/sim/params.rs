use nalgebra::Vector3;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};

use upm_core::geometry::{Lens, Vec2};
use upm_core::signal::MotorArrangement;
use upm_core::units::{degrees, file_form, m_from_mm, mm, mm_point, whole, written_degrees, written_mm};

/// Constant parameters of the simulated rig, apart from all state.
#[derive(Clone, Debug, PartialEq)]
pub struct SimParams {
    /// Time step of motors, plate and parts, s.
    pub step_s: f64,
    /// Size, mass and springs of the plate.
    pub plate: PlateParams,
    /// Waveform generator, amplifiers and voice coils.
    pub motors: MotorParams,
    /// The two accelerometers.
    pub accelerometers: AccelerometerParams,
    /// Optics, position and noise of the camera, and the light.
    pub camera: CameraParams,
    /// Contact between parts.
    pub contact: ContactParams,
}

/// The moving plate. Each axis is a mass-spring-damper.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PlateParams {
    /// Side of the square plate.
    #[serde(rename = "side_mm", with = "mm")]
    #[schemars(with = "f64", range(min = 20.0, max = 2000.0))]
    pub side_m: f64,
    /// Moving mass, kg.
    #[schemars(range(min = 0.001, max = 1000.0))]
    pub mass_kg: f64,
    /// Moment of inertia about the centre, kg m². Left out: that of a uniform square, M L²/6.
    #[serde(rename = "inertia_kg_m2", default, with = "or_zero")]
    #[schemars(with = "Option<f64>", extend("exclusiveMinimum" = 0.0))]
    pub inertia_kgm2: f64,
    /// Undamped natural frequency of each axis, Hz; below the drive's base frequency.
    #[serde(with = "axes")]
    #[schemars(schema_with = "axes_schema::<1000>")]
    pub resonance_hz: [f64; 3],
    /// Damping ratio of each axis: 1 is critical.
    #[serde(with = "axes")]
    #[schemars(schema_with = "axes_schema::<2>")]
    pub damping_ratio: [f64; 3],
}

/// One value for each axis, in the order of the triples.
#[derive(Serialize, Deserialize)]
struct Axes {
    x: f64,
    y: f64,
    spin: f64,
}

file_form!(axes: Axes => [f64; 3], |axes| [axes.x, axes.y, axes.spin], |&[x, y, spin]| Axes { x, y, spin });
file_form!(or_zero: Option<f64> => f64, Option::unwrap_or_default, |value| Some(*value).filter(|value| *value != 0.0));
file_form!(or_infinite: Option<f64> => f64, |value| value.unwrap_or(f64::INFINITY),
    |value| Some(*value).filter(|value| value.is_finite()));
file_form!(counts: u32 => f64, f64::from, |counts| *counts as u32);
file_form!(mm_place: [f64; 3] => Vector3<f64>, |mm| mm.map(m_from_mm).into(),
    |m| <[f64; 3]>::from(*m).map(written_mm));
file_form!(three_degrees: [f64; 3] => [f64; 3], |degrees| degrees.map(f64::to_radians),
    |rad| rad.map(written_degrees));
file_form!(gray_levels: GrayLevels => [f64; 3], |levels| [levels.ground, levels.plate, levels.part],
    |&[ground, plate, part]| GrayLevels { ground, plate, part });

fn axes_schema<const MOST: u32>(_: &mut SchemaGenerator) -> Schema {
    let most = f64::from(MOST);
    let value = |of: &str| json_schema!({ "description": of, "type": "number", "minimum": 0.0, "maximum": most });
    json_schema!({
        "type": "object", "required": ["x", "y", "spin"],
        "properties": { "x": value("Along x."), "y": value("Along y."), "spin": value("About the centre.") },
    })
}

/// Waveform generator, amplifiers and voice coils X1, X2, Y1, Y2.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct MotorParams {
    /// Distance of the motors' lines of action from the plate's centre.
    #[serde(rename = "lever_arm_mm", with = "mm")]
    #[schemars(with = "f64", range(min = 1.0, max = 1000.0))]
    pub lever_arm_m: f64,
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
    #[serde(default = "whole::<f64, 10_000>")]
    #[schemars(range(min = 100.0, max = 1e6))]
    pub sample_hz: f64,
    /// Largest sample, counts.
    #[serde(with = "counts")]
    #[schemars(with = "u32", range(min = 8, max = 32767))]
    pub count_limit: f64,
    /// Corner of the low-pass behind the PWM, Hz.
    #[serde(default = "whole::<f64, 1000>")]
    #[schemars(range(min = 10.0, max = 1e6))]
    pub low_pass_hz: f64,
    /// Force at which a coil's amplifier saturates, N.
    #[schemars(range(min = 1e-3, max = 1e5))]
    pub force_limit_n: f64,
}

/// Two 2-axis accelerometers; number 2 sits at minus the position of number 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AccelerometerParams {
    /// Place of number 1 on the plate.
    #[serde(rename = "position_mm", with = "mm_point")]
    #[schemars(with = "[f64; 2]", inner(range(min = -1000.0, max = 1000.0)))]
    pub position_m: Vec2,
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
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CameraParams {
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
    /// Where the camera's centre is: x right and y up from the plate's centre, z above the plate.
    #[serde(rename = "position_mm", with = "mm_place")]
    #[schemars(with = "[f64; 3]", inner(range(min = -20000.0, max = 20000.0)))]
    pub position_m: Vector3<f64>,
    /// Rotation from looking straight down, about the image's x and y axes and about the optical axis.
    #[serde(rename = "tilt_deg", default, with = "three_degrees")]
    #[schemars(with = "[f64; 3]", inner(range(min = -45.0, max = 45.0)))]
    pub tilt_rad: [f64; 3],
    /// Standard deviation of the lens's blur, px.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 10.0))]
    pub blur_px: f64,
    /// Gray levels in full light.
    #[serde(default = "default_levels", with = "gray_levels")]
    #[schemars(with = "GrayLevels")]
    pub levels: [f64; 3],
    /// How much darker the light's far corner is than its near one.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 0.9))]
    pub shading: f64,
    /// Direction in which light falls off, in the image.
    #[serde(rename = "shading_direction_deg", default, with = "degrees")]
    #[schemars(with = "f64", range(min = -360.0, max = 360.0))]
    pub shading_direction_rad: f64,
    /// Electrons at gray level 255, which set the shot noise; null for none.
    #[serde(default = "no_shot_noise", with = "or_infinite")]
    #[schemars(with = "Option<f64>", range(min = 100.0, max = 1e9))]
    pub full_well_e: f64,
    /// Read noise, gray levels.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 50.0))]
    pub read_noise: f64,
}

/// Gray levels in full light, 0 black, 255 white.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
struct GrayLevels {
    /// The ground under the plate.
    #[schemars(range(min = 0.0, max = 255.0))]
    ground: f64,
    /// The plate's face beside the parts.
    #[schemars(range(min = 0.0, max = 255.0))]
    plate: f64,
    /// Parts of every kind.
    #[schemars(range(min = 0.0, max = 255.0))]
    part: f64,
}

fn no_shot_noise() -> f64 {
    f64::INFINITY
}

fn default_levels() -> [f64; 3] {
    [12.0, 225.0, 30.0]
}

impl Default for GrayLevels {
    fn default() -> Self {
        let [ground, plate, part] = default_levels();
        Self { ground, plate, part }
    }
}

impl CameraParams {
    /// Focal length, principal point and distortion.
    pub fn lens(&self) -> Lens {
        let middle_px = self.size_px.map(|size| (size as f64 - 1.0) / 2.0);
        let principal_px = Vec2::from(self.principal_px.unwrap_or(middle_px));
        Lens { focal_px: self.focal_px, principal_px, radial: self.radial, tangential: self.tangential }
    }

    /// Standard deviation of read and shot noise at a gray level: the root of `read_noise² + level · 255/full_well`.
    pub fn noise_sd(&self, level: f64) -> f64 {
        (self.read_noise.powi(2) + level * 255.0 / self.full_well_e).sqrt()
    }
}

/// Contact between parts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactParams {
    /// Coefficient of restitution between parts.
    pub restitution: f64,
    /// Coefficient of Coulomb friction between rims.
    pub rim_friction: f64,
}

/// One part: a disc.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartParams {
    /// Radius of its outline, m.
    pub radius_m: f64,
    /// Height, m.
    pub thickness_m: f64,
    /// Mass of the disc, kg.
    pub mass_kg: f64,
    /// Coefficient of Coulomb friction against the plate.
    pub friction: f64,
}

#[cfg(test)]
impl PartParams {
    /// A US penny on a plate of friction 0.3.
    pub const PENNY: Self = Self { radius_m: 9.525e-3, thickness_m: 1.52e-3, mass_kg: 2.5e-3, friction: 0.3 };
}
