//! Direction in which a shaken plate pushes, and the pump wave nearest to its motion.
//!
//! A pump wave `T (cos w(t - t0) - ½ cos 2w(t - t0))` has the velocity phasors `Z1 = T e^{-jφ}` and
//! `Z2 = -½ T e^{-2jφ}`, `φ = w t0`. `Σ Z1² = |T|² e^{-2jφ}` gives φ up to half a turn and so T up to its sign; the
//! second harmonic determines the sign. Both harmonics then enter the fit: the wave nearest in acceleration, where the
//! noise is equal in both, is `T = ½ Re(Z1 e^{jφ} - 2 Z2 e^{2jφ})` at the φ that makes it largest. It also approximates
//! the flow of imperfect waves better than the first harmonic alone: with axis responses off by 3 % (4.5 % in the
//! second harmonic) directions of the mean force differ from its field by 2.8° rms, against 4.1°.

use std::f64::consts::PI;

use nalgebra::{Complex, Vector3};

use super::{AxisPhasors, Coefficients, PumpWaveQuality};
use upm_core::geometry::Twist;
use upm_core::phasor::{argument, magnitude};

/// Sign of the mean friction force on a part at rest under acceleration c1, s1, c2, s2: 1, -1, or 0 on the null
/// (Eq. 14).
pub fn force_sign(accel: &Coefficients) -> f64 {
    let [c1, s1, c2, s2] = *accel;
    let sense = 2.0 * s1 * c1 * c2 + s2 * (s1 * s1 - c1 * c1);
    if sense == 0.0 { 0.0 } else { sense.signum() }
}

/// The amplitude of the pump wave nearest to the motion `axes` (x, y, spin), and the quality of the approximation.
/// `spin_arm_m` is the radius at which spin is weighted like velocity. Zero motion gives a zero pump.
pub fn nearest_pump(axes: &[AxisPhasors; 3], spin_arm_m: f64) -> (Twist, PumpWaveQuality) {
    let arms = Vector3::new(1.0, 1.0, spin_arm_m);
    let first = Vector3::from_fn(|i, _| axes[i].first * arms[i]);
    let second = Vector3::from_fn(|i, _| axes[i].second * arms[i]);
    let phase_rad = refine_phase(&first, &second, first_guess(&first, &second));
    let pump = pump_at(&first, &second, phase_rad);
    let twist = Twist::new(pump[0], pump[1], if spin_arm_m > 0.0 { pump[2] / spin_arm_m } else { 0.0 });
    (twist, quality(&first, &second, &pump))
}

/// φ from the first harmonic; of the two values half a turn apart the one whose force points along `Re(Z1 e^{jφ})`.
fn first_guess(first: &Vector3<Complex<f64>>, second: &Vector3<Complex<f64>>) -> f64 {
    let phase_rad = -0.5 * argument(first.iter().map(|z| z * z).sum::<Complex<f64>>());
    let direction = turned(first, phase_rad);
    let (first, second) = (along(first, &direction), along(second, &direction));
    // Eq. 14 for velocity phasors: with `A1 = jw Z1`, `A2 = 2jw Z2` its bracket is `-2w³ Re(Z1² conj Z2)`
    if -(first * first * second.conj()).re < 0.0 { phase_rad + PI } else { phase_rad }
}

/// Maximises the length of [`pump_at`] over φ by Newton's method.
fn refine_phase(first: &Vector3<Complex<f64>>, second: &Vector3<Complex<f64>>, guess_rad: f64) -> f64 {
    let mut phase_rad = guess_rad;
    for _ in 0..12 {
        let (a, da) = (turned(first, phase_rad), turned(first, phase_rad + PI / 2.0));
        let (b, db) = (turned(second, 2.0 * phase_rad), turned(second, 2.0 * phase_rad + PI / 2.0));
        let (y, dy, ddy) = (a - 2.0 * b, da - 4.0 * db, -a + 8.0 * b);
        let (slope, bend) = (y.dot(&dy), dy.norm_squared() + y.dot(&ddy));
        if bend >= 0.0 {
            break;
        }
        let step_rad = (-slope / bend).clamp(-0.3, 0.3);
        phase_rad += step_rad;
        if step_rad.abs() < 1e-12 {
            break;
        }
    }
    phase_rad
}

/// The least-squares T for a given φ.
fn pump_at(first: &Vector3<Complex<f64>>, second: &Vector3<Complex<f64>>, phase_rad: f64) -> Vector3<f64> {
    0.5 * turned(first, phase_rad) - turned(second, 2.0 * phase_rad)
}

fn quality(first: &Vector3<Complex<f64>>, second: &Vector3<Complex<f64>>, pump: &Vector3<f64>) -> PumpWaveQuality {
    let whole = AxisPhasors { first: along(first, pump), second: along(second, pump) };
    let ratio = whole.harmonic_ratio().unwrap_or_default();
    // Along the pump an ideal wave has the ratio -½.
    PumpWaveQuality { harmonic_ratio: magnitude(ratio), harmonic_phase_rad: argument(-ratio) }
}

/// `Re(z e^{jφ})`, component by component.
fn turned(z: &Vector3<Complex<f64>>, phase_rad: f64) -> Vector3<f64> {
    let (sin, cos) = libm::sincos(phase_rad);
    z.map(|z| z.re * cos - z.im * sin)
}

/// Component of `z` along the real vector `direction`; zero when that is zero.
fn along(z: &Vector3<Complex<f64>>, direction: &Vector3<f64>) -> Complex<f64> {
    let size = direction.norm();
    let unit = if size > 0.0 { direction / size } else { Vector3::zeros() };
    z.iter().zip(&unit).map(|(z, u)| z * *u).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::axis_phasors;
    use proptest::prelude::*;
    use std::f64::consts::TAU;
    use upm_core::signal::TwistWave;

    const ARM_M: f64 = 0.12;

    fn delayed_pump(amplitude: Twist, start_rad: f64) -> [AxisPhasors; 3] {
        let turn = |z: Complex<f64>, k: f64| z * Complex::from_polar(1.0, -k * start_rad);
        axis_phasors(&TwistWave::pump(amplitude, 300.0))
            .map(|axis| AxisPhasors { first: turn(axis.first, 1.0), second: turn(axis.second, 2.0) })
    }

    proptest! {
        #[test]
        fn pump_waves_are_read_back(x in -1.0..1.0f64, y in -1.0..1.0f64, spin in -8.0..8.0f64, start_rad in 0.0..TAU) {
            let amplitude = Twist::new(x, y, spin);
            prop_assume!(x.hypot(y).hypot(ARM_M * spin) > 1e-2);
            let (pump, quality) = nearest_pump(&delayed_pump(amplitude, start_rad), ARM_M);
            prop_assert!((pump - amplitude).velocity_mps.norm() < 1e-9 && (pump - amplitude).spin_radps.abs() < 1e-9);
            prop_assert!((quality.harmonic_ratio - 0.5).abs() < 1e-9 && quality.harmonic_phase_rad.abs() < 1e-9);
        }
    }
}
