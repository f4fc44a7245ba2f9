use nalgebra::{Complex, Matrix3, Vector3};

use super::{FieldResponse, Library};
use upm_core::signal::{Drive, Envelope, Harmonic, MOTORS, Shaping, TwistHarmonic, TwistWave};

/// Relative difference between two base frequencies that are the same.
const SAME: f64 = 1e-6;

impl Library {
    /// The drive that moves the plate by `wave` at full height, held for `sustain_s`: velocity `env(t) · wave(t)`, times
    /// from the start of the pulse. `None` without a field response, with more harmonics than were measured or another
    /// base frequency. Whether the motors can play it is told by [`Drive::peak_counts`].
    pub fn field_drive(&self, wave: &TwistWave, sustain_s: f64) -> Option<Drive> {
        let fields = self.fields.as_ref()?;
        let FieldResponse { base_radps, attack_s, rest_s, .. } = *fields;
        let measured = wave.harmonics.len() <= fields.twist_from_counts.len();
        if !measured || (wave.base_radps - base_radps).abs() > SAME * base_radps {
            return None;
        }
        let mut motors: [Vec<Harmonic>; MOTORS] = Default::default();
        for (harmonic, twist_from_counts) in wave.harmonics.iter().zip(&fields.twist_from_counts) {
            let counts = axis_counts(twist_from_counts, harmonic)?;
            for (motor, harmonic) in motors.iter_mut().zip(motor_harmonics(&counts)) {
                motor.push(harmonic);
            }
        }
        let envelope = Envelope { attack_s, sustain_s, rest_s };
        Some(Drive { base_radps, motors, shaping: Shaping::Velocity, envelope })
    }
}

/// Phasors of the axis amplitudes fx, fy and s, counts, whose answer is `velocity`; `None` for a singular response.
fn axis_counts(twist_from_counts: &Matrix3<Complex<f64>>, velocity: &TwistHarmonic) -> Option<Vector3<Complex<f64>>> {
    twist_from_counts.lu().solve(&velocity.phasor())
}

/// What the motors X1, X2, Y1, Y2 play of these axis amplitudes, opposite ones sharing the work (Eq. 7).
pub fn motor_harmonics(axis_counts: &Vector3<Complex<f64>>) -> [Harmonic; MOTORS] {
    let (x, y, turn) = (axis_counts.x * 0.5, axis_counts.y * 0.5, axis_counts.z * 0.25);
    [x - turn, -x - turn, y + turn, -y + turn].map(Harmonic::from_phasor)
}
