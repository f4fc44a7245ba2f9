//! The library and its file: units, ranges and decimals of its numbers there. Files stay small, and a library that was
//! read is written back byte for byte.

use std::f64::consts::TAU;

use nalgebra::{Complex, Matrix3};
use schemars::{JsonSchema, Schema};
use serde::{Deserialize, Serialize};

use upm_core::geometry::{Twist, Vec2};
use upm_core::signal::{CHANNELS, Harmonic, MotorArrangement};
use upm_core::units::{file_form, m_from_mm, mm_from_m};

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
/// Noise of a camera that shows nothing, px or mm.
const MOST_NOISE: f64 = 10.0;
/// Fewest entries with which a part can be steered.
const MIN_ENTRIES: usize = 3;
/// Range of the count limit of a waveform generator.
const LIMIT_COUNTS: (f64, f64) = (1.0, 1e6);
/// Largest speed (mm/s) or spin (rad/s) of one count.
const MOST_RESPONSE: f64 = 1e5;
/// Natural frequencies of a plate on springs, Hz; the drive's base frequency must be higher and is at most 10 kHz.
const NATURAL_HZ: (f64, f64) = (0.1, 10_000.0);
/// Names of the axes of a plate in files.
pub(super) const AXES: [&str; 3] = ["x", "y", "spin"];
/// Damping ratios from undamped to far beyond critical.
const DAMPING_RATIO: (f64, f64) = (0.0, 10.0);

/// One motion of the rig.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Amplitudes sent to the motors X1, X2, Y1, Y2, counts.
    pub amplitudes: [i32; 4],
    /// Measured amplitude T of the plate's pump wave `T (cos wt - ½ cos 2wt)` at full height.
    pub pump: Twist,
}

impl Entry {
    /// Centre of rotation, m; `None` for a translation, with a spin of exactly zero.
    pub fn center_m(&self) -> Option<Vec2> {
        self.pump.center_of_rotation()
    }

    /// Amplitude of the plate's speed under a part at `p_m`, m/s.
    pub fn speed_at(&self, p_m: Vec2) -> f64 {
        self.pump.velocity_at(p_m).norm()
    }
}

/// Force waveform of one axis (x, y or spin) for one unit of that axis's amplitude: harmonics 1 and 2, pre-compensated
/// for the calibrated deviation of the plate's response from 1/w.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisShape(pub [Harmonic; 2]);

impl AxisShape {
    /// `cos wt - sin 2wt` (Eq. 8): exact for a plate that is a free mass.
    pub const FREE_MASS: Self = Self([Harmonic { cos: 1.0, sin: 0.0 }, Harmonic { cos: 0.0, sin: -1.0 }]);
}

/// Measured distances of parts in one pulse: a grid over the plate's speed amplitude under the part and the pulse's
/// sustain.
// for a rotation the speed is spin times radius, so this is d(radius, sustain) of every entry at once, at any spin
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DisplacementModel {
    /// Grid of speed amplitudes, rising.
    #[serde(rename = "speed_mm_s", with = "speeds_mm_s")]
    #[schemars(with = "Vec<f64>", length(min = 2), inner(range(min = 0.0, max = MOST_SPEED_MM_S)))]
    pub speed_mps: Vec<f64>,
    /// Grid of sustains, rising.
    #[serde(with = "seconds_grid")]
    #[schemars(with = "Vec<f64>", length(min = 2), inner(range(min = 0.0, max = MOST_TIME_S)))]
    pub sustain_s: Vec<f64>,
    /// Distances along the flow: one row a speed, one column a sustain.
    #[serde(rename = "distance_mm", with = "mm_table")]
    #[schemars(with = "Vec<Vec<f64>>", inner(inner(range(min = 0.0, max = MOST_DISTANCE_MM))))]
    pub distance_m: Vec<Vec<f64>>,
    /// Standard deviation of one such pulse, same shape.
    #[serde(rename = "sd_mm", with = "mm_table")]
    #[schemars(with = "Vec<Vec<f64>>", inner(inner(range(min = 0.0, max = MOST_DISTANCE_MM))))]
    pub sd_m: Vec<Vec<f64>>,
}

