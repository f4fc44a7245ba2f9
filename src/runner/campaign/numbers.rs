//! Random numbers of draws.

use libm::{exp, log};
use rand_distr::{Distribution, StandardUniform, Uniform};

use upm_core::random::Rng;

/// A number between `least` and `most`.
pub(super) fn within(least: f64, most: f64, rng: &mut Rng) -> f64 {
    let share: f64 = StandardUniform.sample(rng);
    least + (most - least) * share
}

/// A number between `least` and `most`, of one sign, its logarithm uniform.
pub(super) fn log_within(least: f64, most: f64, rng: &mut Rng) -> f64 {
    exp(within(log(least.abs()), log(most.abs()), rng)).copysign(least)
}

/// One of `count` indices.
pub(super) fn index(count: usize, rng: &mut Rng) -> usize {
    Uniform::new(0, count).map_or(0, |range| range.sample(rng))
}
