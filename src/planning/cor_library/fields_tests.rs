use std::f64::consts::TAU;

use nalgebra::{Complex, Matrix3, Vector3};
use proptest::prelude::*;

use super::{DisplacementModel, FieldResponse, Library, testing};
use upm_core::geometry::{Lens, Twist, Vec2};
use upm_core::rig::{FieldDriveModel, RigModel};
use upm_core::signal::{Drive, Follows, TwistHarmonic, TwistWave};

const BASE_RADPS: f64 = TAU * 30.0;

fn library(twist_from_counts: Vec<Matrix3<Complex<f64>>>) -> Library {
    let pumps = [Twist::new(0.5, 0.0, 0.0), Twist::new(0.0, 0.5, 0.0), Twist::new(0.1, 0.0, 8.0)];
    Library {
        plate_side_m: 0.3,
        displacement: DisplacementModel {
            speed_mps: vec![0.1, 0.5],
            sustain_s: vec![0.0, 0.1],
            distance_m: vec![vec![0.001, 0.004], vec![0.001, 0.006]],
            sd_m: vec![vec![0.0; 2]; 2],
        },
        fields: Some(FieldResponse {
            base_radps: BASE_RADPS,
            attack_s: 0.033_333,
            rest_s: 0.04,
            limit_counts: 2047.0,
            twist_from_counts,
        }),
        ..testing::library(pumps)
    }
}

/// Response of a free mass with a small delay and crosstalk: `1/(jkw)`, turned by `late_rad`, other axes mixed in by
/// `cross`.
fn response(k: usize, late_rad: f64, cross: [f64; 6]) -> Matrix3<Complex<f64>> {
    let [a, b, c, d, e, f] = cross;
    let mixed = Matrix3::new(1.0, a, b, c, 1.0, d, e, f, 1.0);
    let scale = Matrix3::from_diagonal(&Vector3::new(0.11, 0.11, 0.7));
    let turn = Complex::from_polar((k as f64 * BASE_RADPS).recip(), -TAU / 4.0 - late_rad * k as f64);
    (scale * mixed).map(|gain| turn * gain)
}

fn responses(late_rad: f64, cross: [f64; 6]) -> Vec<Matrix3<Complex<f64>>> {
    (1..=4).map(|k| response(k, late_rad, cross)).collect()
}

fn harmonic() -> impl Strategy<Value = TwistHarmonic> {
    let twist = || (-0.5..0.5f64, -0.5..0.5f64, -4.0..4.0f64).prop_map(|(x, y, spin)| Twist::new(x, y, spin));
    (twist(), twist()).prop_map(|(cos, sin)| TwistHarmonic { cos, sin })
}

/// The plate's velocity at `t_s` and full height: axis forces of Eq. 7, each harmonic multiplied by its response
/// matrix.
fn answer(drive: &Drive, responses: &[Matrix3<Complex<f64>>], t_s: f64) -> Vector3<f64> {
    let velocity = |(i, matrix): (usize, &Matrix3<Complex<f64>>)| {
        let part = |motor: usize| drive.motors[motor].get(i).copied().unwrap_or_default();
        let [x1, x2, y1, y2] = [0, 1, 2, 3].map(|motor| part(motor).phasor());
        let turning = Complex::from_polar(1.0, (i + 1) as f64 * drive.base_radps * t_s);
        (matrix * Vector3::new(x1 - x2, y1 - y2, (y1 + y2) - (x1 + x2)) * turning).map(|v| v.re)
    };
    responses.iter().enumerate().map(velocity).sum()
}

proptest! {
    #[test]
    fn the_drive_of_a_wave_moves_the_plate_by_it(
        harmonics in proptest::collection::vec(harmonic(), 0..=4), late_rad in -0.5..0.5f64,
        cross in proptest::array::uniform6(-0.1..0.1f64), t_s in 0.05..0.2f64,
    ) {
        let responses = responses(late_rad, cross);
        let library = library(responses.clone());
        let wave = TwistWave { base_radps: BASE_RADPS, harmonics };
        let drive = library.field_drive(&wave, Follows::Velocity, 0.2).unwrap();
        let (found, wanted) = (answer(&drive, &responses, t_s), wave.at(t_s));
        let wanted = wanted.vector();
        prop_assert!((found - wanted).norm() < 1e-9, "{found} {wanted}");
        let squeeze: f64 = drive.counts_at(t_s).iter().sum();
        prop_assert!(squeeze.abs() < 1e-6, "no motor works against the others");
        let envelope = drive.envelope;
        prop_assert_eq!([envelope.attack_s, envelope.sustain_s, envelope.rest_s], [0.033_333, 0.2, 0.04]);
    }

    #[test]
    fn a_response_comes_back_from_its_file(late_rad in -0.5..0.5f64, cross in proptest::array::uniform6(-0.1..0.1f64)) {
        let saved = library(responses(late_rad, cross));
        let text = saved.to_json();
        let read = Library::from_json(&text, "l.json").unwrap();
        prop_assert_eq!(read.to_json(), text, "reading and writing again changes no byte");
        let [saved, read] = [saved, read].map(|library| library.fields.unwrap());
        prop_assert_eq!(saved.limit_counts, read.limit_counts);
        prop_assert!((saved.base_radps - read.base_radps).abs() < 1e-5);
        prop_assert_eq!(saved.twist_from_counts.len(), read.twist_from_counts.len());
        for (a, b) in saved.twist_from_counts.iter().zip(&read.twist_from_counts) {
            prop_assert!((a - b).iter().all(|off| off.norm() < 1e-9));
        }
    }
}

