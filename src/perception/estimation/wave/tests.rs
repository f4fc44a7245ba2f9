use proptest::prelude::*;
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

use super::*;
use upm_core::random::{Rng, Streams};

const R1_M: Vec2 = Vec2::new(0.13, 0.12);
const SENSORS: AccelerometerPair = AccelerometerPair { position_m: R1_M, gain: [1.0; CHANNELS] };
const SAMPLE_HZ: f64 = 5000.0;
/// The rigs' converter, and one with negligible quantisation: m/s² of a count and largest count.
const RIG: (f64, i16) = (400.0 / 1024.0, 1023);
const FINE: (f64, i16) = (400.0 / 32_700.0, 32_700);

/// A wave whose harmonics reach a few m/s² each at the accelerometers.
fn random_wave(rng: &mut Rng, base_hz: f64, harmonics: usize) -> TwistWave {
    let base_radps = TAU * base_hz;
    let mut twist = |k: usize| {
        let mut draw = || rng.random_range(-12.0..12.0) / ((k + 1) as f64 * base_radps);
        Twist::new(draw(), draw(), draw() / R1_M.norm())
    };
    let harmonics = (0..harmonics).map(|k| TwistHarmonic { cos: twist(k), sin: twist(k) }).collect();
    TwistWave { base_radps, harmonics }
}

/// A disturbance added to the wave, m/s²: a value for each channel and time.
type Disturbance<'a> = &'a mut dyn FnMut(usize, f64) -> f64;

/// The converter's trace of a plate that moves as `wave` under `envelope`: corner accelerations by differentiating the
/// closed form. `gain` is each channel's reading for a true 1.
fn trace_of(
    wave: &TwistWave,
    envelope: &Envelope,
    (mps2_per_count, count_limit): (f64, i16),
    gain: [f64; CHANNELS],
    more: Disturbance<'_>,
) -> AccelTrace {
    let samples = (envelope.total_s() * SAMPLE_HZ) as usize;
    let acceleration = |channel: usize, t_s: f64| {
        let h = 1e-7;
        let velocity = |t_s: f64| wave.at(t_s).velocity_at(if channel < 2 { R1_M } else { -R1_M })[channel % 2];
        let slope = (velocity(t_s + h) - velocity(t_s - h)) / (2.0 * h);
        envelope.at(t_s) * slope + envelope.slope(t_s) * velocity(t_s)
    };
    let mut count = |channel: usize, i: usize| {
        let t_s = i as f64 / SAMPLE_HZ;
        let shown = gain[channel] * (acceleration(channel, t_s) + more(channel, t_s));
        (shown / mps2_per_count).round() as i16
    };
    let counts = std::array::from_fn(|channel| (0..samples).map(|i| count(channel, i)).collect());
    AccelTrace { sample_hz: SAMPLE_HZ, first_sample_s: 0.0, mps2_per_count, count_limit, counts }
}

/// Root mean square of the difference of two waves over that of the second, in velocity at the accelerometers.
fn off_part(found: &TwistWave, truth: &TwistWave) -> f64 {
    let square = |twist: Twist| twist.velocity_mps.norm_squared() + (twist.spin_radps * R1_M.norm()).powi(2);
    let pairs = || found.harmonics.iter().zip(&truth.harmonics);
    let off: f64 = pairs().map(|(f, t)| square(f.cos - t.cos) + square(f.sin - t.sin)).sum();
    (off / pairs().map(|(_, t)| square(t.cos) + square(t.sin)).sum::<f64>()).sqrt()
}

/// Two base periods of attack, then `periods` at full height.
fn pulse(base_hz: f64, periods: f64) -> Envelope {
    Envelope { attack_s: 2.0 / base_hz, sustain_s: periods / base_hz, rest_s: 0.05 }
}

fn normal(rng: &mut Rng) -> f64 {
    StandardNormal.sample(rng)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn known_motions_are_read_back(
        seed: u64, base_hz in 20.0..45.0f64, harmonics in 1usize..=16, periods in 1.1..6.0f64,
        gain in proptest::array::uniform4(0.95..1.05f64),
    ) {
        let wave = random_wave(&mut Streams::new(seed).stream("wave"), base_hz, harmonics);
        let envelope = pulse(base_hz, periods);
        let trace = trace_of(&wave, &envelope, FINE, gain, &mut |_, _| 0.0);
        let sensors = AccelerometerPair { gain, ..SENSORS };
        let fit = fit_wave(&trace, &envelope, wave.base_radps, harmonics, &sensors).unwrap();
        prop_assert_eq!(fit.wave.harmonics.len(), harmonics);
        prop_assert!(off_part(&fit.wave, &wave) < 0.01, "{}", off_part(&fit.wave, &wave));
        prop_assert!(fit.residual_rms_mps2 < 0.005, "a step's rms is 0.0035: {}", fit.residual_rms_mps2);
    }
}

