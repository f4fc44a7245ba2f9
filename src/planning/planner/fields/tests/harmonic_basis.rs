use std::f64::consts::TAU;

use proptest::prelude::*;

use super::super::harmonic_basis::{PlateInstant, PlateSlopes, SimdF64};
use super::*;

const BASE_RADPS: f64 = TAU * 30.0;

fn basis(harmonics: usize) -> HarmonicBasis {
    HarmonicBasis::new(BASE_RADPS, harmonics, HALF_SIDE_M)
}

/// The time of sample `q` of a period, s.
fn time_s(basis: &HarmonicBasis, q: usize) -> f64 {
    TAU / BASE_RADPS * q as f64 / basis.samples as f64
}

fn any_motion() -> impl Strategy<Value = (usize, Vec<f64>)> {
    (1..10usize).prop_flat_map(|harmonics| (Just(harmonics), motion(harmonics)))
}

proptest! {
    #[test]
    fn motion_is_the_plain_sum((harmonics, coefficients) in any_motion()) {
        let basis = basis(harmonics);
        let wave = basis.wave(&coefficients);
        let motion = basis.motion(&coefficients);
        prop_assert_eq!(motion.len(), basis.samples);
        for (q, plate) in motion.into_iter().enumerate() {
            let twist = wave.at(time_s(&basis, q));
            prop_assert!((plate.velocity_mps - twist.velocity_mps).norm() < 1e-12);
            prop_assert!((plate.spin_radps - twist.spin_radps).abs() < 1e-11);
        }
    }

    #[test]
    fn wave_and_coefficients_are_there_and_back((harmonics, coefficients) in any_motion(), fewer in 1..10usize) {
        let basis = basis(harmonics);
        let wave = basis.wave(&coefficients);
        prop_assert_eq!(wave.base_radps, BASE_RADPS);
        let back = basis.coefficients(&wave);
        prop_assert!(back.iter().zip(&coefficients).all(|(a, b)| (a - b).abs() < 1e-15));
        // The searched harmonics of a longer wave are kept; those missing from a shorter one are zero.
        let other = self::basis(fewer);
        let kept = other.wave(&other.coefficients(&wave));
        for (k, harmonic) in kept.harmonics.iter().enumerate() {
            let was = wave.harmonics.get(k).copied().unwrap_or_default();
            prop_assert!((harmonic.cos.velocity_mps - was.cos.velocity_mps).norm() < 1e-15);
            prop_assert!((harmonic.sin.spin_radps - was.sin.spin_radps).abs() < 1e-13);
        }
    }

    /// `Σ by_motion · motion(c) = slopes(by_motion) · c` for every c, for each of eight parts.
    #[test]
    fn slopes_are_the_transpose_of_motion(
        (harmonics, coefficients) in any_motion(), seed in any::<u64>(), has_segments in any::<bool>(),
    ) {
        use rand::RngExt as _;
        let segments = HarmonicBasis::for_segments(BASE_RADPS, harmonics, HALF_SIDE_M);
        let basis = if has_segments { segments } else { basis(harmonics) };
        let mut is_visited = vec![false; basis.samples];
        basis.phases().take(basis.samples).for_each(|phase| is_visited[phase] = true);
        let mut rng = upm_core::random::Streams::new(seed).stream("slopes");
        let mut any = || SimdF64::from([0; 8].map(|_| rng.random_range(-1.0..1.0)));
        let mut at = |is_visited: &bool| if *is_visited { any() } else { SimdF64::ZERO };
        let mut series = || [(); 3].map(|()| is_visited.iter().map(&mut at).collect::<Vec<SimdF64>>());
        let (by_velocity, by_displacement) = (series(), series());
        let motion = basis.motion(&coefficients);
        let of = |quantity: fn(&PlateInstant) -> f64| motion.iter().map(quantity).collect::<Vec<f64>>();
        let velocities =
            [of(|plate| plate.velocity_mps.x), of(|plate| plate.velocity_mps.y), of(|plate| plate.spin_radps)];
        let displacements = [of(|plate| plate.offset_m.x), of(|plate| plate.offset_m.y), of(|plate| plate.turn_rad)];
        let dot = |slopes: &[Vec<SimdF64>; 3], motion: &[Vec<f64>; 3]| -> SimdF64 {
            slopes.iter().flatten().zip(motion.iter().flatten()).map(|(a, b)| *a * *b).sum()
        };
        let forth = dot(&by_velocity, &velocities) + dot(&by_displacement, &displacements);
        let slopes: Vec<SimdF64> = basis.slopes(&PlateSlopes { by_velocity, by_displacement: Some(by_displacement) }).collect();
        prop_assert_eq!(slopes.len(), coefficients.len());
        let back: SimdF64 = slopes.iter().zip(&coefficients).map(|(a, b)| *a * *b).sum();
        prop_assert!((forth - back).to_array().iter().all(|off| off.abs() < 1e-9), "{forth} {back}");
    }

    /// Differences of offsets equal the integral of the velocity between them; the mean over a period is zero.
    #[test]
    fn offsets_are_the_velocity_summed_up((harmonics, coefficients) in any_motion()) {
        const FINER: usize = 64;
        let basis = basis(harmonics);
        let wave = basis.wave(&coefficients);
        let offsets_m: Vec<Vec2> = basis.motion(&coefficients).iter().map(|plate| plate.offset_m).collect();
        let h_s = time_s(&basis, 1) / FINER as f64;
        let mut place_m = offsets_m[0];
        for (q, offset_m) in offsets_m.iter().enumerate() {
            prop_assert!((place_m - offset_m).norm() < 1e-7, "{q}: {place_m} {offset_m}");
            let at = |i: usize| wave.at(time_s(&basis, q) + (i as f64 + 0.5) * h_s).velocity_mps;
            place_m += (0..FINER).map(at).sum::<Vec2>() * h_s;
        }
        let mean_m = offsets_m.iter().sum::<Vec2>() / basis.samples as f64;
        prop_assert!(mean_m.norm() < 1e-15);
    }
}
