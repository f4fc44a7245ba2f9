use std::f64::consts::TAU;

use proptest::prelude::*;

use super::*;

const FRICTION: f64 = 0.3;
const PULL_MPS2: f64 = FRICTION * GRAVITY_MPS2;

fn point(position_m: Vec2) -> RolloutDisc {
    RolloutDisc { position_m, velocity_mps: Vec2::zeros(), radius_m: 0.0, friction: FRICTION }
}

/// Coefficients scaled to the limit of upm-2's motors.
fn full(basis: &HarmonicBasis, coefficients: &[f64]) -> Vec<f64> {
    let mut filled = coefficients.to_vec();
    upm_2_effort(basis).scale(basis, &mut filled, f64::INFINITY);
    filled
}

/// The pump `A (cos w(t - t0) - ½ cos 2w(t - t0))` along x, with t0 as a fraction of the period.
fn pump(basis: &HarmonicBasis, amplitude_mps: f64, late: f64) -> Vec<f64> {
    let mut coefficients = vec![0.0; basis.len()];
    for (k, share) in [(1, 1.0), (2, -0.5)] {
        let (sin, cos) = (k as f64 * TAU * late).sin_cos();
        (coefficients[2 * k - 2], coefficients[2 * k - 1]) = (amplitude_mps * share * cos, amplitude_mps * share * sin);
    }
    coefficients
}

fn abrupt(sustain_s: f64) -> Envelope {
    Envelope { attack_s: 0.0, sustain_s, rest_s: 0.0 }
}

/// Largest difference between the slopes of the ends and central differences, as a part of the largest slope.
fn slope_error(basis: &HarmonicBasis, coefficients: &[f64], envelope: &Envelope, discs: &[RolloutDisc]) -> f64 {
    const H_MPS: f64 = 1e-6;
    let mut rollout = Rollout::default();
    rollout.run(basis, coefficients, envelope, discs);
    let (mut largest, mut worst) = (0.0f64, 0.0f64);
    let moved = |j: usize, by_mps: f64| {
        let mut changed = coefficients.to_vec();
        changed[j] += by_mps;
        ends(basis, &changed, envelope, discs)
    };
    let differences: Vec<_> = (0..basis.len()).map(|j| (j, moved(j, H_MPS), moved(j, -H_MPS))).collect();
    let slopes = rollout.slopes(basis);
    assert_eq!(slopes.shape(), (basis.len(), 2 * discs.len()));
    for part in 0..discs.len() {
        for (j, more, less) in &differences {
            let difference = (more[part] - less[part]) / (2.0 * H_MPS);
            largest = largest.max(difference.norm());
            let slope = Vec2::new(slopes[(*j, 2 * part)], slopes[(*j, 2 * part + 1)]);
            worst = worst.max((difference - slope).norm());
        }
    }
    worst / largest
}

fn coins() -> impl Strategy<Value = Vec<RolloutDisc>> {
    proptest::collection::vec((place(), 0.1..0.6f64).prop_map(|(p, friction)| coin(p, friction)), 1..4)
}

