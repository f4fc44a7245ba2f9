use nalgebra::{Complex, Matrix3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::forms::{
    BASE_HZ, EntryForm, GAIN, LIMIT_COUNTS, MOST_DISTANCE_MM, MOST_RESPONSE, MOST_SPEED_MM_S, MOST_TIME_S, MatrixForm,
    PLATE_SIDE_MM, PerAxis, ShapesForm, axes, axes_hz, counts, entries, gains, hertz, matrices, mm, mm_table, seconds,
    seconds_grid, shapes, speeds_mm_s,
};
use upm_core::geometry::{Twist, Vec2};
use upm_core::signal::{CHANNELS, Harmonic, MotorArrangement};

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
#[serde(deny_unknown_fields)]
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
#[serde(deny_unknown_fields)]
#[schemars(title = "library")]
pub struct Library {
    /// Name of the rig it was measured on.
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
    #[serde(with = "seconds")]
    #[schemars(with = "f64", range(min = 0.0, max = MOST_TIME_S))]
    pub attack_s: f64,
    /// Rest after the longest pulse, s; shorter ones rest down to half as long.
    #[serde(with = "seconds")]
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
    #[schemars(with = "Vec<EntryForm>")]
    pub entries: Vec<Entry>,
    /// Measured distances of parts.
    pub displacement: DisplacementModel,
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
#[serde(deny_unknown_fields)]
pub struct PlateResponse {
    /// Undamped natural frequencies `sqrt(k/m)`, 0.1 Hz to 10 kHz.
    #[serde(rename = "natural_hz", with = "axes_hz")]
    #[schemars(with = "PerAxis")]
    pub natural_radps: [f64; 3],
    /// Damping ratios `b / (2 sqrt(k m))`, 0 to 10.
    #[serde(with = "axes")]
    #[schemars(with = "PerAxis")]
    pub damping_ratio: [f64; 3],
}

/// Response of the plate to each harmonic of the synthesised motions' base frequency.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FieldResponse {
    /// Base frequency w.
    #[serde(rename = "base_hz", with = "hertz")]
    #[schemars(with = "f64", range(min = BASE_HZ.0, max = BASE_HZ.1))]
    pub base_radps: f64,
    /// Attack of every pulse, s.
    #[serde(with = "seconds")]
    #[schemars(with = "f64", range(min = 0.0, max = MOST_TIME_S))]
    pub attack_s: f64,
    /// Rest after every pulse, s.
    #[serde(with = "seconds")]
    #[schemars(with = "f64", range(min = 0.0, max = MOST_TIME_S))]
    pub rest_s: f64,
    /// Largest sample that a motor may play.
    #[serde(with = "counts")]
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
