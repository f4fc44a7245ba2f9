//! Accelerometer readings predicted for a known periodic motion, to second order.
//!
//! A sensor at `r` on a plate turned by `θ` reads, along the plate's axes, `A - θ A^⊥ + α r^⊥ - ω² r`: the acceleration
//! of the centre seen from the turned plate, the angular and the centripetal acceleration. The two products are a few
//! percent of strong motions and have the same harmonics.

use nalgebra::{Complex, Vector3};

use upm_core::geometry::Vec2;
use upm_core::signal::CHANNELS;

/// Phasors of x, y and spin for harmonic k at index `k - 1`.
pub type Velocity = Vec<Vector3<Complex<f64>>>;

/// Acceleration phasors `c - js` of the four channels for harmonic k at index `k - 1`, m/s².
pub type AccelerometerPhasors = Vec<[Complex<f64>; CHANNELS]>;

/// Readings of accelerometers at `position_m` and at the opposite point for the plate's `velocity`, in as many
/// harmonics.
pub fn accelerometer_phasors(velocity: &Velocity, base_radps: f64, position_m: Vec2) -> AccelerometerPhasors {
    let rate = |k: usize| Complex::new(0.0, (k + 1) as f64 * base_radps);
    let axis = |axis: usize, factor: &dyn Fn(usize) -> Complex<f64>| -> Vec<Complex<f64>> {
        velocity.iter().enumerate().map(|(k, v)| v[axis] * factor(k)).collect()
    };
    let (x, y, spin_rate) = (axis(0, &rate), axis(1, &rate), axis(2, &rate));
    let (spin, turn) = (axis(2, &|_| Complex::new(1.0, 0.0)), axis(2, &|k| rate(k).inv()));
    (1..=velocity.len())
        .map(|n| {
            let k = n - 1;
            let pull = product(&spin, &spin, n);
            let (center_x, center_y) = (x[k] + product(&turn, &y, n), y[k] - product(&turn, &x, n));
            let at = |r: Vec2| [center_x - spin_rate[k] * r.y - pull * r.x, center_y + spin_rate[k] * r.x - pull * r.y];
            let ([x1, y1], [x2, y2]) = (at(position_m), at(-position_m));
            [x1, y1, x2, y2]
        })
        .collect()
}

/// Phasor of harmonic `n` of the product of two periodic quantities with as many harmonics each, `n` or more.
fn product(a: &[Complex<f64>], b: &[Complex<f64>], n: usize) -> Complex<f64> {
    let sums: Complex<f64> = a[..n - 1].iter().zip(b[..n - 1].iter().rev()).map(|(a, b)| a * b).sum();
    let differences = |high: &[Complex<f64>], low: &[Complex<f64>]| -> Complex<f64> {
        high[n..].iter().zip(low).map(|(high, low)| high * low.conj()).sum()
    };
    (sums + differences(a, b) + differences(b, a)) * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::RngExt;
    use std::f64::consts::TAU;
    use upm_core::random::Streams;

    const BASE_RADPS: f64 = TAU * 30.0;
    const R1_M: Vec2 = Vec2::new(-0.14, -0.13);

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        /// Compares with the mean over one period of the instantaneous accelerations times the harmonic.
        #[test]
        fn harmonics_are_those_of_the_instants(seed: u64, harmonics in 1usize..=8) {
            let mut rng = Streams::new(seed).stream("motion");
            let mut draw = |scale: f64| Complex::new(rng.random_range(-scale..scale), rng.random_range(-scale..scale));
            let velocity: Velocity = (0..harmonics).map(|_| Vector3::new(draw(0.5), draw(0.5), draw(4.0))).collect();
            let found = accelerometer_phasors(&velocity, BASE_RADPS, R1_M);
            let steps = 512;
            let mut sums = vec![[Complex::default(); CHANNELS]; harmonics];
            for i in 0..steps {
                let angle = TAU * f64::from(i) / f64::from(steps);
                let sum = |factor: &dyn Fn(f64) -> Complex<f64>| -> Vector3<f64> {
                    let terms = (1..).zip(&velocity).map(|(k, v)| {
                        let k = f64::from(k);
                        let turning = Complex::from_polar(1.0, k * angle) * factor(k * BASE_RADPS);
                        v.map(|v| (v * turning).re)
                    });
                    terms.sum()
                };
                let rate = sum(&|_| Complex::new(1.0, 0.0)).z;
                let acceleration = sum(&|w| Complex::new(0.0, w));
                let turn = sum(&|w| Complex::new(0.0, w).inv()).z;
                let channels = [0, 1, 2, 3].map(|channel| {
                    let r = if channel < 2 { R1_M } else { -R1_M };
                    let x = acceleration.x + turn * acceleration.y - acceleration.z * r.y - rate * rate * r.x;
                    let y = acceleration.y - turn * acceleration.x + acceleration.z * r.x - rate * rate * r.y;
                    [x, y][channel % 2]
                });
                for (k, sums) in (1..).zip(&mut sums) {
                    let turning = Complex::from_polar(2.0 / f64::from(steps), -f64::from(k) * angle);
                    sums.iter_mut().zip(channels).for_each(|(sum, a)| *sum += turning * a);
                }
            }
            for (found, sums) in found.iter().zip(&sums) {
                for (a, b) in found.iter().zip(sums) {
                    prop_assert!((a - b).norm() < 1e-8, "{found:?} {sums:?}");
                }
            }
        }
    }
}