/// More coins than there are SIMD lanes.
fn many_coins() -> impl Strategy<Value = Vec<RolloutDisc>> {
    proptest::collection::vec((place(), 0.1..0.6f64).prop_map(|(p, friction)| coin(p, friction)), 1..20)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Where the velocity follows the envelope they leave out that a change of the motion also moves the plate's
    /// centre, about which spin acts: an error of up to 3 % of the largest slope, and none without spin.
    #[test]
    fn slopes_are_central_differences(mut coefficients in motion(8), discs in coins(), sustain_s in 0.0..0.3f64) {
        let (basis, envelope) = (upm_2_basis(), upm_2_envelope(sustain_s));
        let error = |basis: &HarmonicBasis, coefficients: &[f64]| {
            slope_error(basis, &full(basis, coefficients), &envelope, &discs)
        };
        let (on_path, elsewhere) = (error(&basis.for_paths(), &coefficients), error(&basis, &coefficients));
        coefficients[32..].fill(0.0);
        let without_spin = error(&basis, &coefficients);
        prop_assert!(on_path < 3e-5 && elsewhere < 0.05 && without_spin < 1e-5, "{on_path} {elsewhere} {without_spin}");
    }

    /// Slopes of places under way are those of the ends of the same steps, less the coasting: by central differences.
    #[test]
    fn slopes_under_way_are_central_differences(coefficients in motion(8), discs in many_coins(), half in 0.2..0.9f64) {
        let (basis, envelope) = (upm_2_basis().for_paths(), upm_2_envelope(0.1));
        let coefficients = full(&basis, &coefficients);
        let run = |coefficients: &[f64]| {
            let mut rollout = Rollout::default();
            rollout.run(&basis, coefficients, &envelope, &discs);
            rollout
        };
        let rollout = run(&coefficients);
        let step = (half * rollout.steps() as f64) as usize;
        let normals: Vec<Vec2> = (0..discs.len()).map(|i| Vec2::new((i as f64).cos(), (i as f64).sin())).collect();
        let slopes = rollout.slopes_at(&basis, step, &normals);
        let largest = slopes.amax();
        for j in 0..48 {
            let shifted = |by: f64| {
                let mut changed = coefficients.clone();
                changed[j] += by;
                run(&changed).places_at(step)
            };
            let (more, less) = (shifted(1e-5), shifted(-1e-5));
            for (part, normal) in normals.iter().enumerate() {
                let difference = (more[part] - less[part]).dot(normal) / 2e-5;
                prop_assert!((difference - slopes[(j, part)]).abs() < 1e-3 * largest, "{difference} {}", slopes[(j, part)]);
            }
        }
    }

    /// A part's course does not depend on the other parts or on its index.
    #[test]
    fn each_part_goes_as_if_alone(coefficients in motion(8), discs in many_coins(), sustain_s in 0.0..0.2f64) {
        let basis = upm_2_basis();
        let coefficients = full(&basis, &coefficients);
        let envelope = upm_2_envelope(sustain_s);
        let course_of = |discs: &[RolloutDisc]| {
            let mut rollout = Rollout::default();
            rollout.run(&basis, &coefficients, &envelope, discs);
            rollout
        };
        let together = course_of(&discs);
        let slopes = together.slopes(&basis);
        let places_m: Vec<Vec<Vec2>> = together.places_m(7).collect();
        prop_assert_eq!(places_m[0].len(), discs.len());
        for (i, disc) in discs.iter().enumerate() {
            let alone = course_of(&[*disc]);
            prop_assert_eq!(together.ends_m[i], alone.ends_m[0]);
            prop_assert_eq!(together.edge_shares(HALF_SIDE_M)[i], alone.edge_shares(HALF_SIDE_M)[0]);
            prop_assert!(alone.places_m(7).zip(&places_m).all(|(alone, together)| alone[0] == together[i]));
            let alone_slopes = alone.slopes(&basis);
            prop_assert_eq!(slopes.columns(2 * i, 2), alone_slopes.columns(0, 2));
        }
    }

}

/// In steps for parts in corridors and in those for others: the error, as a part of the way, and the worst one.
#[test]
fn points_end_as_coulombs_law_in_fine_steps_predicts() {
    use rand::RngExt as _;
    for (basis, most, most_m) in [(upm_2_basis(), 0.012, 0.3e-3), (upm_2_basis().for_paths(), 0.007, 0.25e-3)] {
        let mut rng = upm_core::random::Streams::new(1).stream("points");
        let (mut off_sq, mut went_sq, mut worst_m) = (0.0, 0.0, 0.0f64);
        for _ in 0..48 {
            let drawn: Vec<f64> = (0..48).map(|j| rng.random_range(-1.0..1.0) / basis.harmonic_of(j) as f64).collect();
            let coefficients = full(&basis, &drawn);
            let envelope = upm_2_envelope(rng.random_range(0.0..0.3));
            let discs = [0; 4].map(|_| point(Vec2::new(rng.random_range(-0.14..0.14), rng.random_range(-0.14..0.14))));
            let wave = basis.wave(&coefficients);
            for (end_m, disc) in ends(&basis, &coefficients, &envelope, &discs).iter().zip(discs) {
                let fine_m = point_end(&wave, basis.follows, &envelope, disc.position_m, FRICTION);
                off_sq += (end_m - fine_m).norm_squared();
                went_sq += (fine_m - disc.position_m).norm_squared();
                worst_m = worst_m.max((end_m - fine_m).norm());
            }
        }
        let off = f64::sqrt(off_sq / went_sq);
        assert!(off < most && worst_m < most_m, "{off} of the way, at worst {worst_m} m");
    }
}

