use std::f64::consts::TAU;

use proptest::prelude::*;

use super::*;
use crate::signal::{Drive, MOTORS};

/// Part of the motors' limit that a motion fills.
const EFFORT: f64 = 0.94;

fn drive(waves: &Waves, coefficients: &[f64], sustain_s: f64) -> Drive {
    upm_2().field_drive(&waves.wave(coefficients), sustain_s).unwrap()
}

fn limit_counts() -> f64 {
    upm_2().fields.as_ref().unwrap().limit_counts
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// The largest sample that is played at full height is the motion's share of the limit, whatever it was before.
    #[test]
    fn a_filled_motion_plays_up_to_its_share_of_the_limit(coefficients in motion(8), before in -3.0..3.0f64) {
        const SAMPLES: usize = 2000;
        let waves = upm_2_waves();
        let strength = upm_2_strength(&waves);
        let mut filled: Vec<f64> = coefficients.iter().map(|c| c * 10f64.powf(before)).collect();
        strength.fill(&waves, &mut filled);
        let ratio = filled[0] / coefficients[0];
        prop_assert!(ratio > 0.0, "the motion is made larger or smaller, not another");
        prop_assert!(filled.iter().zip(&coefficients).all(|(f, c)| (f - c * ratio).abs() < 1e-9 * ratio));
        let drive = drive(&waves, &filled, 0.1);
        let attack_s = drive.envelope.attack_s;
        let at = |i: usize| attack_s + TAU / drive.base_radps * i as f64 / SAMPLES as f64;
        let played = (0..MOTORS).flat_map(|motor| (1..SAMPLES).map(move |i| (motor, i)));
        let peak = played.map(|(motor, i)| drive.counts_at(motor, at(i)).abs()).fold(0.0, f64::max);
        let share = peak / limit_counts();
        prop_assert!((share - EFFORT).abs() < 0.005 * EFFORT, "{share}");
    }

    #[test]
    fn weights_are_the_counts_a_coefficient_asks_for(j in 0..48usize, speed_mps in 0.01..2.0f64) {
        let waves = upm_2_waves();
        let strength = upm_2_strength(&waves);
        let mut coefficients = vec![0.0; waves.len()];
        coefficients[j] = speed_mps;
        let drive = drive(&waves, &coefficients, 0.1);
        let square: f64 = drive.motors.iter().flatten().map(|h| h.cos * h.cos + h.sin * h.sin).sum();
        let counts = strength.norm(&coefficients);
        prop_assert!((counts - square.sqrt()).abs() < 1e-9 * counts, "{counts} {square}");
        prop_assert!((strength.weights[j].sqrt() * speed_mps - counts).abs() < 1e-9 * counts);
    }
}

#[test]
fn a_still_motion_stays_still() {
    let waves = upm_2_waves();
    let mut coefficients = vec![0.0; waves.len()];
    upm_2_strength(&waves).fill(&waves, &mut coefficients);
    assert!(coefficients.iter().all(|&c| c == 0.0));
}

#[test]
fn a_plate_that_cannot_be_turned_has_no_strength() {
    let fields = upm_2().fields.clone().unwrap();
    let mut responses = fields.twist_from_counts;
    responses[3].row_mut(2).fill(Default::default());
    assert!(Strength::new(&upm_2_waves(), &responses, HALF_SIDE_M, fields.limit_counts).is_none());
}