/// Noise, bias, a slope and the plate's decaying resonance are added to a wave that must still be recovered.
#[test]
fn noise_and_drift_leave_the_wave_alone() {
    let mut rng = Streams::new(3).stream("waves");
    let cases = [
        (30.0, 8, 1.05, 0.1),
        (40.0, 8, 1.05, 0.14),
        (30.0, 8, 2.05, 0.01),
        (30.0, 8, 3.5, 0.01),
        (40.0, 6, 2.5, 0.01),
    ];
    for (base_hz, harmonics, periods, allowed) in cases {
        let (mut worst, trials) = (0.0f64, 40);
        for _ in 0..trials {
            let wave = random_wave(&mut rng, base_hz, harmonics);
            let envelope = pulse(base_hz, periods);
            let bias: [f64; CHANNELS] = std::array::from_fn(|_| 0.3 * normal(&mut rng));
            let slope: [f64; CHANNELS] = std::array::from_fn(|_| 2.0 * normal(&mut rng));
            let (ring_radps, phase_rad) = (TAU * rng.random_range(11.0..17.0), rng.random_range(0.0..TAU));
            let mut disturbance = |channel: usize, t_s: f64| {
                let ring = 0.5 * (-0.1 * ring_radps * t_s).exp() * (ring_radps * t_s + phase_rad).cos();
                bias[channel] + slope[channel] * t_s + ring + 0.15 * normal(&mut rng)
            };
            let trace = trace_of(&wave, &envelope, RIG, [1.0; CHANNELS], &mut disturbance);
            let fit = fit_wave(&trace, &envelope, wave.base_radps, harmonics, &SENSORS).unwrap();
            worst = worst.max(off_part(&fit.wave, &wave));
            assert!(fit.residual_rms_mps2 < 0.25, "{}", fit.residual_rms_mps2);
        }
        assert!(worst < allowed, "{base_hz} Hz, {harmonics} harmonics, {periods} periods: {worst}");
    }
}

/// White noise alone: the coefficients' errors over their standard deviations have a root mean square of 1.
#[test]
fn standard_deviations_are_those_of_repeated_fits() {
    let mut rng = Streams::new(8).stream("waves");
    for (harmonics, periods) in [(8, 1.05), (8, 3.5), (2, 1.05), (2, 2.5)] {
        let wave = random_wave(&mut rng, 30.0, harmonics);
        let envelope = pulse(30.0, periods);
        let clean = trace_of(&wave, &envelope, FINE, [1.0; CHANNELS], &mut |_, _| 0.0);
        let exact = fit_wave(&clean, &envelope, wave.base_radps, harmonics, &SENSORS).unwrap();
        let (mut of_wave, mut of_twist, trials) = (0.0, 0.0, 60);
        for _ in 0..trials {
            let noisy = trace_of(&wave, &envelope, FINE, [1.0; CHANNELS], &mut |_, _| 0.5 * normal(&mut rng));
            let fit = fit_wave(&noisy, &envelope, wave.base_radps, harmonics, &SENSORS).unwrap();
            for (found, truth) in fit.accel_mps2.iter().zip(&exact.accel_mps2) {
                let errors = found.as_flattened().iter().zip(truth.as_flattened()).map(|(a, b)| a - b);
                of_wave += errors.zip(fit.accel_sd_mps2.as_flattened()).map(|(e, sd)| (e / sd).powi(2)).sum::<f64>();
            }
            if harmonics == 2 {
                let fit = super::super::fit_twist(&noisy, &envelope, wave.base_radps, &SENSORS).unwrap();
                for (found, truth) in fit.accel_mps2.iter().zip(&exact.accel_mps2) {
                    let errors = found.iter().zip(truth.as_flattened()).map(|(a, b)| a - b);
                    let sds = fit.motion.accel_sd_mps2.as_flattened();
                    of_twist += errors.zip(sds).map(|(e, sd)| (e / sd).powi(2)).sum::<f64>();
                }
            }
        }
        let rms = |sum: f64| (sum / f64::from(trials) / (2 * CHANNELS * harmonics) as f64).sqrt();
        assert!((0.9..1.1).contains(&rms(of_wave)), "{harmonics} harmonics, {periods} periods: {}", rms(of_wave));
        assert!(harmonics != 2 || (0.9..1.1).contains(&rms(of_twist)), "{periods} periods: {}", rms(of_twist));
    }
}