/// Calibration of a rig: written by `upm calibrate`, used by the planner.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "library")]
pub struct Library {
    /// Name of the rig it was measured on.
    #[schemars(length(min = 1, max = 64))]
    pub rig: String,
    /// Fingerprint of that rig's file.
    pub fingerprint: String,
    /// Where its motors stand.
    #[serde(default, skip_serializing_if = "MotorArrangement::is_default")]
    pub motor_arrangement: MotorArrangement,
    /// Side of that rig's plate.
    #[serde(rename = "plate_side_mm", with = "mm")]
    #[schemars(with = "f64", range(min = PLATE_SIDE_MM.0, max = PLATE_SIDE_MM.1))]
    pub plate_side_m: f64,
    /// Base frequency.
    #[serde(rename = "base_hz", with = "hertz")]
    #[schemars(with = "f64", range(min = BASE_HZ.0, max = BASE_HZ.1))]
    pub base_radps: f64,
    /// Attack of every pulse, s.
    #[serde(with = "six_decimals")]
    #[schemars(with = "f64", range(min = 0.0, max = MOST_TIME_S))]
    pub attack_s: f64,
    /// Rest after the longest pulse, s; shorter ones rest down to half as long.
    #[serde(with = "six_decimals")]
    #[schemars(with = "f64", range(min = 0.0, max = MOST_TIME_S))]
    pub rest_s: f64,
    /// Reading of each accelerometer channel (x and y of number 1, x and y of number 2) for a true 1, relative to the
    /// others.
    #[serde(with = "gains")]
    #[schemars(with = "[f64; CHANNELS]", inner(range(min = GAIN.0, max = GAIN.1)))]
    pub accelerometer_gain: [f64; CHANNELS],
    /// Force waveforms of x, y and spin.
    #[serde(with = "shapes")]
    #[schemars(with = "ShapesForm")]
    pub shapes: [AxisShape; 3],
    /// All motions, in a fixed order.
    #[serde(with = "entries")]
    #[schemars(with = "Vec<EntryForm>", length(min = MIN_ENTRIES))]
    pub entries: Vec<Entry>,
    /// Measured distances of parts.
    pub displacement: DisplacementModel,
    /// Noise of the camera; null or left out in a library from before it was measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera_noise: Option<CameraNoise>,
    /// Response of the plate to synthesised motions; null or left out where the rig has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fields: Option<FieldResponse>,
    /// Resonances of the plate's axes; null or left out where the rig's longest sustain is too short to determine them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plate: Option<PlateResponse>,
}

/// The plate's axes as mass-spring-dampers `m q̈ + b q̇ + k q = f` (UPM paper, Eq. 33), in the order x, y, spin; all
/// zero is a free mass.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PlateResponse {
    /// Undamped natural frequencies `sqrt(k/m)`, 0.1 Hz to 10 kHz.
    #[serde(rename = "natural_hz", with = "axes_hz")]
    #[schemars(with = "PerAxis", transform = limit_axes(NATURAL_HZ))]
    pub natural_radps: [f64; 3],
    /// Damping ratios `b / (2 sqrt(k m))`, 0 to 10.
    #[serde(with = "axes")]
    #[schemars(with = "PerAxis", transform = limit_axes(DAMPING_RATIO))]
    pub damping_ratio: [f64; 3],
}

/// Standard deviations of what the camera measures of a plate at rest.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CameraNoise {
    /// Displacement of the plate's corners, px.
    #[serde(with = "six_decimals")]
    #[schemars(with = "f64", range(min = 0.0, max = MOST_NOISE))]
    pub corner_px: f64,
    /// Place of a coin along an axis.
    #[serde(rename = "place_mm", with = "mm")]
    #[schemars(with = "f64", range(min = 0.0, max = MOST_NOISE))]
    pub place_m: f64,
}

