use std::f64::consts::TAU;

use nalgebra::{Complex, Matrix3};
use schemars::JsonSchema;
use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};

use super::{AxisShape, DisplacementModel, Entry, FieldResponse, Library, PlateResponse};
use upm_core::geometry::{Twist, Vec2};
use upm_core::signal::{CHANNELS, Harmonic, MotorArrangement};
use upm_core::units::{m_from_mm, mm_from_m};

/// Wide bounds of real plates, in this and the following constants; a number outside them is a mistake of unit.
const PLATE_SIDE_MM: (f64, f64) = (1.0, 1e4);
const GAIN: (f64, f64) = (0.5, 2.0);
const BASE_HZ: (f64, f64) = (1.0, 10_000.0);
const MOST_TIME_S: f64 = 100.0;
const MOST_AMPLITUDE: i32 = 1_000_000;
const MOST_SHAPE: f64 = 1e3;
const MOST_SPEED_MM_S: f64 = 1e5;
const MOST_SPIN_RAD_S: f64 = 1e4;
const MOST_DISTANCE_MM: f64 = 1e3;
/// Range of the count limit of a waveform generator.
const LIMIT_COUNTS: (f64, f64) = (1.0, 1e6);
/// Largest speed (mm/s) or spin (rad/s) of one count.
const MOST_RESPONSE: f64 = 1e5;
/// Natural frequencies of a plate on springs, Hz; the drive's base frequency must be higher and is at most 10 kHz.
pub(super) const NATURAL_HZ: (f64, f64) = (0.1, 10_000.0);
/// Damping ratios from undamped to far beyond critical.
pub(super) const DAMPING_RATIO: (f64, f64) = (0.0, 10.0);

/// Complex numbers `[re, im]`, row by row.
type RawMatrix = [[[f64; 2]; 3]; 3];

/// A library as its file has it, not yet validated: [`Library::try_from`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "library")]
pub struct RawLibrary {
    /// Path or address of this file's schema, for editors. Nothing else reads it.
    #[serde(rename = "$schema", default, skip_serializing)]
    #[schemars(with = "String")]
    pub schema: IgnoredAny,
    /// Name of the rig it was measured on.
    pub rig: String,
    /// Fingerprint of that rig's file.
    pub fingerprint: String,
    /// Where its motors stand.
    #[serde(default, skip_serializing_if = "MotorArrangement::is_default")]
    pub motor_arrangement: MotorArrangement,
    /// Side of that rig's plate.
    #[schemars(range(min = PLATE_SIDE_MM.0, max = PLATE_SIDE_MM.1))]
    pub plate_side_mm: f64,
    /// Base frequency.
    #[schemars(range(min = BASE_HZ.0, max = BASE_HZ.1))]
    pub base_hz: f64,
    /// Attack of every pulse.
    #[schemars(range(min = 0.0, max = MOST_TIME_S))]
    pub attack_s: f64,
    /// Rest after the longest pulse; shorter ones rest down to half as long.
    #[schemars(range(min = 0.0, max = MOST_TIME_S))]
    pub rest_s: f64,
    /// Reading of each accelerometer channel (x and y of number 1, x and y of number 2) per true 1.
    #[schemars(inner(range(min = GAIN.0, max = GAIN.1)))]
    pub accelerometer_gain: [f64; CHANNELS],
    /// Force waveforms.
    pub shapes: RawShapes,
    /// Every motion.
    pub entries: Vec<RawEntry>,
    /// How far parts go.
    pub displacement: RawDisplacement,
    /// How the plate answers to synthesised motions; null or left out where the rig has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fields: Option<RawFieldResponse>,
    /// Resonances of the plate's axes; null or left out where they were not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plate: Option<RawPlateResponse>,
}

/// Force waveforms of the axes: `[cos, sin]` of harmonics 1 and 2 for one unit of amplitude.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawShapes {
    /// Along x.
    #[schemars(inner(inner(range(min = -MOST_SHAPE, max = MOST_SHAPE))))]
    pub x: [[f64; 2]; 2],
    /// Along y.
    #[schemars(inner(inner(range(min = -MOST_SHAPE, max = MOST_SHAPE))))]
    pub y: [[f64; 2]; 2],
    /// About the centre.
    #[schemars(inner(inner(range(min = -MOST_SHAPE, max = MOST_SHAPE))))]
    pub spin: [[f64; 2]; 2],
}

