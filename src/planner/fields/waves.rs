//! The motions that are searched: sums of harmonics on x, y and spin, sampled over one period.

use std::f64::consts::TAU;

use crate::geometry::{Twist, Vec2};
use crate::signal::{TwistHarmonic, TwistWave};

/// Steps in the period of the highest harmonic.
const STEPS: usize = 8;
/// Fewest steps of a base period.
const FEWEST: usize = 48;
/// Sampled phases from one step to the next. A period is no whole number of steps: the next one is met at other
/// phases, so that over a pulse the instants at which slip turns round are seen as if sampled this much finer.
const STRIDE: usize = 4;

/// Harmonics of one base frequency, sampled over one period.
///
/// The coefficients of a motion, m/s, are for x, y and spin in turn cos and sin of harmonic 1, cos and sin of harmonic 2,
/// and so on. Spin counts as the speed it gives a point half a side from the centre.
#[derive(Clone, Debug)]
pub(super) struct Waves {
    base_radps: f64,
    half_side_m: f64,
    /// Number of harmonics.
    pub harmonics: usize,
    /// Phases of a period.
    pub samples: usize,
    /// `table[sample * 2 harmonics + wave]`: cos and sin of each harmonic in turn.
    table: Vec<f64>,
}

impl Waves {
    pub fn new(base_radps: f64, harmonics: usize, half_side_m: f64) -> Self {
        let samples = (STEPS * harmonics).max(FEWEST) * STRIDE + 1;
        let phase = |q: usize| TAU * q as f64 / samples as f64;
        let waves = |q: usize| (1..=harmonics).flat_map(move |k| <[f64; 2]>::from((k as f64 * phase(q)).sin_cos()));
        let mut table: Vec<f64> = (0..samples).flat_map(waves).collect();
        table.chunks_exact_mut(2).for_each(|pair| pair.swap(0, 1));
        Self { base_radps, half_side_m, harmonics, samples, table }
    }

    /// Coefficients of one axis.
    pub fn per_axis(&self) -> usize {
        2 * self.harmonics
    }

    /// Coefficients of a motion.
    pub fn len(&self) -> usize {
        3 * self.per_axis()
    }

    /// Length of a step, s.
    pub fn step_s(&self) -> f64 {
        TAU / self.base_radps * STRIDE as f64 / self.samples as f64
    }

    /// The phase of a step.
    pub fn phase(&self, step: usize) -> usize {
        (step * STRIDE + STRIDE / 2) % self.samples
    }

    /// The harmonic a coefficient belongs to, from 1.
    pub fn harmonic_of(&self, coefficient: usize) -> usize {
        coefficient % self.per_axis() / 2 + 1
    }

    /// The plate's velocity in every step of a period: x and y (m/s) and spin (rad/s).
    pub fn motion(&self, coefficients: &[f64]) -> Vec<[f64; 3]> {
        let [x, y, spin] = self.axes(coefficients);
        let at = |waves: &[f64]| {
            let sum = |axis: &[f64]| axis.iter().zip(waves).map(|(c, w)| c * w).sum::<f64>();
            [sum(x), sum(y), sum(spin) / self.half_side_m]
        };
        self.table.chunks_exact(self.per_axis()).map(at).collect()
    }

    /// How far the plate's centre is from its place at rest in every step of a period, m.
    pub fn offsets_m(&self, coefficients: &[f64]) -> Vec<Vec2> {
        let [x, y, _] = self.axes(coefficients);
        let integral = |axis: &[f64], waves: &[f64]| {
            let term =
                |(k, (c, w)): (usize, (&[f64], &[f64]))| (c[0] * w[1] - c[1] * w[0]) / (k as f64 * self.base_radps);
            (1..).zip(axis.chunks_exact(2).zip(waves.chunks_exact(2))).map(term).sum::<f64>()
        };
        self.table
            .chunks_exact(self.per_axis())
            .map(|waves| Vec2::new(integral(x, waves), integral(y, waves)))
            .collect()
    }

    /// The slope of a quantity by every coefficient, from its slope by the plate's velocity (x, y, spin) in every step.
    pub fn slope(&self, by_motion: &[[f64; 3]], by_coefficient: &mut [f64]) {
        let n = self.per_axis();
        by_coefficient.fill(0.0);
        let (x, rest) = by_coefficient.split_at_mut(n);
        let (y, spin) = rest.split_at_mut(n);
        for (waves, &[by_x, by_y, by_spin]) in self.table.chunks_exact(n).zip(by_motion) {
            let by_spin = by_spin / self.half_side_m;
            for (((x, y), spin), w) in x.iter_mut().zip(y.iter_mut()).zip(spin.iter_mut()).zip(waves) {
                *x += by_x * w;
                *y += by_y * w;
                *spin += by_spin * w;
            }
        }
    }

    /// The motion in plain terms.
    pub fn wave(&self, coefficients: &[f64]) -> TwistWave {
        let [x, y, spin] = self.axes(coefficients);
        let twist = |j: usize| Twist::new(x[j], y[j], spin[j] / self.half_side_m);
        let harmonics = (0..self.harmonics).map(|k| TwistHarmonic { cos: twist(2 * k), sin: twist(2 * k + 1) });
        TwistWave { base_radps: self.base_radps, harmonics: harmonics.collect() }
    }

    /// The coefficients of `wave`; harmonics beyond those searched are left out.
    pub fn coefficients(&self, wave: &TwistWave) -> Vec<f64> {
        let n = self.per_axis();
        let mut coefficients = vec![0.0; self.len()];
        for (k, harmonic) in wave.harmonics.iter().take(self.harmonics).enumerate() {
            for (j, twist) in [(2 * k, harmonic.cos), (2 * k + 1, harmonic.sin)] {
                coefficients[j] = twist.velocity_mps.x;
                coefficients[n + j] = twist.velocity_mps.y;
                coefficients[2 * n + j] = twist.spin_radps * self.half_side_m;
            }
        }
        coefficients
    }

    /// Steps that make up a period, rounded down.
    pub fn steps_a_period(&self) -> usize {
        self.samples / STRIDE
    }

    fn axes<'a>(&self, coefficients: &'a [f64]) -> [&'a [f64]; 3] {
        let (x, rest) = coefficients.split_at(self.per_axis());
        let (y, spin) = rest.split_at(self.per_axis());
        [x, y, spin]
    }
}
