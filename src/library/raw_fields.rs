use std::f64::consts::TAU;

use nalgebra::{Complex, Matrix3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::FieldResponse;
use super::raw::{BASE_HZ, MOST_TIME_S, rounded};
use upm_core::units::{m_from_mm, mm_from_m};

/// Counts that a waveform generator may have.
pub(super) const LIMIT_COUNTS: (f64, f64) = (1.0, 1e6);
/// Largest speed (mm/s) or spin (rad/s) of one count.
pub(super) const MOST_RESPONSE: f64 = 1e5;

/// Complex numbers `[re, im]`, row by row.
pub(super) type RawMatrix = [[[f64; 2]; 3]; 3];

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
    /// The same in SI, nothing checked.
    pub(super) fn response(&self) -> FieldResponse {
        FieldResponse {
            base_radps: TAU * self.base_hz,
            attack_s: self.attack_s,
            rest_s: self.rest_s,
            limit_counts: self.limit_counts,
            twist_from_counts: self.twist_from_counts.iter().map(matrix).collect(),
        }
    }
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
