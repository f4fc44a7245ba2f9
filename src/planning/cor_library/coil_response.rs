//! Response of the plate to each voice coil separately, for both kinds of pulse.

use nalgebra::{Complex, Matrix3, Vector3};

use super::{Entry, Library};
use upm_core::signal::{MOTORS, TwistHarmonic};

/// Velocity phasors of the pump wave `cos wt' - ½ cos 2wt'`, `wt' = wt - π/2`, which the waveforms of x, y and spin
/// produce: that of a free mass under `cos wt - sin 2wt` (Eq. 5 and 8).
const PUMP_PHASORS: [Complex<f64>; 2] = [Complex::new(0.0, -1.0), Complex::new(0.5, 0.0)];

/// Axis amplitudes fx, fy and s of one count of the motors X1, X2, Y1, Y2 around the plate (Eq. 7).
const AXES_FROM_MOTOR: [Vector3<f64>; MOTORS] = [
    Vector3::new(1.0, 0.0, -1.0),
    Vector3::new(-1.0, 0.0, -1.0),
    Vector3::new(0.0, 1.0, 1.0),
    Vector3::new(0.0, -1.0, 1.0),
];

/// For each voice coil and harmonic k, at index `k - 1`: the plate's steady velocity under one count of `cos kwt` on
/// that coil alone, times from the start of the pulse.
pub type CoilResponse = [Vec<TwistHarmonic>; MOTORS];

impl Library {
    /// Response of the plate to each coil in a synthesised motion; `None` where the rig has no synthesised motions.
    pub fn field_coils(&self) -> Option<CoilResponse> {
        self.fields.as_ref().map(|fields| self.coil_response(&fields.twist_from_counts))
    }

    /// The same in a segment of a motion without pauses.
    pub fn segment_coils(&self) -> Option<CoilResponse> {
        self.segment_response().map(|fields| self.coil_response(&fields.twist_from_counts))
    }

    /// Response of the plate to each coil in a rotation, by least squares over the entries' pumps and with the axes'
    /// waveforms removed; `None` where the entries do not move every axis.
    pub fn rotation_coils(&self) -> Option<CoilResponse> {
        let (mut normal, mut projected) = (Matrix3::zeros(), Matrix3::zeros());
        for entry in &self.entries {
            let axes = self.axis_counts(entry);
            normal += axes * axes.transpose();
            projected += entry.pump.vector() * axes.transpose();
        }
        let pump_from_counts = projected * normal.cholesky()?.inverse();
        let response = |k: usize| {
            Matrix3::from_fn(|row, axis| {
                PUMP_PHASORS[k] * pump_from_counts[(row, axis)] / self.shapes[axis].0[k].phasor()
            })
        };
        Some(self.coil_response(&[response(0), response(1)]))
    }

    /// Axis amplitudes fx, fy and s of an entry, counts.
    pub(crate) fn axis_counts(&self, entry: &Entry) -> Vector3<f64> {
        let counts = self.motor_arrangement.turned(entry.amplitudes);
        AXES_FROM_MOTOR.iter().zip(counts).map(|(axes, counts)| axes * f64::from(counts)).sum()
    }

