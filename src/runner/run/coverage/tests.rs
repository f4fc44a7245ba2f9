use std::f64::consts::{FRAC_1_SQRT_2, SQRT_2, TAU};

use proptest::prelude::*;

use super::fixture::{HALF_M, library};
use super::*;
use upm_core::geometry::Twist;

fn along(vx: f64, vy: f64) -> Twist {
    Twist::new(vx, vy, 0.0)
}

#[test]
fn between_two_axes_both_do_their_part() {
    let coverage = Coverage::of(&library([along(0.5, 0.0), along(0.0, -0.5), along(0.1, 0.1)]));
    assert_eq!(coverage.unreached_share(), 0.0);
    assert!((coverage.best_step_m - 0.02).abs() < 1e-15);
    for place in &coverage.places {
        assert!((place.reach.weakest_projection - FRAC_1_SQRT_2).abs() < 1e-9, "the diagonal is weakest: {place:?}");
        assert!((place.reach.longest_step_m - 0.02 * FRAC_1_SQRT_2).abs() < 1e-9);
        assert!((place.reach.longest_sd_m - 0.002 * FRAC_1_SQRT_2).abs() < 1e-9);
    }
    let leaning = Coverage::of(&library([along(0.5, 0.0), along(0.0, 0.1)]));
    let weakest = leaning.weakest().unwrap();
    // 20 mm along x, 10 mm along y: the two entries are equally strong where 2 |x| = |y|
    assert!((weakest.reach.weakest_direction.y - 2.0 / 5f64.sqrt()).abs() < 0.01, "{weakest:?}");
    assert!((weakest.reach.longest_step_m - 0.02 / 5f64.sqrt()).abs() < 0.0002, "{weakest:?}");
    assert!(
        (weakest.reach.shortest_step_m.unwrap() - 0.002 / 5f64.sqrt()).abs() < 0.00001,
        "1 mm along y: {weakest:?}"
    );
}

#[test]
fn a_lone_rotation_moves_nothing_through_its_centre() {
    let coverage = Coverage::of(&library([Twist::about(Vec2::zeros(), 8.0)]));
    assert_eq!((coverage.inside, coverage.outside, coverage.translations), (1, 0, 0));
    assert_eq!(coverage.unreached_share(), 1.0, "nothing moves along the radius");
    for place in coverage.places.iter().filter(|place| place.position_m.norm() > 0.02) {
        let along_radius = place.reach.weakest_direction.dot(&place.position_m.normalize()).abs();
        assert!(along_radius > 0.999, "{place:?}");
    }
    let gap = coverage.gap.unwrap();
    assert!((gap.distance_m - SQRT_2 * HALF_M).abs() < 1e-12 && (gap.position_m.amax() - HALF_M).abs() < 1e-12);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn the_weakest_direction_is_the_weakest(
        twists in proptest::collection::vec((-0.5..0.5f64, -0.5..0.5f64, -6.0..6.0f64), 1..9),
        angle in 0.0..TAU,
    ) {
        let made = library(twists.into_iter().map(|(vx, vy, spin)| Twist::new(vx, vy, spin)));
        let direction = Vec2::new(angle.cos(), angle.sin());
        let coverage = Coverage::of(&made);
        for place in &coverage.places {
            let step = |entry: usize| made.displacement_at(entry, place.position_m, 0.2).dot(&direction).abs();
            let longest = (0..made.entries.len()).map(step).fold(0.0, f64::max);
            // the sampled directions are half a degree apart
            prop_assert!(place.reach.longest_step_m <= longest + 0.009 * 0.02, "{longest} {place:?}");
            prop_assert!(place.reach.shortest_step_m.is_none_or(|shortest| shortest <= place.reach.longest_step_m + 1e-12));
        }
        prop_assert_eq!(coverage.inside + coverage.outside + coverage.translations, made.entries.len());
    }
}