/// One motion: what is sent to the motors and the plate's measured pump twist.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawEntry {
    /// Amplitudes of the motors X1, X2, Y1, Y2, counts.
    #[schemars(inner(range(min = -MOST_AMPLITUDE, max = MOST_AMPLITUDE)))]
    pub amplitudes: [i32; 4],
    /// Velocity amplitude of the plate's centre, x and y.
    #[schemars(inner(range(min = -MOST_SPEED_MM_S, max = MOST_SPEED_MM_S)))]
    pub velocity_mm_s: [f64; 2],
    /// Spin amplitude, counter-clockwise.
    #[schemars(range(min = -MOST_SPIN_RAD_S, max = MOST_SPIN_RAD_S))]
    pub spin_rad_s: f64,
}

/// Measured distances over the plate's speed amplitude under the part and the pulse's sustain.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawDisplacement {
    /// Rising speeds.
    #[schemars(length(min = 2), inner(range(min = 0.0, max = MOST_SPEED_MM_S)))]
    pub speed_mm_s: Vec<f64>,
    /// Rising sustains.
    #[schemars(length(min = 2), inner(range(min = 0.0, max = MOST_TIME_S)))]
    pub sustain_s: Vec<f64>,
    /// One row a speed, one column a sustain.
    #[schemars(inner(inner(range(min = 0.0, max = MOST_DISTANCE_MM))))]
    pub distance_mm: Vec<Vec<f64>>,
    /// Standard deviation of one pulse, same shape.
    #[schemars(inner(inner(range(min = 0.0, max = MOST_DISTANCE_MM))))]
    pub sd_mm: Vec<Vec<f64>>,
}

/// How the plate answers to each harmonic of synthesised motions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RawFieldResponse {
    /// Base frequency.
    #[schemars(range(min = BASE_HZ.0, max = BASE_HZ.1))]
    pub base_hz: f64,
    /// Attack of every pulse.
    #[schemars(range(min = 0.0, max = MOST_TIME_S))]
    pub attack_s: f64,
    /// Rest after every pulse.
    #[schemars(range(min = 0.0, max = MOST_TIME_S))]
    pub rest_s: f64,
    /// Largest sample a motor may be told to play.
    #[schemars(range(min = LIMIT_COUNTS.0, max = LIMIT_COUNTS.1))]
    pub limit_counts: f64,
    /// One matrix a harmonic, from the first up: rows x (mm/s), y (mm/s) and spin (rad/s), columns one count of X1-X2,
    /// Y1-Y2 and (Y1+Y2)-(X1+X2), each a velocity phasor `[re, im]` for a force `cos kwt`.
    #[schemars(length(min = 1), inner(inner(inner(inner(range(min = -MOST_RESPONSE, max = MOST_RESPONSE))))))]
    pub twist_from_counts: Vec<RawMatrix>,
}

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

/// `value` rounded to `decimals`, so that files stay small and a saved library loads to the same bytes again.
fn rounded(value: f64, decimals: i32) -> f64 {
    let scale = 10f64.powi(decimals);
    let rounded = (value * scale).round() / scale;
    if rounded == 0.0 { 0.0 } else { rounded }
}

fn rounded_mm(values_m: &[f64], decimals: i32) -> Vec<f64> {
    values_m.iter().map(|&m| rounded(mm_from_m(m), decimals)).collect()
}

fn all_m(values_mm: &[f64]) -> Vec<f64> {
    values_mm.iter().map(|&mm| m_from_mm(mm)).collect()
}

fn raw_shape(shape: &AxisShape) -> [[f64; 2]; 2] {
    shape.0.map(|h| [rounded(h.cos, 6), rounded(h.sin, 6)])
}

fn shape(raw: [[f64; 2]; 2]) -> AxisShape {
    AxisShape(raw.map(|[cos, sin]| Harmonic { cos, sin }))
}

fn raw_matrix(matrix: &Matrix3<Complex<f64>>) -> RawMatrix {
    let millimetres = |part: f64| rounded(mm_from_m(part), 7);
    let row = |i: usize, in_file: &dyn Fn(f64) -> f64| {
        [0, 1, 2].map(|k| [in_file(matrix[(i, k)].re), in_file(matrix[(i, k)].im)])
    };
    [row(0, &millimetres), row(1, &millimetres), row(2, &|part| rounded(part, 9))]
}

pub(super) fn matrix(raw: &RawMatrix) -> Matrix3<Complex<f64>> {
    let [x, y, spin] = *raw;
    let velocity = |row: [[f64; 2]; 3]| row.map(|[re, im]| Complex::new(m_from_mm(re), m_from_mm(im)));
    let spin = spin.map(|[re, im]| Complex::new(re, im));
    Matrix3::from_row_iterator([velocity(x), velocity(y), spin].into_iter().flatten())
}

