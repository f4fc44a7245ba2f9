use std::f64::consts::TAU;

use proptest::prelude::*;
use rand_distr::{Distribution, Normal};

use super::*;
use upm_core::geometry::{Twist, Vec2};
use upm_core::random::Streams;

const SAMPLE_HZ: f64 = 5000.0;
const PERIOD_S: f64 = 0.3;
const BASE_RADPS: f64 = TAU / PERIOD_S;
const LINES: usize = 16;
const PLACE_M: Vec2 = Vec2::new(-0.14, -0.14);
const ENVELOPE: Envelope = Envelope { attack_s: 0.3, sustain_s: PERIOD_S, rest_s: 0.05 };

/// One axis: natural frequency in Hz and damping ratio.
type Axis = (f64, f64);

/// Force phasors that grow with frequency, Schroeder phases; `free_mass_mps2` is the first line's acceleration.
fn force(free_mass_mps2: f64) -> Vec<Complex<f64>> {
    (1..=LINES)
        .map(|k| {
            let k = k as f64;
            Complex::from_polar(free_mass_mps2 * k, -TAU / 2.0 * k * k / LINES as f64)
        })
        .collect()
}

/// Acceleration of a unit mass on a spring at every sample of the pulse. The force starts at full height with the
/// pulse, which makes the initial transient as large as possible: the closed form of the steady state plus the
/// homogeneous solution that brings it to rest at 0.
fn oscillator_trace((natural_hz, ratio): Axis, force: &[Complex<f64>], delay_s: f64) -> Vec<f64> {
    let natural = TAU * natural_hz;
    let place = |w: f64, force: Complex<f64>| {
        force * Complex::from_polar(1.0, -w * delay_s)
            / Complex::new(natural * natural - w * w, 2.0 * ratio * natural * w)
    };
    let steady: Vec<(f64, Complex<f64>)> = force
        .iter()
        .enumerate()
        .map(|(i, &f)| ((i + 1) as f64 * BASE_RADPS, f))
        .map(|(w, f)| (w, place(w, f)))
        .collect();
    let (x0, v0) = steady.iter().fold((0.0, 0.0), |(x, v), (w, p)| (x + p.re, v + (Complex::new(0.0, *w) * p).re));
    // free decay e^{pt} with p = -ζω0 + jω0 sqrt(1 - ζ²), chosen so that position and velocity are zero at 0
    let pole = Complex::new(-ratio * natural, natural * (1.0 - ratio * ratio).sqrt());
    let decay = Complex::new(-x0, (v0 - pole.re * x0) / pole.im);
    (0..4600)
        .map(|i| {
            let t = f64::from(i) / SAMPLE_HZ;
            let driven: f64 = steady.iter().map(|(w, p)| -w * w * (p * Complex::from_polar(1.0, w * t)).re).sum();
            driven + (pole * pole * decay * (pole * t).exp()).re
        })
        .collect()
}

/// Readings of an 11-bit converter for these axis accelerations, noise included, with the second accelerometer
/// opposite.
fn converted(axes: &[Vec<f64>; 3], mps2_per_count: f64, noise_mps2: f64, seed: u64) -> AccelTrace {
    let mut rng = Streams::new(seed).stream("noise");
    let noise = Normal::new(0.0, noise_mps2).unwrap();
    let mut counts: [Vec<i16>; CHANNELS] = Default::default();
    let [x, y, spin] = axes;
    for ((&x, &y), &spin) in x.iter().zip(y).zip(spin) {
        let twist = Twist::new(x, y, spin);
        let (one, two) = (twist.velocity_at(PLACE_M), twist.velocity_at(-PLACE_M));
        for (channel, value) in counts.iter_mut().zip([one.x, one.y, two.x, two.y]) {
            channel.push(((value + noise.sample(&mut rng)) / mps2_per_count).round() as i16);
        }
    }
    AccelTrace { sample_hz: SAMPLE_HZ, first_sample_s: 0.0, mps2_per_count, count_limit: 1023, counts }
}

/// Resonances identified through a converter from the mean of `pulses` traces.
fn identified(axes: [Axis; 3], range_mps2: f64, noise_mps2: f64, pulses: u64, seed: u64) -> [OscillatorFit; 3] {
    let forces = [force(0.3), force(0.3), force(0.3 / PLACE_M.norm())];
    let accelerations = std::array::from_fn(|axis| oscillator_trace(axes[axis], &forces[axis], 2.7e-4));
    let mut sums = [vec![Complex::default(); LINES], vec![Complex::default(); LINES], vec![Complex::default(); LINES]];
    for pulse in 0..pulses {
        let trace = converted(&accelerations, range_mps2 / 1024.0, noise_mps2, 1000 * seed + pulse);
        let read = axis_lines(&trace, &ENVELOPE, BASE_RADPS, LINES, &AccelerometerPair::exact(PLACE_M)).unwrap();
        for (sum, read) in sums.iter_mut().zip(&read) {
            sum.iter_mut().zip(read).for_each(|(sum, line)| *sum += line / pulses as f64);
        }
    }
    std::array::from_fn(|axis| fit_oscillator(BASE_RADPS, &forces[axis], &sums[axis]).unwrap())
}

