//! Numbers of a library in its file: units, ranges and decimals. Files stay small, and a library that was read is
//! written back byte for byte.

use std::f64::consts::TAU;

use nalgebra::{Complex, Matrix3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{AxisShape, Entry};
use upm_core::geometry::{Twist, Vec2};
use upm_core::signal::{CHANNELS, Harmonic};
use upm_core::units::{file_form, m_from_mm, mm_from_m};

/// Wide bounds of real plates, in this and the following constants; a number outside them is a mistake of unit.
pub(super) const PLATE_SIDE_MM: (f64, f64) = (1.0, 1e4);
pub(super) const GAIN: (f64, f64) = (0.5, 2.0);
pub(super) const BASE_HZ: (f64, f64) = (1.0, 10_000.0);
pub(super) const MOST_TIME_S: f64 = 100.0;
const MOST_AMPLITUDE: i32 = 1_000_000;
const MOST_SHAPE: f64 = 1e3;
pub(super) const MOST_SPEED_MM_S: f64 = 1e5;
const MOST_SPIN_RAD_S: f64 = 1e4;
pub(super) const MOST_DISTANCE_MM: f64 = 1e3;
/// Range of the count limit of a waveform generator.
pub(super) const LIMIT_COUNTS: (f64, f64) = (1.0, 1e6);
/// Largest speed (mm/s) or spin (rad/s) of one count.
pub(super) const MOST_RESPONSE: f64 = 1e5;
/// Natural frequencies of a plate on springs, Hz; the drive's base frequency must be higher and is at most 10 kHz.
pub(super) const NATURAL_HZ: (f64, f64) = (0.1, 10_000.0);
/// Damping ratios from undamped to far beyond critical.
pub(super) const DAMPING_RATIO: (f64, f64) = (0.0, 10.0);

/// Complex numbers `[re, im]`, row by row.
pub type MatrixForm = [[[f64; 2]; 3]; 3];

/// Force waveforms of the axes: `[cos, sin]` of harmonics 1 and 2 for one unit of amplitude.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
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
#[serde(deny_unknown_fields)]
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
#[serde(deny_unknown_fields)]
pub struct PerAxis {
    /// Along x.
    x: f64,
    /// Along y.
    y: f64,
    /// About the centre.
    spin: f64,
}

file_form!(mm: f64 => f64, m_from_mm, |m| rounded(mm_from_m(*m), 6));
file_form!(hertz: f64 => f64, |hz| TAU * hz, |radps| rounded(radps / TAU, 6));
file_form!(seconds: f64 => f64, |s| s, |s| rounded(*s, 6));
file_form!(counts: f64 => f64, |counts| counts, |counts| rounded(*counts, 6));
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
file_form!(axes_hz: PerAxis => [f64; 3], |hz| hz.values().map(|hz| TAU * hz), |radps| per_axis(radps.map(|w| w / TAU)));
file_form!(axes: PerAxis => [f64; 3], |axes| axes.values(), |values| per_axis(*values));
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

impl PerAxis {
    fn values(&self) -> [f64; 3] {
        [self.x, self.y, self.spin]
    }
}
