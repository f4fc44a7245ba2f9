//! Probe: a small pulse that moves no part and tests every coil and accelerometer.

use nalgebra::{Complex, Vector3};

use super::drive::shaped_drive;
use super::{CoilResponse, Library, motor_harmonics};
use upm_core::geometry::{Twist, Vec2};
use upm_core::phasor::polar;
use upm_core::signal::{Drive, Envelope, MOTORS};

/// Force phasors of x, y and spin. The spin is a quarter period ahead, so that all coils play equal amplitudes.
const AXES: [Complex<f64>; 3] = [Complex::new(1.0, 0.0), Complex::new(1.0, 0.0), Complex::new(0.0, 2.0)];
/// Largest acceleration of a corner, m/s².
const CORNER_MPS2: f64 = 16.0;
/// Largest fraction of the strongest drive in the library.
const MOST_DRIVE: f64 = 0.5;
/// Least sustain, in base periods and in s.
const PERIODS: f64 = 3.2;
const LEAST_SUSTAIN_S: f64 = 0.1;
/// Instants per period at which the corners' acceleration is sampled.
const INSTANTS: usize = 24;

impl Library {
    /// A pulse of one harmonic along x, y and spin at once that loads all coils equally, and the plate's response to
    /// each coil. With a single harmonic the plate's velocity repeats with the opposite sign after half a period, and
    /// so does friction (equation sheet, section 5): the mean displacement of a part is zero, also when a coil is dead,
    /// reversed or exchanged. `None` where the library does not determine the response to every coil.
    pub fn probe(&self) -> Option<(Drive, CoilResponse)> {
        let (coils, base_radps, attack_s, rest_s, limit_counts) = match &self.fields {
            Some(fields) => {
                (self.field_coils()?, fields.base_radps, fields.attack_s, fields.rest_s, fields.limit_counts)
            }
            None => {
                let strongest = self.entries.iter().flat_map(|entry| entry.amplitudes).map(i32::abs).max()?;
                (self.rotation_coils()?, self.base_radps, self.attack_s, self.rest_s, f64::from(strongest))
            }
        };
        let unit = self.motor_arrangement.turned(motor_harmonics(&Vector3::from(AXES)));
        let largest = unit.iter().map(|harmonic| libm::hypot(harmonic.cos, harmonic.sin)).fold(0.0, f64::max);
        let corner_mps2 = self.corner_mps2(&coils, base_radps, &unit.map(|harmonic| harmonic.phasor()))?;
        let counts = (CORNER_MPS2 / corner_mps2).min(MOST_DRIVE * limit_counts / largest);
        let force = Vector3::from(AXES) * Complex::from(counts);
        let sustain_s = LEAST_SUSTAIN_S.max(PERIODS * std::f64::consts::TAU / base_radps);
        let envelope = Envelope { attack_s, sustain_s, rest_s };
        let plate = self.plate.unwrap_or_default();
        let drive =
            shaped_drive(self.motor_arrangement, [(force, plate.flanks(&force, base_radps))], base_radps, envelope);
        Some((drive, coils))
    }

    /// Largest acceleration of a corner of the plate under phasors of one harmonic on each coil, m/s².
    fn corner_mps2(&self, coils: &CoilResponse, base_radps: f64, counts: &[Complex<f64>; MOTORS]) -> Option<f64> {
        let mut sum = Vector3::<Complex<f64>>::zeros();
        for (coil, counts) in coils.iter().zip(counts) {
            sum += coil.first()?.phasor() * *counts;
        }
        let half_m = 0.5 * self.plate_side_m;
        let corners = [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)].map(|(x, y)| Vec2::new(x, y) * half_m);
        let instants = (0..INSTANTS).map(|i| polar(1.0, std::f64::consts::TAU * i as f64 / INSTANTS as f64));
        let fastest_mps = instants.fold(0.0, |fastest: f64, turn| {
            let twist = Twist::from_vector(sum.map(|phasor| (phasor * turn).re));
            corners.iter().map(|&corner| twist.velocity_at(corner).norm()).fold(fastest, f64::max)
        });
        (fastest_mps > 0.0).then_some(fastest_mps * base_radps)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    /// The shipped libraries, one with fields and one without.
    fn shipped() -> [Library; 2] {
        ["upm-1", "upm-2"].map(|rig| {
            let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/libraries");
            let text = std::fs::read_to_string(folder.join(format!("{rig}.json"))).unwrap();
            Library::from_json(&text, rig).unwrap()
        })
    }

    #[test]
    fn probe_loads_all_coils_alike_and_stays_within_half_the_drive() {
        for library in shipped() {
            let (drive, _) = library.probe().unwrap();
            let loads = drive.motors.each_ref().map(|motor| motor[0].cos.hypot(motor[0].sin));
            assert!(loads.iter().all(|load| (load - loads[0]).abs() < 1e-9 && *load > 10.0), "{loads:?}");
            assert!(loads[0] <= MOST_DRIVE * 2048.0 && drive.motors.iter().all(|motor| motor.len() == 1));
            assert!(drive.envelope.sustain_s * drive.base_radps >= PERIODS * std::f64::consts::TAU - 1e-9);
        }
    }
}