/// Equation sheet, section 1: mean force `0.2386 μ m g` on a part at rest, then coasting, which adds 24 %. Whole
/// periods on a belt far faster than the part; averaging over all start phases leaves only the mean force.
#[test]
fn a_short_pulse_carries_by_the_pump_of_the_sheet() {
    const STARTS: usize = 16;
    let basis = HarmonicBasis::new(TAU * 60.0, 2, HALF_SIDE_M);
    let sustain_s = 12.0 / 60.0;
    let went = |i: usize| {
        let coefficients = pump(&basis, 100.0, i as f64 / STARTS as f64);
        ends(&basis, &coefficients, &abrupt(sustain_s), &[point(Vec2::zeros())])[0]
    };
    let mean_m = (0..STARTS).map(went).sum::<Vec2>() / STARTS as f64;
    let sheet_m = 0.5 * 0.2386 * 1.2386 * PULL_MPS2 * sustain_s * sustain_s;
    assert!((mean_m.x / sheet_m - 1.0).abs() < 0.003 && mean_m.y == 0.0, "{mean_m} {sheet_m}");
}

#[test]
fn the_belt_ends_up_at_half_its_amplitude() {
    const AMPLITUDE_MPS: f64 = 0.3;
    let basis = HarmonicBasis::new(TAU * 60.0, 2, HALF_SIDE_M);
    let coefficients = pump(&basis, AMPLITUDE_MPS, 0.1);
    let went = |periods: f64| ends(&basis, &coefficients, &abrupt(periods / 60.0), &[point(Vec2::zeros())])[0].x;
    let speed_mps = went(120.0) - went(60.0);
    assert!((speed_mps / (0.5 * AMPLITUDE_MPS) - 1.0).abs() < 0.015, "{speed_mps}");
}

/// A part without friction stays while the plate swings by `A/w` under it, or turns by `A/(w h)`.
#[test]
fn part_at_the_edge_keeps_the_share_that_the_swinging_plate_leaves() {
    const RADPS: f64 = TAU * 30.0;
    let basis = HarmonicBasis::new(RADPS, 8, HALF_SIDE_M);
    let places_m = [Vec2::new(0.14, 0.03), Vec2::new(-0.09, -0.14), Vec2::new(0.0, 0.05)];
    let discs = places_m.map(|position_m| RolloutDisc { friction: 1e-9, ..point(position_m) });
    let shares = |axis: usize, amplitude_mps: f64| {
        let mut coefficients = vec![0.0; basis.len()];
        coefficients[axis * basis.per_axis()] = amplitude_mps;
        let mut rollout = Rollout::default();
        rollout.run(&basis, &coefficients, &abrupt(0.2), &discs);
        rollout.edge_shares(HALF_SIDE_M)
    };
    let swing_m = 1.5 / RADPS;
    let moved = |room_m: f64, by_m: f64| 1.0 - by_m / room_m;
    let rooms_m = places_m.map(|place| HALF_SIDE_M - place.amax());
    let expected = [
        // along x the part at the lower side stays as far from it
        (0, [moved(rooms_m[0], swing_m), 1.0, 1.0]),
        (1, [1.0, moved(rooms_m[1], swing_m), moved(rooms_m[2], swing_m)]),
        (2, [moved(rooms_m[0], 0.03 * swing_m / HALF_SIDE_M), moved(rooms_m[1], 0.09 * swing_m / HALF_SIDE_M), 1.0]),
    ];
    for (axis, expected) in expected {
        let found = shares(axis, 1.5);
        assert!(
            found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 5e-3),
            "{axis}: {found:?}"
        );
    }
    assert!(shares(0, 3.0)[0] < 0.0, "the plate leaves from under it");
}
