use nalgebra::{Complex, Vector3};

use super::Library;
use crate::geometry::Twist;
use crate::signal::{Drive, Envelope, Harmonic, MOTORS, TwistWave};

/// Base frequencies that differ by less than this part are one.
const SAME_BASE: f64 = 1e-9;

impl Library {
    /// The drive that moves the plate by `wave` at full height, held for `sustain_s`; `None` without a field response or
    /// with more harmonics than were measured, or another base frequency.
    pub fn field_drive(&self, wave: &TwistWave, sustain_s: f64) -> Option<Drive> {
        let fields = self.fields.as_ref()?;
        let same_base = (wave.base_radps - fields.base_radps).abs() <= SAME_BASE * fields.base_radps;
        if !same_base || wave.harmonics.len() > fields.twist_from_counts.len() {
            return None;
        }
        let mut motors: [Vec<Harmonic>; MOTORS] = Default::default();
        for (harmonic, response) in wave.harmonics.iter().zip(&fields.twist_from_counts) {
            let counts = response.lu().solve(&phasors(harmonic.cos, harmonic.sin))?;
            let [side_x, side_y, turn] = [0.5 * counts.x, 0.5 * counts.y, 0.25 * counts.z];
            let parts = [side_x - turn, -side_x - turn, side_y + turn, -side_y + turn];
            for (motor, part) in motors.iter_mut().zip(parts) {
                motor.push(Harmonic { cos: part.re, sin: -part.im });
            }
        }
        let envelope = Envelope { attack_s: fields.attack_s, sustain_s, rest_s: fields.rest_s };
        Some(Drive { base_radps: fields.base_radps, motors, envelope })
    }
}

/// `cos` and `sin` of a harmonic as phasors of x, y and spin.
fn phasors(cos: Twist, sin: Twist) -> Vector3<Complex<f64>> {
    Vector3::new(
        Complex::new(cos.velocity_mps.x, -sin.velocity_mps.x),
        Complex::new(cos.velocity_mps.y, -sin.velocity_mps.y),
        Complex::new(cos.spin_radps, -sin.spin_radps),
    )
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;
    use proptest::prelude::*;

    use super::*;
    use crate::library::{AxisShape, DisplacementModel, FieldResponse};
    use crate::signal::TwistHarmonic;

    const BASE_RADPS: f64 = 200.0;
    const MASS_KG: f64 = 0.7;

    /// A free mass: every axis integrates its force.
    fn library() -> Library {
        let integral = |k: f64| Complex::new(0.0, -1.0 / (MASS_KG * k * BASE_RADPS));
        let response = |k: usize| Matrix3::from_diagonal_element(integral(k as f64));
        Library {
            rig: String::new(),
            fingerprint: String::new(),
            plate_side_m: 0.2,
            base_radps: 377.0,
            attack_s: 0.03,
            rest_s: 0.04,
            accelerometer_gain: [1.0; 4],
            shapes: [AxisShape::FREE_MASS; 3],
            entries: Vec::new(),
            displacement: DisplacementModel::default(),
            fields: Some(FieldResponse {
                base_radps: BASE_RADPS,
                attack_s: 0.0,
                rest_s: 0.05,
                limit_counts: 1000.0,
                twist_from_counts: (1..=3).map(response).collect(),
            }),
        }
    }

    proptest! {
        /// The force of a free mass is its mass times the slope of the wanted velocity.
        #[test]
        fn a_free_mass_is_driven_along_the_wave(
            c in proptest::collection::vec(proptest::array::uniform6(-1.0..1.0f64), 1..=3), t_s in 0.001..0.9f64,
        ) {
            let harmonic = |v: &[f64; 6]| TwistHarmonic { cos: Twist::new(v[0], v[1], v[2]), sin: Twist::new(v[3], v[4], v[5]) };
            let wave = TwistWave { base_radps: BASE_RADPS, harmonics: c.iter().map(harmonic).collect() };
            let drive = library().field_drive(&wave, 1.0).unwrap();
            let [x1, x2, y1, y2] = [0, 1, 2, 3].map(|motor| drive.counts_at(motor, t_s));
            let slope = (wave.at(t_s + 1e-6) - wave.at(t_s - 1e-6)) * (MASS_KG / 2e-6);
            let wanted = [slope.velocity_mps.x, slope.velocity_mps.y, slope.spin_radps];
            for (got, wanted) in [x1 - x2, y1 - y2, (y1 + y2) - (x1 + x2)].into_iter().zip(wanted) {
                prop_assert!((got - wanted).abs() < 1e-3, "{got} {wanted}");
            }
            prop_assert!((x1 + x2 + y1 + y2).abs() < 1e-9, "no squeeze");
        }
    }

    #[test]
    fn what_was_not_measured_is_not_driven() {
        let wave = |harmonics: usize| TwistWave {
            base_radps: BASE_RADPS,
            harmonics: vec![TwistHarmonic { cos: Twist::new(1.0, 0.0, 0.0), sin: Twist::ZERO }; harmonics],
        };
        assert!(library().field_drive(&wave(3), 0.1).is_some());
        assert_eq!(library().field_drive(&wave(4), 0.1), None);
        assert_eq!(library().field_drive(&TwistWave { base_radps: 201.0, ..wave(1) }, 0.1), None);
        assert_eq!(Library { fields: None, ..library() }.field_drive(&wave(1), 0.1), None);
    }
}