/// Response of the plate to each harmonic of the synthesised motions' base frequency.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FieldResponse {
    /// Base frequency w.
    #[serde(rename = "base_hz", with = "hertz")]
    #[schemars(with = "f64", range(min = BASE_HZ.0, max = BASE_HZ.1))]
    pub base_radps: f64,
    /// Attack of every pulse, s.
    #[serde(with = "six_decimals")]
    #[schemars(with = "f64", range(min = 0.0, max = MOST_TIME_S))]
    pub attack_s: f64,
    /// Rest after every pulse, s.
    #[serde(with = "six_decimals")]
    #[schemars(with = "f64", range(min = 0.0, max = MOST_TIME_S))]
    pub rest_s: f64,
    /// Largest sample that a motor may play.
    #[serde(with = "six_decimals")]
    #[schemars(with = "f64", range(min = LIMIT_COUNTS.0, max = LIMIT_COUNTS.1))]
    pub limit_counts: f64,
    /// One matrix a harmonic k, from the first up: rows x, y (in files mm/s) and spin (rad/s), columns one count of the
    /// axis amplitudes `fx = X1 - X2`, `fy = Y1 - Y2` and `s = (Y1 + Y2) - (X1 + X2)`, each a velocity phasor, in files
    /// `[re, im]`: a force `f(t) = Re(f e^{jkwt})` makes the plate move as `v(t) = Re(G f e^{jkwt})`, times from the
    /// start of the pulse.
    #[serde(with = "matrices")]
    #[schemars(
        with = "Vec<MatrixForm>",
        length(min = 1),
        inner(inner(inner(inner(range(min = -MOST_RESPONSE, max = MOST_RESPONSE)))))
    )]
    pub twist_from_counts: Vec<Matrix3<Complex<f64>>>,
}

/// Complex numbers `[re, im]`, row by row.
pub type MatrixForm = [[[f64; 2]; 3]; 3];

/// Force waveforms of the axes: `[cos, sin]` of harmonics 1 and 2 for one unit of amplitude.
#[derive(Serialize, Deserialize, JsonSchema)]
pub struct ShapesForm {
    /// Along x.
    #[schemars(inner(inner(range(min = -MOST_SHAPE, max = MOST_SHAPE))))]
    x: [[f64; 2]; 2],
    /// Along y.
    #[schemars(inner(inner(range(min = -MOST_SHAPE, max = MOST_SHAPE))))]
    y: [[f64; 2]; 2],
    /// About the centre.
    #[schemars(inner(inner(range(min = -MOST_SHAPE, max = MOST_SHAPE))))]
    spin: [[f64; 2]; 2],
}

/// One motion: what is sent to the motors and the plate's measured pump twist.
#[derive(Serialize, Deserialize, JsonSchema)]
pub struct EntryForm {
    /// Amplitudes of the motors X1, X2, Y1, Y2, counts.
    #[schemars(inner(range(min = -MOST_AMPLITUDE, max = MOST_AMPLITUDE)))]
    amplitudes: [i32; 4],
    /// Velocity amplitude of the plate's centre, x and y.
    #[schemars(inner(range(min = -MOST_SPEED_MM_S, max = MOST_SPEED_MM_S)))]
    velocity_mm_s: [f64; 2],
    /// Spin amplitude, counter-clockwise.
    #[schemars(range(min = -MOST_SPIN_RAD_S, max = MOST_SPIN_RAD_S))]
    spin_rad_s: f64,
}

/// One number for each axis of the plate.
#[derive(Serialize, Deserialize, JsonSchema)]
#[schemars(inline)]
pub struct PerAxis {
    /// Along x.
    x: f64,
    /// Along y.
    y: f64,
    /// About the centre.
    spin: f64,
}

/// Limits the schema of a [`PerAxis`] on every axis.
fn limit_axes((low, high): (f64, f64)) -> impl FnMut(&mut Schema) {
    move |schema| {
        for axis in AXES {
            if let Some(number) = schema.pointer_mut(&format!("/properties/{axis}")) {
                number["minimum"] = low.into();
                number["maximum"] = high.into();
            }
        }
    }
}

