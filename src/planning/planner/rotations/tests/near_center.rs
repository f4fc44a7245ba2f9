//! Forecast of a disc near a centre of rotation against a slow reference: a disc of patches with Coulomb friction on
//! each.

use std::f64::consts::TAU;

use crate::cor_library::Library;
use crate::planner::fixture::library;
use crate::planner::pump::{Discs, LANES, Pump};
use upm_core::geometry::{Vec2, perp};
use upm_core::signal::Envelope;
use upm_core::units::GRAVITY_MPS2;

const FRICTION: f64 = 0.3;
const RADIUS_M: f64 = 9.53e-3;
/// Rings of the disc, and patches in each.
const RINGS: usize = 8;
const PATCHES: usize = 24;
/// Step of the integration, s; slip below which friction fades, m/s; and time allowed for the disc to come to rest, s.
const STEP_S: f64 = 2e-6;
const FADES_MPS: f64 = 2e-4;
const REST_S: f64 = 0.06;

/// Centres of patches of equal area, m.
fn patches() -> Vec<Vec2> {
    let ring_m = |ring: usize| RADIUS_M * ((ring as f64 + 0.5) / RINGS as f64).sqrt();
    let patch = |k: usize| {
        let (sin, cos) = (TAU * (k % PATCHES) as f64 / PATCHES as f64).sin_cos();
        ring_m(k / PATCHES) * Vec2::new(cos, sin)
    };
    (0..RINGS * PATCHES).map(patch).collect()
}

/// End, m, of the disc that starts at the origin of a belt of `speed_mps` along x on a plate that spins at
/// `spin_radps`.
fn end_in_belt(library: &Library, (speed_mps, spin_radps): (f64, f64), sustain_s: f64) -> Vec2 {
    let (radps, delay_s) = (library.base_radps, library.envelope_delay_s());
    let envelope = Envelope { attack_s: library.attack_s, sustain_s, rest_s: 0.0 };
    let length_s = 2.0 * library.attack_s + sustain_s + delay_s;
    let patches = patches();
    let (mut at, mut velocity, mut turning_radps) = (Vec2::zeros(), Vec2::zeros(), 0.0);
    for k in 0..((length_s + REST_S) / STEP_S) as usize {
        let t_s = (k as f64 + 0.5) * STEP_S;
        let wave = (radps * t_s).sin() + 0.5 * (2.0 * radps * t_s).cos();
        let integral = ((2.0 * radps * t_s).sin() / 4.0 - (radps * t_s).cos()) / radps;
        let shape = envelope.at(t_s - delay_s) * wave + envelope.slope(t_s - delay_s) * integral;
        let (mut force, mut torque) = (Vec2::zeros(), 0.0);
        for arm in &patches {
            let plate = (Vec2::new(speed_mps, 0.0) + perp(at + arm) * spin_radps) * shape;
            let slip = plate - velocity - perp(*arm) * turning_radps;
            let pull = slip / slip.norm().max(FADES_MPS);
            force += pull;
            torque += arm.perp(&pull);
        }
        let per_patch = FRICTION * GRAVITY_MPS2 * STEP_S / patches.len() as f64;
        velocity += force * per_patch;
        turning_radps += 2.0 * torque * per_patch / (RADIUS_M * RADIUS_M);
        at += velocity * STEP_S;
    }
    at
}

/// Centres from under the rim to 1 m away, short and long pulses: within 1 % of the displacement and 5 µm.
#[test]
fn disc_near_a_center_travels_as_its_patches_do() {
    let library = library();
    let pump = Pump::of(&library);
    // spin of the plate and distance of its centre; belts of up to 1.2 m/s
    let spins_radps = [18.0, 18.0, 18.0, 18.0, 18.0, 4.0, 4.0, 1.2];
    let arms_m = [6e-3, 9e-3, 14e-3, 25e-3, 60e-3, 60e-3, 0.25, 1.0];
    for sustains in [0, 12] {
        let discs = Discs {
            speed_mps: std::array::from_fn(|lane| spins_radps[lane] * arms_m[lane]),
            spin_radps: spins_radps,
            friction: [FRICTION; LANES],
            radius_m: RADIUS_M,
        };
        let found = pump.travel(&discs, &pump.course(sustains));
        for (lane, (spin_radps, arm_m)) in spins_radps.into_iter().zip(arms_m).enumerate() {
            let sustain_s = sustains as f64 * pump.sustain_step_s();
            let end_m = end_in_belt(&library, (discs.speed_mps[lane], spin_radps), sustain_s);
            let off_m = (Vec2::new(found[lane].along_m, found[lane].across_m) - end_m).norm();
            assert!(off_m < 0.01 * end_m.norm() + 5e-6, "{sustains} sustains, {arm_m} m: {off_m}");
        }
    }
}