/// Resonances, converter ranges and noise of the two shipped rigs.
#[test]
fn shipped_resonances_within_3_percent_and_damping_within_003() {
    let rigs = [
        ("upm-1", [(11.0, 0.08), (13.0, 0.1), (17.0, 0.12)], 60.0, 0.15),
        ("upm-2", [(5.0, 0.18), (6.0, 0.2), (7.0, 0.22)], 900.0, 0.5),
    ];
    for (name, axes, range_mps2, noise_mps2) in rigs {
        for seed in 0..5 {
            let found = identified(axes, range_mps2, noise_mps2, 4, seed);
            for ((natural_hz, ratio), fit) in axes.into_iter().zip(found) {
                let off = fit.natural_radps / (TAU * natural_hz) - 1.0;
                assert!(off.abs() < 0.03, "{name}: {natural_hz} Hz off by {off}: {fit:?}");
                assert!((fit.damping_ratio - ratio).abs() < 0.03, "{name}: {ratio}: {fit:?}");
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]
    /// Without noise the fit is exact except for the finite number of samples, however large the transient.
    #[test]
    fn noiseless_oscillator_is_recovered(
        natural_hz in 4.0..25.0f64, ratio in 0.02..0.4f64, delay_s in 0.0..5e-4f64,
    ) {
        let force = force(1.0);
        let axis = oscillator_trace((natural_hz, ratio), &force, delay_s);
        let window = &axis[1500..3000];
        let turn = |k: usize| Complex::from_polar(1.0, -((k + 1) as f64) * BASE_RADPS * 0.3);
        let lines: Vec<_> = amplitude_spectrum(window)[1..=LINES].iter().enumerate().map(|(k, bin)| bin * turn(k)).collect();
        let fit = fit_oscillator(BASE_RADPS, &force, &lines).unwrap();
        prop_assert!((fit.natural_radps / (TAU * natural_hz) - 1.0).abs() < 1e-3, "{fit:?}");
        prop_assert!((fit.damping_ratio - ratio).abs() < 1e-3, "{fit:?}");
    }
}

#[test]
fn lines_that_fix_no_oscillator_are_rejected() {
    let force = force(1.0);
    let rejected = |accel: &[Complex<f64>]| {
        matches!(fit_oscillator(BASE_RADPS, &force, accel), Err(FitError::Undetermined { .. }))
    };
    assert!(rejected(&[]), "no lines");
    assert!(rejected(&vec![Complex::default(); LINES]), "a plate at rest");
    assert!(rejected(&vec![Complex::new(f64::NAN, 0.0); LINES]));
    assert!(rejected(&force[..3]), "fewer equations than unknowns");
    let mut rng = Streams::new(3).stream("noise");
    let noise = Normal::new(0.0, 1.0).unwrap();
    let noise: Vec<_> = (0..LINES).map(|_| Complex::new(noise.sample(&mut rng), noise.sample(&mut rng))).collect();
    assert!(rejected(&noise), "noise alone");
}

#[test]
fn spoiled_traces_give_no_lines() {
    let silent = |samples: usize| AccelTrace {
        sample_hz: SAMPLE_HZ,
        first_sample_s: 0.0,
        mps2_per_count: 0.1,
        count_limit: 1023,
        counts: std::array::from_fn(|_| vec![0; samples]),
    };
    let sensors = AccelerometerPair::exact(PLACE_M);
    let read = |trace: &AccelTrace, base_radps: f64| axis_lines(trace, &ENVELOPE, base_radps, LINES, &sensors).err();
    assert_eq!(read(&silent(4600), BASE_RADPS), None);
    assert!(matches!(read(&silent(2000), BASE_RADPS), Some(FitError::TooShort { .. })));
    let uneven = read(&silent(4600), TAU / 0.29993);
    assert_eq!(uneven, Some(FitError::Unreadable("the periods read are not whole samples")));
    let mut clipped = silent(4600);
    clipped.counts[3][2000] = 1023;
    assert!(matches!(read(&clipped, BASE_RADPS), Some(FitError::Clipped { channel: "y2", samples: 1, .. })));
}
