use std::f64::consts::TAU;

use super::super::friction::friction_of;
use super::*;
use crate::fixture;
use upm_core::geometry::Twist;
use upm_core::signal::TwistHarmonic;
use upm_library::DisplacementModel;

const BASE_RADPS: f64 = TAU * 60.0;
const ATTACK_S: f64 = 0.0333;

/// A library whose table is what Coulomb's law in fine steps says of points under `A (sin wt + ½ cos 2wt)`.
fn library_of(friction: f64) -> Library {
    let distance = |speed_mps: f64, sustain_s: f64| {
        let along_x = |speed_mps: f64| Twist::new(speed_mps, 0.0, 0.0);
        let sin = TwistHarmonic { cos: Twist::ZERO, sin: along_x(speed_mps) };
        let cos = TwistHarmonic { cos: along_x(0.5 * speed_mps), sin: Twist::ZERO };
        let wave = TwistWave { base_radps: BASE_RADPS, harmonics: vec![sin, cos] };
        let envelope = Envelope { attack_s: ATTACK_S, sustain_s, rest_s: 0.0 };
        point_end(&wave, &envelope, Vec2::zeros(), friction).x
    };
    let speed_mps = upm_2().displacement.speed_mps.clone();
    let sustain_s: Vec<f64> = (0..7).map(|k| 0.05 * f64::from(k)).collect();
    let distance_m: Vec<Vec<f64>> =
        speed_mps.iter().map(|&speed| sustain_s.iter().map(|&sustain| distance(speed, sustain)).collect()).collect();
    let sd_m = vec![vec![0.0; sustain_s.len()]; speed_mps.len()];
    let displacement = DisplacementModel { speed_mps, sustain_s, distance_m, sd_m };
    Library { base_radps: BASE_RADPS, attack_s: ATTACK_S, displacement, ..Library::clone(&fixture::library()) }
}

/// To a percent at the rigs' friction. Elsewhere the steps and the slip at which friction is told from none make 3 %.
#[test]
fn a_table_made_with_a_friction_gives_it_back() {
    for (friction, off) in [(0.15, 0.035), (0.22, 0.03), (0.3, 0.012), (0.4, 0.015), (0.5, 0.01)] {
        let found = friction_of(&library_of(friction)).unwrap();
        assert!((found / friction - 1.0).abs() < off, "{friction} found as {found}");
    }
}

/// Its rig file says 0.3.
#[test]
fn the_shipped_library_knows_its_friction() {
    let found = friction_of(&upm_2()).unwrap();
    assert!((found / 0.3 - 1.0).abs() < 0.02, "{found}");
}

#[test]
fn without_distances_there_is_no_friction() {
    let mut library = library_of(0.3);
    library.displacement.distance_m.iter_mut().flatten().for_each(|d| *d = 0.0);
    assert_eq!(friction_of(&library), None, "nothing moved");
    library.displacement = DisplacementModel::default();
    assert_eq!(friction_of(&library), None, "nothing measured");
}
