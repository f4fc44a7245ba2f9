//! Forecast of a pulse against closed forms, and its slopes against finite differences.

use proptest::prelude::*;

use super::motion_set;
use crate::planner::fixture::{library, mm, penny, scene};
use crate::planner::pump::{Discs, LANES, Pump};
use crate::planner::rotations::motion_set::{DialSetting, LibraryMotion, Pulse};
use crate::planner::rotations::rollout::{SequenceRollout, Slopes};
use upm_core::geometry::{Twist, Vec2};

/// Displacement of a point on belts of these speeds after a sustain of `steps`, m.
fn travels_m(speed_mps: [f64; LANES], steps: usize) -> [f64; LANES] {
    let discs = Discs { speed_mps, spin_radps: [0.0; LANES], friction: [0.3; LANES], radius_m: 0.0 };
    let pump = Pump::of(&library());
    pump.travel(&discs, &pump.course(steps)).map(|travel| travel.along_m)
}

/// While the part is slow against the belt, d = ½ · 0.2386 · 1.2386 · μ g (S + 2A)² (equation sheet, section 1): a long
/// pulse on a very fast belt, where the phases of start and end hardly matter.
#[test]
fn a_fast_belt_carries_with_the_square_of_the_time() {
    let pump = Pump::of(&library());
    for steps in [60, 120] {
        let length_s = steps as f64 * pump.sustain_step_s() + 2.0 / 60.0;
        let sheet_m = 0.5 * 0.2386 * 1.2386 * 0.3 * 9.81 * length_s * length_s;
        let found_m = travels_m([20.0; LANES], steps)[0];
        assert!((found_m / sheet_m - 1.0).abs() < 0.12, "{found_m} {sheet_m}");
    }
}

/// In the limit a part moves with the belt at half its amplitude.
#[test]
fn a_slow_belt_carries_at_half_its_amplitude() {
    let pump = Pump::of(&library());
    let (speed_mps, before, after) = (0.2, 1200, 1300);
    let gained_m = travels_m([speed_mps; LANES], after)[0] - travels_m([speed_mps; LANES], before)[0];
    let time_s = (after - before) as f64 * pump.sustain_step_s();
    assert!((gained_m / time_s / (0.5 * speed_mps) - 1.0).abs() < 0.05, "{}", gained_m / time_s);
}

#[test]
fn a_plate_too_gentle_for_friction_carries_nothing() {
    // the plate's acceleration stays below μ g: no slip at all
    assert!(travels_m([0.002; LANES], 40)[0].abs() < 1e-5);
}

fn motion(twist: Twist, amplitude: f64, sustain_s: f64, reversed: bool) -> LibraryMotion {
    motion_set().motion_of(&twist, DialSetting { amplitude, sustain_s }, reversed)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// The dial gives the set distance on the typical belt, which for a translation is every belt.
    #[test]
    fn a_translation_goes_the_way_it_is_set_to(distance_mm in 0.05..20.0f64, k in 0usize..16, forwards: bool) {
        let motion_set = motion_set();
        let dial = motion_set.dials.iter().position(|dial| dial.entry == 289 + k).unwrap();
        let distance_m = if forwards { 1e-3 * distance_mm } else { -1e-3 * distance_mm };
        let (end, _) = motion_set.motion(Pulse { dial, distance_m }).carry(Vec2::zeros(), 1.0);
        let along = motion_set.dials[dial].twist.direction_at(Vec2::zeros());
        prop_assert!((end - along * distance_m).norm() < 0.02 * distance_m.abs() + 5e-6, "{end} {distance_m}");
    }

    #[test]
    fn slopes_of_a_sequence_agree_with_differences(seed in 0u64..1000, changed in 0usize..6) {
        let (motion_set, parts) = (motion_set(), scene(3, 5e-3, seed));
        let usable = motion_set.usable(parts.iter().map(|part| (part.position_m, part.radius_m)), 0.8);
        let pulse = |k: usize| Pulse {
            dial: usable[(37 * k + seed as usize) % usable.len()],
            distance_m: if k.is_multiple_of(2) { 2e-3 } else { -3e-3 },
        };
        let pulses: Vec<Pulse> = (0..6).map(pulse).collect();
        let play = |pulses: &[Pulse]| {
            let motions: Vec<LibraryMotion> = pulses.iter().map(|&pulse| motion_set.motion(pulse)).collect();
            let rollout = SequenceRollout::of(&motions, &parts);
            (motions, rollout)
        };
        let (motions, rollout) = play(&pulses);
        let slopes = Slopes::of(&motion_set, &pulses, &motions, &rollout, &parts);
        let mut other = pulses.clone();
        // the dial and the phase in which a pulse ends bend the curve: compare with the slope of a small extension of
        // the same
        let change_m = 0.02 * other[changed].distance_m;
        other[changed].distance_m += change_m;
        let moved = play(&other).1;
        for stage in changed + 1..=6 {
            for i in 0..parts.len() {
                let expected = (moved.at(stage)[i] - rollout.at(stage)[i]) / change_m;
                let found = slopes.at(stage, changed)[i];
                prop_assert!((found - expected).norm() < 0.03 * expected.norm() + 0.02, "{found} {expected}");
            }
        }
    }
}

#[test]
fn a_part_that_goes_farther_by_its_gain_is_forecast_so() {
    let translation = Twist::new(0.8, 0.0, 0.0);
    let part = penny(mm(10.0, 5.0), Vec2::zeros());
    let distance_m =
        |gain: f64| (motion(translation, 1.0, 0.05, false).carry(part.position_m, gain).0 - part.position_m).x;
    // a belt much faster than the part: the distance is proportional to friction
    assert!((distance_m(1.2) / distance_m(1.0) - 1.2).abs() < 0.03, "{}", distance_m(1.2) / distance_m(1.0));
}
