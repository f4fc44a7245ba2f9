use std::sync::atomic::AtomicBool;

use crate::config::RigSpec;
use upm_control::ExpectedPart;
use upm_control::calibration::{CalibrationError, CalibrationParams, CalibrationProgress, CalibrationSession};
use upm_core::geometry::{Pose, Vec2};
use upm_core::random::Streams;
use upm_core::units::mm_from_m;
use upm_planning::cor_library::Library;
use upm_sim::SimRig;

/// Positions of the calibration coins, in half sides of the plate: spread over radii and directions, and far enough
/// inside that the longest pulse leaves them on the plate.
const COINS: [[f64; 2]; 7] =
    [[0.05, 0.0], [-0.45, 0.1], [0.4, 0.4], [0.1, -0.5], [-0.3, -0.45], [-0.2, 0.55], [0.55, -0.2]];

/// Distance of the two nearest of them, in half sides: less than a diameter of a coin on a plate that is too small.
const NEAREST: f64 = 0.4;

/// Longest displacement that is measured, in half sides of the plate; no coin leaves the plate by it.
const LONGEST: f64 = 0.18;

/// Calibrates the simulated rig `rig` with pennies on it. `Err` if a check of the calibration fails or `stop` is set.
pub fn calibrate(
    rig: &RigSpec,
    seed: u64,
    params: &CalibrationParams,
    stop: &AtomicBool,
    progress: &mut dyn FnMut(CalibrationProgress),
) -> Result<Library, CalibrationError> {
    let mut simulated = simulated(rig, seed)?;
    CalibrationSession::new(&mut simulated, &rig.model, stop, progress).library(&rig.fingerprint, params)
}

/// The simulated rig with pennies on it.
fn simulated(rig: &RigSpec, seed: u64) -> Result<SimRig, CalibrationError> {
    let Some(penny) = rig.kinds.first() else {
        return Err(CalibrationError::Unseen("the rig file has no kinds of parts".into()));
    };
    let half_side_m = 0.5 * rig.model.plate_side_m;
    let least_m = 2.0 * penny.kind.radius_m / NEAREST;
    if half_side_m < least_m {
        let [found, least] = [half_side_m, least_m].map(|half_m| mm_from_m(2.0 * half_m));
        let reason =
            format!("plate.side_mm: expected {least:.0} or more (the coins of the calibration), found {found}");
        return Err(CalibrationError::Unseen(reason));
    }
    let coins = COINS.map(|[x, y]| (penny.part(), Pose::at(Vec2::new(x, y) * half_side_m)));
    Ok(SimRig::new(rig.model.clone(), rig.sim.clone(), coins.to_vec(), Streams::new(seed)))
}

/// Parameters of the full calibration of `rig`, with pennies on the plate.
pub fn calibration_params(rig: &RigSpec) -> CalibrationParams {
    let kinds = rig.kinds.first().map(|spec| spec.kind.clone()).into_iter().collect();
    let coin = |i: usize| ExpectedPart { id: format!("coin-{}", i + 1), kind: 0, expected_m: None };
    let coins = (0..COINS.len()).map(coin).collect();
    CalibrationParams { longest_m: LONGEST * 0.5 * rig.model.plate_side_m, ..CalibrationParams::full(kinds, coins) }
}

