use std::borrow::Cow;

use nalgebra::{Complex, Vector3};

use super::{AxisShape, FieldResponse, Library, PlateResponse};
use upm_core::phasor::argument;
use upm_core::signal::{Drive, Envelope, Follows, Harmonic, MOTORS, MotorArrangement, Shaping, TwistWave};

/// Relative difference below which two base frequencies are equal.
const SAME: f64 = 1e-6;

/// The drive that plays the amplitudes X1, X2, Y1, Y2 (counts) of motors that stand as `arrangement` says with the
/// waveforms of x, y and spin, such that the displacement of a plate with the response `plate` follows the envelope
/// ([`Shaping::Displacement`]).
///
/// The four amplitudes are three axis amplitudes, of motors around the plate `f_x = X1 - X2`, `f_y = Y1 - Y2` and
/// `S = (Y1 + Y2) - (X1 + X2)` (torque over lever arm, Eq. 7), and a fourth combination `X1 + X2 + Y1 + Y2` that only
/// squeezes the plate and makes no net force or torque. Each axis plays its own waveform; the squeeze is dropped, so
/// that no motor spends counts on it.
pub fn drive_for(
    arrangement: MotorArrangement,
    amplitudes: [i32; 4],
    shapes: &[AxisShape; 3],
    plate: &PlateResponse,
    base_radps: f64,
    envelope: Envelope,
) -> Drive {
    let [x1, x2, y1, y2] = arrangement.turned(amplitudes).map(f64::from);
    let axes = [x1 - x2, y1 - y2, (y1 + y2) - (x1 + x2)];
    let force = |k: usize| Vector3::from_fn(|axis, _| shapes[axis].0[k].phasor() * axes[axis]);
    let part = |force: Vector3<Complex<f64>>, k: f64| (force, plate.flanks(&force, k * base_radps));
    let parts = [part(force(0), 1.0), part(force(1), 2.0)];
    shaped_drive(arrangement, parts, base_radps, envelope)
}

/// The drive of the axis amplitudes of each harmonic, from the first up: the steady forces (counts), and those on the
/// envelope's slope (counts·s) and curvature (counts·s²).
pub(crate) fn shaped_drive(
    arrangement: MotorArrangement,
    parts: impl IntoIterator<Item = (Vector3<Complex<f64>>, [Vector3<Complex<f64>>; 2])>,
    base_radps: f64,
    envelope: Envelope,
) -> Drive {
    let mut drive = Drive { base_radps, envelope, ..Drive::default() };
    let mut flanks: [[Vec<Harmonic>; 2]; MOTORS] = Default::default();
    for (force, [slope, curvature]) in parts {
        let [force, slope, curvature] =
            [force, slope, curvature].map(|counts| arrangement.turned(motor_harmonics(&counts)));
        for motor in 0..MOTORS {
            drive.motors[motor].push(force[motor]);
            flanks[motor][0].push(slope[motor]);
            flanks[motor][1].push(curvature[motor]);
        }
    }
    drive.shaping = Shaping::Displacement(flanks);
    drive
}

impl PlateResponse {
    /// With Z(s) = s² + 2ζω₀s + ω₀² of `axis` at `s = j rate`: Z'(s)/Z(s) and 1/Z(s). Multiplied by the phasor of a
    /// steady force they are the factors of the envelope's slope and curvature.
    pub(crate) fn flank_factors(&self, axis: usize, rate_radps: f64) -> [Complex<f64>; 2] {
        let (natural_radps, ratio) = (self.natural_radps[axis], self.damping_ratio[axis]);
        let s = Complex::new(0.0, rate_radps);
        let damping = 2.0 * ratio * natural_radps;
        let inverse = (s * s + s * damping + natural_radps * natural_radps).inv();
        [(s * 2.0 + damping) * inverse, inverse]
    }

    /// The forces on the envelope's slope (counts·s) and curvature (counts·s²) of x, y and spin beside the steady
    /// `force` (counts) at `rate_radps`; see [`Shaping::Displacement`].
    pub fn flanks(&self, force: &Vector3<Complex<f64>>, rate_radps: f64) -> [Vector3<Complex<f64>>; 2] {
        [0, 1].map(|i| Vector3::from_fn(|axis, _| force[axis] * self.flank_factors(axis, rate_radps)[i]))
    }
}