file_form!(mm: f64 => f64, m_from_mm, |m| rounded(mm_from_m(*m), 6));
file_form!(hertz: f64 => f64, |hz| TAU * hz, |radps| rounded(radps / TAU, 6));
file_form!(six_decimals: f64 => f64, |value| value, |value| rounded(*value, 6));
file_form!(gains: [f64; CHANNELS] => [f64; CHANNELS], |gains| gains, |gains| gains.map(|gain| rounded(gain, 5)));
file_form!(speeds_mm_s: Vec<f64> => Vec<f64>, |mm_s| all_m(&mm_s), |mps| rounded_mm(mps, 3));
file_form!(seconds_grid: Vec<f64> => Vec<f64>, |s| s, |grid| grid.iter().map(|&s| rounded(s, 6)).collect());
file_form!(
    mm_table: Vec<Vec<f64>> => Vec<Vec<f64>>, |rows| rows.iter().map(|row| all_m(row)).collect(),
    |rows| rows.iter().map(|row| rounded_mm(row, 4)).collect()
);
file_form!(
    shapes: ShapesForm => [AxisShape; 3],
    |form| [form.x, form.y, form.spin].map(|axis| AxisShape(axis.map(|[cos, sin]| Harmonic { cos, sin }))),
    |shapes| {
        let [x, y, spin] = shapes.map(|shape| shape.0.map(|h| [rounded(h.cos, 6), rounded(h.sin, 6)]));
        ShapesForm { x, y, spin }
    }
);
file_form!(
    entries: Vec<EntryForm> => Vec<Entry>, |forms| forms.into_iter().map(entry).collect(),
    |entries| entries.iter().map(entry_form).collect()
);
file_form!(axes_hz: PerAxis => [f64; 3], |PerAxis { x, y, spin }| [x, y, spin].map(|hz| TAU * hz),
    |radps| per_axis(radps.map(|w| w / TAU)));
file_form!(axes: PerAxis => [f64; 3], |PerAxis { x, y, spin }| [x, y, spin], |values| per_axis(*values));
file_form!(
    matrices: Vec<MatrixForm> => Vec<Matrix3<Complex<f64>>>, |forms| forms.iter().map(matrix).collect(),
    |matrices| matrices.iter().map(matrix_form).collect()
);

/// `value` rounded to `decimals`.
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

fn matrix_form(matrix: &Matrix3<Complex<f64>>) -> MatrixForm {
    let millimetres = |part: f64| rounded(mm_from_m(part), 7);
    let row = |i: usize, in_file: &dyn Fn(f64) -> f64| {
        [0, 1, 2].map(|k| [in_file(matrix[(i, k)].re), in_file(matrix[(i, k)].im)])
    };
    [row(0, &millimetres), row(1, &millimetres), row(2, &|part| rounded(part, 9))]
}

fn matrix(form: &MatrixForm) -> Matrix3<Complex<f64>> {
    let [x, y, spin] = *form;
    let velocity = |row: [[f64; 2]; 3]| row.map(|[re, im]| Complex::new(m_from_mm(re), m_from_mm(im)));
    let spin = spin.map(|[re, im]| Complex::new(re, im));
    Matrix3::from_row_iterator([velocity(x), velocity(y), spin].into_iter().flatten())
}

fn entry_form(entry: &Entry) -> EntryForm {
    let Twist { velocity_mps, spin_radps } = entry.pump;
    let velocity_mm_s = [velocity_mps.x, velocity_mps.y].map(|v| rounded(mm_from_m(v), 3));
    EntryForm { amplitudes: entry.amplitudes, velocity_mm_s, spin_rad_s: rounded(spin_radps, 5) }
}

fn entry(form: EntryForm) -> Entry {
    let velocity_mps = Vec2::from(form.velocity_mm_s.map(m_from_mm));
    Entry { amplitudes: form.amplitudes, pump: Twist { velocity_mps, spin_radps: form.spin_rad_s } }
}

fn per_axis(values: [f64; 3]) -> PerAxis {
    let [x, y, spin] = values.map(|value| rounded(value, 4));
    PerAxis { x, y, spin }
}