#[cfg(test)]
mod fault_tests;

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Complex, Vector3};
    use rand::RngExt;
    use std::f64::consts::TAU;
    use std::path::PathBuf;
    use upm_core::geometry::Twist;
    use upm_core::signal::{Drive, Follows, TwistHarmonic, TwistWave};
    use upm_sim::Plant;

    /// A small calibration of a shipped rig under a camera with a quarter of the pixels: nine centres on the plate, a
    /// ring of four, four translations.
    pub(super) fn small() -> (RigSpec, CalibrationParams) {
        let root = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
        let mut rig = RigSpec::load(&root.join("configs/rigs/upm-1.json")).unwrap();
        rig.sim.camera.focal_px *= 0.5;
        rig.sim.camera.principal_px = rig.sim.camera.principal_px.map(|px| px.map(|px| 0.5 * px));
        rig.sim.camera.size_px = [640, 512];
        (rig.model.lens, rig.model.frame_size_px) = (rig.sim.camera.lens(), rig.sim.camera.size_px);
        let params = CalibrationParams {
            grid: 3,
            rings: vec![2.0],
            ring_centers: 4,
            translations: 4,
            longest_m: 4e-3,
            sustains: 3,
            ..calibration_params(&rig)
        };
        (rig, params)
    }

    fn made(rig: &RigSpec, params: &CalibrationParams) -> Result<Library, CalibrationError> {
        calibrate(rig, 1, params, &AtomicBool::new(false), &mut |_| ())
    }

    #[test]
    fn plate_too_small_for_the_coins_is_refused() {
        let (mut rig, params) = small();
        rig.model.plate_side_m = 0.06;
        let fault = made(&rig, &params).unwrap_err();
        assert!(fault.to_string().starts_with("plate.side_mm: expected 95 or more"), "{fault}");
        let distance = |[a, b]: [[f64; 2]; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
        let pairs = COINS.iter().enumerate().flat_map(|(i, &a)| COINS[..i].iter().map(move |&b| [a, b]));
        let nearest = pairs.map(distance).fold(f64::INFINITY, f64::min);
        assert!((NEAREST..NEAREST + 0.01).contains(&nearest), "{nearest}");
    }

    /// Compares with tolerances for the sines of other platforms: one count, and the change of the read-out by one
    /// count or by one random number of noise.
    /// `UPM_REMAKE_GOLDEN=1` writes the file anew.
    #[test]
    fn a_small_library_comes_out_the_same_again() {
        let (rig, params) = small();
        let file = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("tests/golden/small-library.json");
        let library = made(&rig, &params).unwrap();
        if std::env::var_os("UPM_REMAKE_GOLDEN").is_some() {
            std::fs::write(&file, library.to_json()).unwrap();
        }
        let golden = Library::load(&file).unwrap();
        assert_eq!((library.entries.len(), golden.entries.len()), (9 + 4 + 4, 9 + 4 + 4));
        for (a, b) in library.entries.iter().zip(&golden.entries) {
            assert!(a.amplitudes.iter().zip(b.amplitudes).all(|(a, b)| a.abs_diff(b) <= 1), "{a:?} {b:?}");
            let off = a.pump - b.pump;
            assert!(off.velocity_mps.norm() < 2e-4 && off.spin_radps.abs() < 2e-3, "{a:?} {b:?}");
        }
        for (a, b) in library.shapes.iter().zip(&golden.shapes) {
            assert!(a.0.iter().zip(b.0).all(|(a, b)| (a.cos - b.cos).abs().max((a.sin - b.sin).abs()) < 1e-3));
        }
        let gains = library.accelerometer_gain.iter().zip(golden.accelerometer_gain);
        assert!(gains.into_iter().all(|(a, b)| (a - b).abs() < 2e-4), "{:?}", library.accelerometer_gain);
        let (model, before) = (&library.displacement, &golden.displacement);
        for &speed_mps in &before.speed_mps {
            for &sustain_s in &before.sustain_s {
                let off_m = model.distance(speed_mps, sustain_s) - before.distance(speed_mps, sustain_s);
                assert!(off_m.abs() < 0.005e-3, "{speed_mps} m/s, {sustain_s} s: {off_m} m");
                let off_m = model.sd(speed_mps, sustain_s) - before.sd(speed_mps, sustain_s);
                assert!(off_m.abs() < 0.002e-3, "sd at {speed_mps} m/s, {sustain_s} s: {off_m} m");
            }
        }
        assert_eq!(library.fingerprint, golden.fingerprint);
        // includes the friction of seven pennies on the plate
        let (plate, truth) = (library.plate.unwrap(), &rig.sim.plate);
        for axis in 0..3 {
            assert!((plate.natural_radps[axis] / (TAU * truth.resonance_hz[axis]) - 1.0).abs() < 0.03, "{plate:?}");
            assert!((plate.damping_ratio[axis] - truth.damping_ratio[axis]).abs() < 0.03, "{plate:?}");
        }
    }

    /// The harmonics of the plate's true velocity over the last six base periods of the sustain of `drive`, played from
    /// rest on an empty plate, as phasors of x, y and spin: a discrete Fourier transform under a Hann window, which
    /// rejects the slow oscillation excited by the attack.
    fn true_velocity(rig: &RigSpec, drive: &Drive) -> Vec<Vector3<Complex<f64>>> {
        let mut plant = Plant::new(&rig.sim, &[], &Streams::new(1));
        let end_s = drive.envelope.attack_s + drive.envelope.sustain_s;
        let window_s = 6.0 * TAU / drive.base_radps;
        let mut sums = vec![Vector3::zeros(); drive.motors[0].len()];
        plant.play(drive.clone());
        for i in 1..(end_s / rig.sim.step_s) as u32 {
            plant.step();
            let t_s = f64::from(i) * rig.sim.step_s;
            let part = (t_s - (end_s - window_s)) / window_s;
            if part <= 0.0 {
                continue;
            }
            let weight = 2.0 * rig.sim.step_s / window_s * (1.0 - (TAU * part).cos());
            let v = plant.plate().twist.vector();
            for (k, sum) in (1..).zip(&mut sums) {
                let turned = Complex::from_polar(weight, -f64::from(k) * drive.base_radps * t_s);
                *sum += v.map(|part| turned * part);
            }
        }
        sums
    }

    /// Largest distance of the plate's centre from `env(t) ∫ wave` in the pulse and for 0.3 s after it, m.
    fn off_the_envelope_m(rig: &RigSpec, drive: &Drive, wave: &TwistWave) -> f64 {
        let mut plant = Plant::new(&rig.sim, &[], &Streams::new(1));
        plant.play(drive.clone());
        let steps = ((drive.envelope.driven_s() + 0.3) / rig.sim.step_s) as u32;
        let off_m = |i: u32| {
            plant.step();
            let t_s = f64::from(i) * rig.sim.step_s;
            let integral = (1..).zip(&wave.harmonics).map(|(k, harmonic)| {
                let radps = f64::from(k) * wave.base_radps;
                let (sin, cos) = (radps * t_s).sin_cos();
                (harmonic.cos.velocity_mps * sin - harmonic.sin.velocity_mps * cos) / radps
            });
            let wanted_m = integral.sum::<upm_core::geometry::Vec2>() * drive.envelope.at(t_s);
            (plant.plate().plate_in_table.position_m - wanted_m).norm()
        };
        (1..steps).map(off_m).fold(0.0, f64::max)
    }

    /// Measures the response by the accelerometers alone, then plays a wave of eight random harmonics through it.
    #[test]
    fn a_wave_of_eight_harmonics_comes_out_on_the_plate() {
        let mut rig = RigSpec::upm_2().unwrap();
        rig.sim.camera.size_px = [1, 1];
        rig.model.frame_size_px = [1, 1];
        let stop = AtomicBool::new(false);
        let mut simulated = SimRig::new(rig.model.clone(), rig.sim.clone(), Vec::new(), Streams::new(1));
        let mut quiet = |_| ();
        let session = CalibrationSession::new(&mut simulated, &rig.model, &stop, &mut quiet);
        let fields = session.fields().unwrap().unwrap();
        assert_eq!(fields.twist_from_counts.len(), 8);
        let folder = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
        let small = Library::load(&folder.join("tests/golden/small-library.json")).unwrap();
        let plate = Some(upm_planning::cor_library::PlateResponse {
            natural_radps: rig.sim.plate.resonance_hz.map(|hz| TAU * hz),
            damping_ratio: rig.sim.plate.damping_ratio,
        });
        let library = Library { fields: Some(fields.clone()), plate, ..small };
        let mut rng = Streams::new(7).stream("waves");
        for _ in 0..3 {
            let mut amplitude = |most: f64| rng.random_range(-most..most);
            let mut twist = || Twist::new(amplitude(0.15), amplitude(0.15), amplitude(1.2));
            let mut harmonic = |k: u8| {
                let share = f64::from(k).recip();
                TwistHarmonic { cos: twist() * share, sin: twist() * share }
            };
            let harmonics = (1..=8).map(&mut harmonic).collect();
            let wave = TwistWave { base_radps: fields.base_radps, harmonics };
            let drive = library.field_drive(&wave, Follows::Velocity, 0.25).unwrap();
            assert!(drive.peak_counts() < fields.limit_counts, "{}", drive.peak_counts());
            let found = true_velocity(&rig, &drive);
            for (k, (found, wanted)) in found.iter().zip(&wave.harmonics).enumerate() {
                let wanted = wanted.phasor();
                let arm = Vector3::new(1.0, 1.0, 0.14);
                let [off, size] = [found - wanted, wanted].map(|v| v.zip_map(&arm, |part, arm| part * arm).norm());
                assert!(off < 0.002 * size, "harmonic {}: off by {off} of {size}", k + 1);
            }
            let by_displacement = library.field_drive(&wave, Follows::Displacement, 0.25).unwrap();
            let [swings_m, follows_m] = [drive, by_displacement].map(|drive| off_the_envelope_m(&rig, &drive, &wave));
            assert!(follows_m < 0.1 * swings_m, "{follows_m} {swings_m}");
        }
    }

    #[test]
    fn a_drive_too_weak_to_slide_a_coin_is_refused_with_the_limit() {
        let (mut rig, params) = small();
        rig.sim.motors.newtons_per_count *= 0.05;
        rig.model.newtons_per_count *= 0.05;
        let fault = made(&rig, &params).unwrap_err().to_string();
        assert!(fault.contains("expected a displacement of ") && fault.contains("carried"), "{fault}");
    }

    #[test]
    fn a_resonance_above_the_drive_is_refused() {
        let (mut rig, params) = small();
        rig.sim.plate.resonance_hz[2] = 90.0;
        let fault = made(&rig, &params).unwrap_err();
        assert!(matches!(fault, CalibrationError::Resonance { axis: "axis spin", .. }), "{fault}");
    }
}
