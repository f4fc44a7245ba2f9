//! The whole chain on plates on flexible rods: motor force, resonance and its transient, sensors, converter.

use std::f64::consts::TAU;

use nalgebra::Complex;
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};

use super::*;
use upm_core::geometry::{Twist, Vec2};
use upm_core::random::{Rng, Streams};
use upm_core::signal::{CHANNELS, MISSING_SAMPLE};

const R1_M: Vec2 = Vec2::new(0.09, 0.085);
const SENSORS: AccelerometerPair = AccelerometerPair { position_m: R1_M, gain: [1.0; CHANNELS] };
const SAMPLE_HZ: f64 = 5000.0;
const MPS2_PER_COUNT: f64 = 60.0 / 1024.0;
const PULSE: Envelope = Envelope { attack_s: 0.015, sustain_s: 0.08, rest_s: 0.03 };

/// Three independent mass-spring-dampers (Eq. 33) driven by `amplitude · (cos wt - sin 2wt)` under an envelope.
struct WavingPlate {
    base_radps: f64,
    resonance_radps: [f64; 3],
    damping_ratio: f64,
    /// Force over mass of x and y (m/s²), torque over inertia of spin (rad/s²).
    drive: [f64; 3],
}

impl WavingPlate {
    fn random(rng: &mut Rng, base_hz: f64, drive: [f64; 3]) -> Self {
        let resonance_radps = std::array::from_fn(|_| TAU * rng.random_range(11.0..17.0));
        Self { base_radps: TAU * base_hz, resonance_radps, damping_ratio: 0.1, drive }
    }

    /// Steady velocity phasors, by the transfer function.
    fn steady(&self) -> [AxisPhasors; 3] {
        std::array::from_fn(|axis| {
            let w0 = self.resonance_radps[axis];
            let gain = |k: f64| {
                let s = Complex::new(0.0, k * self.base_radps);
                s / (s * s + s * (2.0 * self.damping_ratio * w0) + w0 * w0) * self.drive[axis]
            };
            AxisPhasors { first: gain(1.0), second: gain(2.0) * Complex::i() }
        })
    }

    /// Accelerations of every axis at every sample, by the classical Runge-Kutta method.
    fn accelerations(&self, envelope: &Envelope) -> [Vec<f64>; 3] {
        const SUBSTEPS: usize = 8;
        let dt = 1.0 / (SAMPLE_HZ * SUBSTEPS as f64);
        let force = |t: f64| envelope.at(t) * ((self.base_radps * t).cos() - (2.0 * self.base_radps * t).sin());
        std::array::from_fn(|axis| {
            let w0 = self.resonance_radps[axis];
            let accel = |t: f64, [q, v]: [f64; 2]| {
                self.drive[axis] * force(t) - 2.0 * self.damping_ratio * w0 * v - w0 * w0 * q
            };
            let rate = |t: f64, s: [f64; 2]| [s[1], accel(t, s)];
            let along = |s: [f64; 2], k: [f64; 2], h: f64| [s[0] + h * k[0], s[1] + h * k[1]];
            let mut state = [0.0; 2];
            let mut out = Vec::new();
            for i in 0..(envelope.total_s() / dt) as usize {
                let t = i as f64 * dt;
                if i % SUBSTEPS == 0 {
                    out.push(accel(t, state));
                }
                let k1 = rate(t, state);
                let k2 = rate(t + 0.5 * dt, along(state, k1, 0.5 * dt));
                let k3 = rate(t + 0.5 * dt, along(state, k2, 0.5 * dt));
                let k4 = rate(t + dt, along(state, k3, dt));
                state = std::array::from_fn(|j| state[j] + dt / 6.0 * (k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j]));
            }
            out
        })
    }
}

/// Adds the rigs' noise, bias and converter quantisation.
fn digitised(axes: &[Vec<f64>; 3], noise_mps2: f64, bias_mps2: f64, rng: &mut Rng) -> AccelTrace {
    let mut normal = |sd: f64| -> f64 { sd * Distribution::<f64>::sample(&StandardNormal, rng) };
    let counts = std::array::from_fn(|channel| {
        let (sign, bias) = (if channel < 2 { 1.0 } else { -1.0 }, normal(bias_mps2));
        let exact = |i: usize| match channel % 2 {
            0 => axes[0][i] - sign * axes[2][i] * R1_M.y,
            _ => axes[1][i] + sign * axes[2][i] * R1_M.x,
        };
        let count =
            |i: usize| ((exact(i) + bias + normal(noise_mps2)) / MPS2_PER_COUNT).round().clamp(-1024.0, 1023.0) as i16;
        (0..axes[0].len()).map(count).collect()
    });
    AccelTrace { sample_hz: SAMPLE_HZ, first_sample_s: 0.0, mps2_per_count: MPS2_PER_COUNT, count_limit: 1023, counts }
}

/// A plate driven to turn about `center_m` (as a free mass would) with 25 m/s² of each harmonic at the fastest corner.
fn turning_plate(rng: &mut Rng, base_hz: f64, center_m: Vec2, sign: f64) -> WavingPlate {
    let twist = Twist::about(center_m, sign);
    let fastest = [R1_M, -R1_M].map(|r| twist.velocity_at(r).norm()).into_iter().fold(0.0, f64::max);
    let drive = twist * (25.0 / fastest);
    WavingPlate::random(rng, base_hz, [drive.velocity_mps.x, drive.velocity_mps.y, drive.spin_radps])
}