    fn coil_response(&self, twist_from_counts: &[Matrix3<Complex<f64>>]) -> CoilResponse {
        self.motor_arrangement.turned(AXES_FROM_MOTOR).map(|axes| {
            let counts = axes.map(Complex::from);
            twist_from_counts.iter().map(|response| TwistHarmonic::from_phasor(&(response * counts))).collect()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cor_library::{AxisShape, FieldResponse, PlateResponse, drive_for, testing};
    use proptest::prelude::*;
    use upm_core::geometry::Twist;
    use upm_core::signal::MotorArrangement::Around;
    use upm_core::signal::{Drive, Envelope, Follows, Harmonic, TwistWave};

    const BASE_RADPS: f64 = 377.0;
    const ENVELOPE: Envelope = Envelope { attack_s: 0.03, sustain_s: 0.1, rest_s: 0.04 };

    /// Entries of a plate whose pump is `twist_from_counts` times the axis amplitudes.
    fn library(twist_from_counts: &Matrix3<f64>, shapes: [AxisShape; 3], amplitudes: &[[i32; 4]]) -> Library {
        let entry = |amplitudes: &[i32; 4]| {
            let [x1, x2, y1, y2] = amplitudes.map(f64::from);
            let pump = twist_from_counts * Vector3::new(x1 - x2, y1 - y2, (y1 + y2) - (x1 + x2));
            Entry { amplitudes: *amplitudes, pump: Twist::new(pump.x, pump.y, pump.z) }
        };
        let response = |k: f64| twist_from_counts.map(|gain| Complex::new(0.3, -1.0) * (gain / k));
        Library {
            motor_arrangement: Around,
            plate_side_m: 0.3,
            base_radps: BASE_RADPS,
            attack_s: 0.03,
            rest_s: 0.04,
            shapes,
            entries: amplitudes.iter().map(entry).collect(),
            fields: Some(FieldResponse {
                base_radps: BASE_RADPS,
                attack_s: 0.03,
                rest_s: 0.04,
                limit_counts: 2047.0,
                twist_from_counts: [1.0, 2.0, 3.0].map(response).to_vec(),
            }),
            ..testing::library([])
        }
    }

    /// The velocity at `t_s` and full height under all coils of `drive` together.
    fn together(drive: &Drive, coils: &CoilResponse, t_s: f64) -> Twist {
        let coils = coils.iter().zip(&drive.motors).flat_map(|(coil, counts)| (1..).zip(coil).zip(counts));
        coils.fold(Twist::ZERO, |sum, ((k, answer), counts)| {
            let (sin, cos) = (f64::from(k) * BASE_RADPS * t_s).sin_cos();
            let of_cos = answer.cos * cos + answer.sin * sin;
            let of_sin = answer.cos * sin - answer.sin * cos;
            sum + of_cos * counts.cos + of_sin * counts.sin
        })
    }

    fn gap(a: Twist, b: Twist) -> f64 {
        (a.velocity_mps - b.velocity_mps).norm() + (a.spin_radps - b.spin_radps).abs()
    }

    fn shape(c1: f64, s1: f64, c2: f64, s2: f64) -> AxisShape {
        AxisShape([Harmonic { cos: c1, sin: s1 }, Harmonic { cos: c2, sin: s2 }])
    }

    const AMPLITUDES: [[i32; 4]; 5] =
        [[264, -264, 10, -10], [-100, 90, 200, -180], [-60, -60, 60, 60], [0, 0, 100, -100], [-240, 60, 230, -70]];

    proptest! {
        #[test]
        fn coils_of_a_field_add_up_to_its_wave(
            parts in proptest::array::uniform6(-0.5..0.5f64), cross in -0.2..0.2f64, t_s in 0.0..0.1f64,
        ) {
            let plate = Matrix3::new(1e-3, cross * 1e-3, 0.0, 0.0, 1.1e-3, 0.0, cross * 1e-3, 0.0, 6e-3);
            let library = library(&plate, [AxisShape::FREE_MASS; 3], &AMPLITUDES);
            let [a, b, c, d, e, f] = parts;
            let harmonic = TwistHarmonic { cos: Twist::new(a, b, c), sin: Twist::new(d, e, f) };
            let wave = TwistWave { base_radps: BASE_RADPS, harmonics: vec![harmonic; 3] };
            let drive = library.field_drive(&wave, Follows::Velocity, 0.1).unwrap();
            prop_assert!(gap(together(&drive, &library.field_coils().unwrap(), t_s), wave.at(t_s)) < 1e-9);
        }

        #[test]
        fn coils_of_a_rotation_add_up_to_the_pump_of_its_entry(entry in 0..AMPLITUDES.len(), t_s in 0.0..0.1f64) {
            let plate = Matrix3::new(1e-3, 1e-5, 0.0, -2e-5, 1.1e-3, 0.0, 3e-5, 0.0, 6e-3);
            // all axes equally late: only then is the sum of the three a pump wave for any crosstalk
            let shapes = [shape(0.98, -0.05, -0.19, -0.97); 3];
            let library = library(&plate, shapes, &AMPLITUDES);
            let drive = drive_for(Around, AMPLITUDES[entry], &shapes, &PlateResponse::default(), BASE_RADPS, ENVELOPE);
            // the squeeze that the drive leaves out moves nothing
            let found = together(&drive, &library.rotation_coils().unwrap(), t_s);
            let quarter_s = std::f64::consts::FRAC_PI_2 / BASE_RADPS;
            let wanted = TwistWave::pump(library.entries[entry].pump, BASE_RADPS).at(t_s - quarter_s);
            prop_assert!(gap(found, wanted) < 1e-9, "{found:?} {wanted:?}");
        }
    }
}