#[test]
fn values_no_rig_has_are_reported() {
    let fault_lines = |change: &dyn Fn(&mut FieldResponse)| -> Vec<String> {
        let mut bad = library(responses(0.1, [0.0; 6]));
        bad.fields.as_mut().into_iter().for_each(change);
        Library::from_json(&bad.to_json(), "l").unwrap_err().iter().map(ToString::to_string).collect()
    };
    let faint = fault_lines(&|f| f.limit_counts = 0.0);
    assert_eq!(faint, ["l: fields.limit_counts: expected a number from 1 to 1000000, found 0"]);
    let singular = fault_lines(&|f| f.twist_from_counts[2].fill_column(1, Complex::new(0.0, 0.0)));
    let allowed = "forces on x, y and spin that move the plate independently";
    assert_eq!(singular, [format!("l: fields.twist_from_counts[2]: expected {allowed}, found a singular matrix")]);
}

/// A rig with the drive of `library`.
pub(super) fn rig_of(library: &Library, count_limit: f64, fields: Option<FieldDriveModel>) -> RigModel {
    RigModel {
        name: library.rig.clone(),
        plate_side_m: library.plate_side_m,
        lever_arm_m: 0.1,
        motor_arrangement: library.motor_arrangement,
        plate_mass_kg: 1.0,
        plate_inertia_kgm2: 0.01,
        newtons_per_count: 0.1,
        count_limit,
        base_radps: library.base_radps,
        attack_s: library.attack_s,
        rest_s: library.rest_s,
        max_sustain_s: 0.3,
        fields,
        accelerometer_in_plate_m: Vec2::zeros(),
        frame_size_px: [1280, 1024],
        frame_hz: 60.0,
        exposure_s: 0.002,
        lens: Lens::ideal(1000.0, Vec2::zeros()),
        dark_parts: false,
    }
}

#[test]
fn fields_of_another_rig_are_refused() {
    let library = library(responses(0.1, [0.0; 6]));
    let fields = FieldDriveModel { base_radps: BASE_RADPS, harmonics: 4, attack_s: 0.033_333, rest_s: 0.04 };
    let rig = rig_of(&library, 2047.0, Some(fields));
    let fault_lines = |library: &Library, rig: &RigModel| -> Vec<String> {
        library.check_fits(rig, "12ab").iter().map(|fault| format!("{}: {}", fault.path, fault.expected)).collect()
    };
    assert_eq!(fault_lines(&library, &rig), [""; 0]);
    let with = |fields: FieldDriveModel| fault_lines(&library, &RigModel { fields: Some(fields), ..rig.clone() });
    assert_eq!(with(FieldDriveModel { base_radps: TAU * 40.0, ..fields }), ["fields.base_hz: 40, as the rig has it"]);
    assert_eq!(with(FieldDriveModel { attack_s: 0.05, ..fields }), ["fields.attack_s: 0.05, as the rig has it"]);
    assert_eq!(with(FieldDriveModel { rest_s: 0.05, ..fields }), ["fields.rest_s: 0.05, as the rig has it"]);
    assert_eq!(with(FieldDriveModel { harmonics: 8, ..fields }), ["fields.twist_from_counts: 8, as the rig has it"]);
    let strong = RigModel { count_limit: 4095.0, ..rig.clone() };
    assert_eq!(fault_lines(&library, &strong), ["fields.limit_counts: 4095, as the rig has it"]);
    let none = RigModel { fields: None, ..rig.clone() };
    assert_eq!(fault_lines(&library, &none), ["fields: nothing (the rig has no fields: run `upm calibrate`)"]);
    let bare = Library { fields: None, ..library.clone() };
    assert_eq!(fault_lines(&bare, &rig), ["fields: the response to the rig's fields (run `upm calibrate`)"]);
    assert_eq!(fault_lines(&bare, &none), [""; 0]);
}