impl Library {
    /// The drive of entry number `entry` at full strength held for `sustain_s`; `None` when there is no such entry.
    /// [`Drive::reversed`] reverses the flow of parts, [`Drive::scaled`] weakens it.
    pub fn drive(&self, entry: usize, sustain_s: f64) -> Option<Drive> {
        self.drive_with_rest(entry, sustain_s, self.rest_after(sustain_s))
    }

    /// [`Library::drive`] with a rest of `rest_s`, s.
    pub fn drive_with_rest(&self, entry: usize, sustain_s: f64, rest_s: f64) -> Option<Drive> {
        let entry = self.entries.get(entry)?;
        let envelope = Envelope { attack_s: self.attack_s, sustain_s, rest_s };
        let plate = self.plate.unwrap_or_default();
        Some(drive_for(self.motor_arrangement, entry.amplitudes, &self.shapes, &plate, self.base_radps, envelope))
    }

    /// The drive that moves the plate by `wave` at full height, held for `sustain_s`: with the velocity
    /// `env(t) · wave(t)` or the displacement `env(t) · ∫ wave`, times from the start of the pulse. Waves of half the
    /// fields' base frequency are segments ([`Self::segment_response`]). `None` without a field response, with more
    /// harmonics than it has or another base frequency. [`Drive::peak_counts`]
    /// determines whether the motors can play it.
    pub fn field_drive(&self, wave: &TwistWave, follows: Follows, sustain_s: f64) -> Option<Drive> {
        let is_same = |base_radps: f64| (wave.base_radps - base_radps).abs() <= SAME * base_radps;
        let pulses = self.fields.as_ref().filter(|fields| is_same(fields.base_radps)).map(Cow::Borrowed);
        let segments = || self.segment_response().filter(|fields| is_same(fields.base_radps)).map(Cow::Owned);
        let fields = pulses.or_else(segments).filter(|f| wave.harmonics.len() <= f.twist_from_counts.len())?;
        let FieldResponse { base_radps, attack_s, rest_s, .. } = *fields;
        let harmonics = wave.harmonics.iter().zip(&fields.twist_from_counts);
        // phasors of the axis amplitudes, counts; none for a singular response
        let forces = harmonics.map(|(harmonic, twist_from_counts)| twist_from_counts.lu().solve(&harmonic.phasor()));
        let forces: Vec<_> = forces.collect::<Option<_>>()?;
        let (plate, envelope) = (self.plate.unwrap_or_default(), Envelope { attack_s, sustain_s, rest_s });
        let parts = (1..).zip(forces).map(|(k, force)| (force, plate.flanks(&force, f64::from(k) * base_radps)));
        let drive = shaped_drive(self.motor_arrangement, parts, base_radps, envelope);
        Some(if follows == Follows::Velocity { Drive { shaping: Shaping::Velocity, ..drive } } else { drive })
    }

    /// Delay of a pulse's envelope on the plate against its wave, s: the delay of the motors. The waveforms of x, y and
    /// spin compensate it in the phases of both harmonics, but not in the envelope. Derived from the second harmonic,
    /// where the plate is closest to a free mass.
    pub fn envelope_delay_s(&self) -> f64 {
        let rate_radps = 2.0 * self.base_radps;
        let lead_rad = |axis: usize| {
            // force over that of a free mass, -sin 2wt, and the plate's own contribution to it
            let force = self.shapes[axis].0[1].phasor() / Complex::i();
            let plate = self.plate.unwrap_or_default().flank_factors(axis, rate_radps)[1].inv();
            argument(force / (plate * -(rate_radps * rate_radps).recip()))
        };
        let mean_rad = (lead_rad(0) + lead_rad(1) + lead_rad(2)) / 3.0;
        (mean_rad / rate_radps).clamp(0.0, 0.25 * self.attack_s)
    }

