use std::f64::consts::TAU;

use nalgebra::Complex;
use rand::RngExt;

use super::shaken::{BarePlate, steady_motion};
use super::sweep::Progress;
use super::{LabError, LabRig};
use upm_core::background::on_all_cores;
use upm_core::random::{Rng, Streams};
use upm_core::signal::{Drive, Envelope, Harmonic};
use upm_perception::estimation::{AccelerometerPair, Coefficients, force_sign};

/// Half width of the null, in the sine of the phase, within which either sign is correct.
const NULL: f64 = 0.0175;
/// Mean of the sign of a velocity below which the sum over a cycle is not significant.
const FAINT: f64 = 2e-3;

/// Drives that one plate plays.
const DRIVES: usize = 500;

/// Sends `count` random drives along x, both harmonics of any phase, through the whole chain and evaluates Eq. 14 for
/// the sign of the mean friction force; the truth is the sign of the plate's velocity averaged over a cycle. Returns
/// the number of wrong signs.
pub(super) fn wrong_signs(lab: &LabRig, count: usize, progress: Progress<'_>) -> Result<usize, LabError> {
    let mut rng = Streams::new(lab.seed).stream("force signs");
    let (response, sensors) = (response(lab), AccelerometerPair::exact(lab.model.accelerometer_in_plate_m));
    let draw = || {
        let drive = random_drive(lab, &mut rng);
        true_sign(&drive, &response).map(|truth| (drive, truth))
    };
    let drives: Vec<(Drive, f64)> = std::iter::repeat_with(draw).flatten().take(count).collect();
    let shares: Vec<&[(Drive, f64)]> = drives.chunks(DRIVES).collect();
    let wrong = on_all_cores(&shares, progress, |share| {
        let mut plate = BarePlate::new(lab);
        let mut wrong = 0;
        for (drive, truth) in *share {
            let fit = plate.read("random drive", drive, &sensors)?;
            wrong += usize::from(force_sign(&fit.accel_mps2[0]) != *truth);
        }
        Ok::<_, LabError>(wrong)
    });
    wrong.into_iter().sum()
}

fn random_drive(lab: &LabRig, rng: &mut Rng) -> Drive {
    let mut draw = || Harmonic { cos: rng.random_range(-1.0..1.0), sin: rng.random_range(-1.0..1.0) };
    let wave = [draw(), draw()];
    let effort = rng.random_range(0.3..0.95) * lab.model.count_limit;
    let unit = along_x(lab, &wave);
    let peak_counts = unit.peak_counts();
    unit.scaled(effort / peak_counts)
}

fn along_x(lab: &LabRig, wave: &[Harmonic; 2]) -> Drive {
    let against = wave.map(|h| Harmonic { cos: -h.cos, sin: -h.sin });
    let envelope = Envelope { attack_s: lab.model.attack_s, sustain_s: 3.5 * TAU / lab.model.base_radps, rest_s: 0.01 };
    let motors = [wave.to_vec(), against.to_vec(), vec![], vec![]];
    Drive { base_radps: lab.model.base_radps, motors, envelope, ..Drive::default() }
}

/// Velocity phasors along x for one count of each harmonic. The chain is linear except for whole counts and limits.
fn response(lab: &LabRig) -> [Complex<f64>; 2] {
    const COUNTS: f64 = 100.0;
    let wave = [Harmonic { cos: COUNTS, sin: 0.0 }; 2];
    let motion = steady_motion(lab, &along_x(lab, &wave))[0];
    [motion.first, motion.second].map(|phasor| phasor / COUNTS)
}

/// Sign of the mean friction on a part at rest; `None` too near the null.
fn true_sign(drive: &Drive, response: &[Complex<f64>; 2]) -> Option<f64> {
    let phasor =
        |k: usize| drive.motors[0].get(k).map(|h| Complex::new(h.cos, -h.sin) * response[k]).unwrap_or_default();
    let (first, second) = (phasor(0), phasor(1));
    let sense = (first * first * second.conj()).re;
    if sense.abs() < NULL * first.norm_sqr() * second.norm() {
        return None;
    }
    let mean = mean_sign(&[first.re, -first.im, second.re, -second.im]);
    (mean.abs() > FAINT).then(|| mean.signum())
}

fn mean_sign(v: &Coefficients) -> f64 {
    const STEPS: u32 = 2000;
    let sign_at = |i: u32| {
        let (sin, cos) = (TAU * (f64::from(i) + 0.5) / f64::from(STEPS)).sin_cos();
        (v[0] * cos + v[1] * sin + v[2] * (cos * cos - sin * sin) + v[3] * 2.0 * sin * cos).signum()
    };
    (0..STEPS).map(sign_at).sum::<f64>() / f64::from(STEPS)
}

#[cfg(test)]
mod tests {
    use super::super::testing::lab_rig;
    use super::*;

    #[test]
    fn force_sign_is_measured_through_the_whole_chain() {
        for name in ["upm-1", "upm-2"] {
            let wrong = wrong_signs(&lab_rig(name), 1000, &|_| ()).unwrap();
            assert!(wrong <= 1, "{name}: {wrong}");
        }
    }

    #[test]
    fn mean_sign_of_the_papers_wave_is_the_known_value() {
        assert!((mean_sign(&[1.0, 0.0, -0.5, 0.0]) - 0.2386).abs() < 2e-3);
        assert!((mean_sign(&[-1.0, 0.0, 0.5, 0.0]) + 0.2386).abs() < 2e-3);
    }
}
