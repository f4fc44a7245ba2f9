//! Synthesised fields against plain sums, fine steps, closed forms and the shipped libraries.

mod friction;
mod harmonic_basis;
mod motor_effort;
mod optimizer;
mod planner;
mod rollout;
mod seeds;

use std::path::Path;
use std::sync::{Arc, LazyLock};

use proptest::prelude::*;

use super::harmonic_basis::HarmonicBasis;
use super::motor_effort::MotorEffort;
use super::rollout::{Rollout, RolloutDisc};
use crate::cor_library::Library;
use crate::planner::fixture::PENNY_M;
use upm_core::geometry::{Twist, Vec2};
use upm_core::signal::{Envelope, Follows, TwistWave};
use upm_core::units::GRAVITY_MPS2;

/// Half the side of upm-2's plate, m.
const HALF_SIDE_M: f64 = 0.1524;

fn shipped(rig: &str) -> Library {
    let file = format!("assets/libraries/{rig}.json");
    Library::load(&Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join(file)).unwrap()
}

pub(super) fn upm_2() -> Arc<Library> {
    static LOADED: LazyLock<Arc<Library>> = LazyLock::new(|| Arc::new(shipped("upm-2")));
    Arc::clone(&LOADED)
}

fn upm_2_basis() -> HarmonicBasis {
    let fields = upm_2().fields.clone().unwrap();
    HarmonicBasis::new(fields.base_radps, fields.twist_from_counts.len(), HALF_SIDE_M)
}

fn upm_2_effort(basis: &HarmonicBasis) -> MotorEffort {
    MotorEffort::new(basis, &upm_2(), HALF_SIDE_M).unwrap()
}

fn upm_2_envelope(sustain_s: f64) -> Envelope {
    let library = upm_2();
    let fields = library.fields.as_ref().unwrap();
    Envelope { attack_s: fields.attack_s, sustain_s, rest_s: fields.rest_s }
}

/// Coefficients of up to 1 m/s, higher harmonics less.
fn motion(harmonics: usize) -> impl Strategy<Value = Vec<f64>> {
    let scaled = move |drawn: Vec<f64>| {
        let share = |j: usize| 1.0 / (j % (2 * harmonics) / 2 + 1) as f64;
        drawn.iter().enumerate().map(|(j, c)| c * share(j)).collect()
    };
    proptest::collection::vec(-1.0..1.0f64, 6 * harmonics).prop_map(scaled)
}

fn place() -> impl Strategy<Value = Vec2> {
    (-0.14..0.14f64, -0.14..0.14f64).prop_map(|(x, y)| Vec2::new(x, y))
}

fn coin(position_m: Vec2, friction: f64) -> RolloutDisc {
    RolloutDisc { position_m, velocity_mps: Vec2::zeros(), radius_m: PENNY_M, friction }
}

fn ends(basis: &HarmonicBasis, coefficients: &[f64], envelope: &Envelope, discs: &[RolloutDisc]) -> Vec<Vec2> {
    let mut rollout = Rollout::default();
    rollout.run(basis, coefficients, envelope, discs);
    rollout.ends_m
}

/// Steps of the slow reference, s.
const FINE_S: f64 = 10e-6;

/// Position where a point started at `position_m` comes to rest under Coulomb's law: friction of `μ m g` against the
/// slip, or just enough to stay at the plate's speed when that is less. The plate's offset is integrated step by step.
fn point_end(wave: &TwistWave, follows: Follows, envelope: &Envelope, position_m: Vec2, friction: f64) -> Vec2 {
    let most_mps = friction * GRAVITY_MPS2 * FINE_S;
    let displacement = |t_s: f64| {
        (1..).zip(&wave.harmonics).fold(Twist::ZERO, |sum, (k, harmonic)| {
            let radps = f64::from(k) * wave.base_radps;
            let (sin, cos) = (radps * t_s).sin_cos();
            sum + (harmonic.cos * sin - harmonic.sin * cos) * radps.recip()
        })
    };
    let (mut p, mut v) = (position_m, Vec2::zeros());
    for k in 0..(envelope.driven_s() / FINE_S).round() as usize {
        let t_s = (k as f64 + 0.5) * FINE_S;
        let offset = displacement(t_s);
        let slope = if follows == Follows::Displacement { envelope.slope(t_s) } else { 0.0 };
        let plate = wave.at(t_s) * envelope.at(t_s) + offset * slope;
        let slip = plate.velocity_at(p - offset.velocity_mps * envelope.at(t_s)) - v;
        v += slip * (most_mps / slip.norm().max(most_mps));
        p += v * FINE_S;
    }
    p + v * (v.norm() / (2.0 * friction * GRAVITY_MPS2))
}