/// Root mean square error of the measured centre of rotation, m, over centres inside the plate.
fn center_error_m(base_hz: f64, envelope: &Envelope, trials: u32) -> f64 {
    let mut rng = Streams::new(11).stream("plates");
    let mut sum = 0.0;
    for trial in 0..trials {
        let center_m = Vec2::new(rng.random_range(-0.1..0.1), rng.random_range(-0.1..0.1));
        let sign = if trial % 2 == 0 { 1.0 } else { -1.0 };
        let plate = turning_plate(&mut rng, base_hz, center_m, sign);
        let trace = digitised(&plate.accelerations(envelope), 0.15, 0.3, &mut rng);
        let fit = fit_twist(&trace, envelope, plate.base_radps, &SENSORS).unwrap();
        let (truth, _) = nearest_pump(&plate.steady(), R1_M.norm());
        assert!(fit.pump.spin_radps * sign > 0.0, "flow turns the way the force does");
        let error = fit.pump.center_of_rotation().unwrap() - truth.center_of_rotation().unwrap();
        sum += error.norm_squared();
        assert!(fit.motion.residual_rms_mps2 < 0.2, "{}", fit.motion.residual_rms_mps2);
    }
    (sum / f64::from(trials)).sqrt()
}

#[test]
fn centers_inside_the_plate_are_read_to_a_quarter_millimetre() {
    for (base_hz, attack_s, sustain_s) in
        [(60.0, 0.015, 0.08), (60.0, 0.01, 0.051), (60.0, 0.02, 0.2), (40.0, 0.02, 0.1), (60.0, 0.01, 0.034)]
    {
        let error_m = center_error_m(base_hz, &Envelope { attack_s, sustain_s, rest_s: 0.0 }, 60);
        assert!(error_m < 0.25e-3, "{base_hz} Hz, attack {attack_s} s, sustain {sustain_s} s: {error_m} m");
    }
}

#[test]
fn one_period_is_read_to_a_millimetre() {
    let error_m = center_error_m(60.0, &Envelope { attack_s: 0.01, sustain_s: 0.018, rest_s: 0.0 }, 60);
    assert!(error_m < 1e-3, "{error_m} m");
}

#[test]
fn phasors_of_every_axis_match_the_transfer_function() {
    let mut rng = Streams::new(5).stream("plates");
    for _ in 0..20 {
        let drive = std::array::from_fn(|axis| rng.random_range(5.0..10.0) * if axis == 2 { 8.0 } else { 1.0 });
        let plate = WavingPlate::random(&mut rng, 60.0, drive);
        let trace = digitised(&plate.accelerations(&PULSE), 0.0, 0.3, &mut rng);
        let fit = fit_twist(&trace, &PULSE, plate.base_radps, &SENSORS).unwrap();
        for (axis, (read, truth)) in fit.axes.iter().zip(plate.steady()).enumerate() {
            let error = (read.first - truth.first).norm() / truth.first.norm();
            let second = (read.second - truth.second).norm() / truth.second.norm();
            assert!(error < 3e-3 && second < 3e-3, "axis {axis}: {error}, {second}");
        }
    }
}

#[test]
fn bad_traces_are_refused() {
    let mut rng = Streams::new(6).stream("plates");
    let plate = turning_plate(&mut rng, 60.0, Vec2::new(0.03, 0.0), 1.0);
    let trace = digitised(&plate.accelerations(&PULSE), 0.15, 0.3, &mut rng);
    let fit = |trace: &AccelTrace, pulse: &Envelope, r1: Vec2| {
        fit_twist(trace, pulse, plate.base_radps, &AccelerometerPair::exact(r1))
    };
    assert!(fit(&trace, &PULSE, R1_M).is_ok());
    assert!(matches!(fit(&trace, &PULSE, Vec2::zeros()), Err(FitError::Unreadable(_))));
    assert!(matches!(fit(&trace, &Envelope { sustain_s: 0.016, ..PULSE }, R1_M), Err(FitError::TooShort { .. })));
    assert!(matches!(fit(&AccelTrace::default(), &PULSE, R1_M), Err(FitError::Unreadable(_))));
    let cut = AccelTrace { counts: trace.counts.clone().map(|c| c[..450].to_vec()), ..trace.clone() };
    assert!(matches!(fit(&cut, &PULSE, R1_M), Err(FitError::CutShort { .. })));
    let mut gap = trace.clone();
    gap.counts[3][400] = MISSING_SAMPLE;
    assert_eq!(fit(&gap, &PULSE, R1_M), Err(FitError::Missing { channel: "y2", samples: 1 }));
    let mut clipped = trace.clone();
    clipped.counts[0][400..403].fill(-1024);
    assert_eq!(fit(&clipped, &PULSE, R1_M), Err(FitError::Clipped { channel: "x1", samples: 3, limit: 1023 }));
    let still = AccelTrace { counts: trace.counts.clone().map(|c| vec![4; c.len()]), ..trace };
    assert!(matches!(fit(&still, &PULSE, R1_M), Err(FitError::TooWeak { .. })));
}