impl From<&Library> for RawLibrary {
    fn from(library: &Library) -> Self {
        let [x, y, spin] = library.shapes.each_ref().map(raw_shape);
        Self {
            schema: IgnoredAny,
            rig: library.rig.clone(),
            fingerprint: library.fingerprint.clone(),
            motor_arrangement: library.motor_arrangement,
            plate_side_mm: rounded(mm_from_m(library.plate_side_m), 6),
            base_hz: rounded(library.base_radps / TAU, 6),
            attack_s: rounded(library.attack_s, 6),
            rest_s: rounded(library.rest_s, 6),
            accelerometer_gain: library.accelerometer_gain.map(|gain| rounded(gain, 5)),
            shapes: RawShapes { x, y, spin },
            entries: library.entries.iter().map(RawEntry::from).collect(),
            displacement: RawDisplacement::from(&library.displacement),
            fields: library.fields.as_ref().map(RawFieldResponse::from),
            plate: library.plate.as_ref().map(RawPlateResponse::from),
        }
    }
}

impl From<&Entry> for RawEntry {
    fn from(entry: &Entry) -> Self {
        let Twist { velocity_mps, spin_radps } = entry.pump;
        let velocity_mm_s = [velocity_mps.x, velocity_mps.y].map(|v| rounded(mm_from_m(v), 3));
        Self { amplitudes: entry.amplitudes, velocity_mm_s, spin_rad_s: rounded(spin_radps, 5) }
    }
}

impl From<&DisplacementModel> for RawDisplacement {
    fn from(model: &DisplacementModel) -> Self {
        let table = |rows: &[Vec<f64>]| rows.iter().map(|row| rounded_mm(row, 4)).collect();
        Self {
            speed_mm_s: rounded_mm(&model.speed_mps, 3),
            sustain_s: model.sustain_s.iter().map(|&s| rounded(s, 6)).collect(),
            distance_mm: table(&model.distance_m),
            sd_mm: table(&model.sd_m),
        }
    }
}

impl RawLibrary {
    /// The library in SI units, without validation.
    pub(super) fn into_library(self) -> Library {
        let table = |rows: &[Vec<f64>]| rows.iter().map(|row| all_m(row)).collect();
        let entry = |raw: &RawEntry| {
            let [vx, vy] = raw.velocity_mm_s.map(m_from_mm);
            Entry {
                amplitudes: raw.amplitudes,
                pump: Twist { velocity_mps: Vec2::new(vx, vy), spin_radps: raw.spin_rad_s },
            }
        };
        Library {
            motor_arrangement: self.motor_arrangement,
            plate_side_m: m_from_mm(self.plate_side_mm),
            base_radps: TAU * self.base_hz,
            attack_s: self.attack_s,
            rest_s: self.rest_s,
            accelerometer_gain: self.accelerometer_gain,
            shapes: [shape(self.shapes.x), shape(self.shapes.y), shape(self.shapes.spin)],
            entries: self.entries.iter().map(entry).collect(),
            displacement: DisplacementModel {
                speed_mps: all_m(&self.displacement.speed_mm_s),
                sustain_s: self.displacement.sustain_s.clone(),
                distance_m: table(&self.displacement.distance_mm),
                sd_m: table(&self.displacement.sd_mm),
            },
            fields: self.fields.as_ref().map(RawFieldResponse::response),
            plate: self.plate.as_ref().map(RawPlateResponse::response),
            rig: self.rig,
            fingerprint: self.fingerprint,
        }
    }
}

impl From<&FieldResponse> for RawFieldResponse {
    fn from(response: &FieldResponse) -> Self {
        Self {
            base_hz: rounded(response.base_radps / TAU, 6),
            attack_s: rounded(response.attack_s, 6),
            rest_s: rounded(response.rest_s, 6),
            limit_counts: rounded(response.limit_counts, 6),
            twist_from_counts: response.twist_from_counts.iter().map(raw_matrix).collect(),
        }
    }
}

impl RawFieldResponse {
    /// The response in SI units, without validation.
    fn response(&self) -> FieldResponse {
        FieldResponse {
            base_radps: TAU * self.base_hz,
            attack_s: self.attack_s,
            rest_s: self.rest_s,
            limit_counts: self.limit_counts,
            twist_from_counts: self.twist_from_counts.iter().map(matrix).collect(),
        }
    }
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
    /// The response in SI units, without validation.
    fn response(&self) -> PlateResponse {
        PlateResponse {
            natural_radps: self.natural_hz.values().map(|hz| TAU * hz),
            damping_ratio: self.damping_ratio.values(),
        }
    }
}