    /// Rest after a pulse held for `sustain_s`, s. The longer the pulse, the faster the parts and the longer they
    /// coast: it rises linearly from half of [`Self::rest_s`] after the shortest pulse to all of it after the longest
    /// measured one.
    pub fn rest_after(&self, sustain_s: f64) -> f64 {
        let longest_s = self.displacement.sustain_s.last().copied().unwrap_or(0.0);
        let part = if longest_s > 0.0 { (sustain_s / longest_s).clamp(0.0, 1.0) } else { 1.0 };
        self.rest_s * (0.5 + 0.5 * part)
    }
}

/// Amplitudes X1, X2, Y1, Y2 of motors around the plate for these axis amplitudes; the two motors of an axis share the
/// force equally (Eq. 7).
pub fn motor_harmonics(axis_counts: &Vector3<Complex<f64>>) -> [Harmonic; MOTORS] {
    let (x, y, turn) = (axis_counts.x * 0.5, axis_counts.y * 0.5, axis_counts.z * 0.25);
    [x - turn, -x - turn, y + turn, -y + turn].map(Harmonic::from_phasor)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cor_library::testing;
    use proptest::prelude::*;
    use upm_core::geometry::Twist;
    use upm_core::signal::MotorArrangement::Around;

    const FREE: PlateResponse = PlateResponse { natural_radps: [0.0; 3], damping_ratio: [0.0; 3] };
    const ENVELOPE: Envelope = Envelope { attack_s: 0.0, sustain_s: 1.0, rest_s: 0.0 };

    /// Forces along x, y and torque over lever arm at `t`, from the four motors by Eq. 7.
    fn wrench(drive: &Drive, t_s: f64) -> [f64; 3] {
        let [x1, x2, y1, y2] = drive.counts_at(t_s);
        [x1 - x2, y1 - y2, (y1 + y2) - (x1 + x2)]
    }

    fn shape(c1: f64, s1: f64, c2: f64, s2: f64) -> AxisShape {
        AxisShape([Harmonic { cos: c1, sin: s1 }, Harmonic { cos: c2, sin: s2 }])
    }

    #[test]
    fn longer_pulses_rest_longer() {
        let belt = testing::library([Twist::new(0.5, 0.0, 0.0)]);
        let mut library = Library { base_radps: 377.0, attack_s: 0.03, rest_s: 0.04, ..belt };
        assert_eq!(library.rest_after(0.01), 0.04, "nothing measured yet");
        library.displacement.sustain_s = vec![0.0, 0.1, 0.2];
        for (sustain_s, rest_s) in [(0.0, 0.02), (0.05, 0.025), (0.2, 0.04), (0.3, 0.04)] {
            assert!((library.rest_after(sustain_s) - rest_s).abs() < 1e-12);
            assert_eq!(library.drive(0, sustain_s).unwrap().envelope.rest_s, library.rest_after(sustain_s));
        }
    }

    proptest! {
        #[test]
        fn each_axis_plays_its_own_waveform(amplitudes: [i16; 4], t_s in 0.001..0.9f64, tilt in -0.3..0.3f64) {
            let amplitudes = amplitudes.map(i32::from);
            let shapes = [shape(1.0, tilt, 0.1, -1.1), shape(0.9, 0.0, tilt, -1.0), shape(1.2, -tilt, 0.0, -0.8)];
            let drive = drive_for(Around, amplitudes, &shapes, &FREE, 377.0, ENVELOPE);
            let [x1, x2, y1, y2] = amplitudes.map(f64::from);
            let axes = [x1 - x2, y1 - y2, (y1 + y2) - (x1 + x2)];
            for ((got, axis), shape) in wrench(&drive, t_s).iter().zip(axes).zip(shapes) {
                let wave = |k: usize| {
                    let (sin, cos) = ((k + 1) as f64 * 377.0 * t_s).sin_cos();
                    shape.0[k].cos * cos + shape.0[k].sin * sin
                };
                prop_assert!((got - axis * (wave(0) + wave(1))).abs() < 1e-6);
            }
            let squeeze: f64 = drive.counts_at(t_s).iter().sum();
            prop_assert!(squeeze.abs() < 1e-6);
        }
    }
}
