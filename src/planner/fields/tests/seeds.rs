use proptest::prelude::*;

use super::super::harmonic_basis::PlateInstant;
use super::super::seeds::SeedLibrary;
use super::*;

/// Nodes along a side of the seed library's tables.
const NODES: usize = 17;
/// Price of a displacement across the wanted step, relative to one along it.
const CROSS_STEP_PRICE: f64 = 0.3;
/// Symmetries of a square.
const SYMMETRIES: usize = 8;

fn basis() -> HarmonicBasis {
    HarmonicBasis::new(200.0, 4, HALF_SIDE_M)
}

/// Every motion the seed library has for these steps, best first.
fn all(seeds: &SeedLibrary, basis: &HarmonicBasis, positions_m: &[Vec2], steps_m: &[Vec2]) -> Vec<Vec<f64>> {
    seeds.best(basis, positions_m, steps_m, usize::MAX)
}

/// Mean direction of a motion's slip at `p` over every sample of a period.
fn mean_force(samples: &[PlateInstant], p: Vec2) -> Vec2 {
    let direction = |plate: &PlateInstant| {
        let spin = plate.spin_radps;
        (plate.velocity_mps + Vec2::new(-spin * p.y, spin * p.x)).normalize()
    };
    samples.iter().map(direction).sum::<Vec2>() / samples.len() as f64
}

/// The motion's score from its mean pushes: displacement along the steps less a share of the displacement across them.
fn score(mean_forces: &[Vec2], steps_m: &[Vec2]) -> f64 {
    let length = steps_m.iter().map(Vec2::norm_squared).sum::<f64>().sqrt();
    let along = mean_forces.iter().zip(steps_m).map(|(mean_force, step)| mean_force.dot(step)).sum::<f64>() / length;
    let square: f64 = mean_forces.iter().map(Vec2::norm_squared).sum();
    along - CROSS_STEP_PRICE * (square - along * along).max(0.0).sqrt()
}

/// Scores of `motions`.
fn scores(basis: &HarmonicBasis, motions: &[Vec<f64>], positions_m: &[Vec2], steps_m: &[Vec2]) -> Vec<f64> {
    let of = |motion: &Vec<f64>| {
        let samples = basis.motion(motion);
        let mean_forces: Vec<Vec2> = positions_m.iter().map(|&p| mean_force(&samples, p)).collect();
        score(&mean_forces, steps_m)
    };
    motions.iter().map(of).collect()
}

/// Largest amount by which a later score exceeds an earlier one.
fn disorder(scores: &[f64]) -> f64 {
    let fold = |(worst, least): (f64, f64), &p: &f64| (worst.max(p - least), least.min(p));
    scores.iter().fold((0.0, f64::INFINITY), fold).0
}

fn node() -> impl Strategy<Value = Vec2> {
    let at = |k: usize| HALF_SIDE_M * (2.0 * k as f64 / (NODES - 1) as f64 - 1.0);
    (0..NODES, 0..NODES).prop_map(move |(x, y)| Vec2::new(at(x), at(y)))
}

fn step() -> impl Strategy<Value = Vec2> {
    (-0.02..0.02f64, -0.02..0.02f64).prop_map(|(x, y)| Vec2::new(x, y))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    /// Each motion, with its symmetry and direction applied, is scored by its own mean pushes: the order agrees up to
    /// the error of the tables' fewer phases (at nodes) and of interpolation (between them). The best and the worst are
    /// 0.35 apart or more.
    #[test]
    fn the_order_is_that_of_the_laid_motions(
        at_nodes in proptest::collection::vec((node(), step()), 1..5),
        between in proptest::collection::vec((place(), step()), 1..5),
    ) {
        let basis = basis();
        let seeds = SeedLibrary::new(&basis, HALF_SIDE_M);
        for (scene, most) in [(at_nodes, 0.05), (between, 0.1)] {
            let (positions_m, steps_m): (Vec<Vec2>, Vec<Vec2>) = scene.into_iter().unzip();
            let motions = all(&seeds, &basis, &positions_m, &steps_m);
            let scores = scores(&basis, &motions, &positions_m, &steps_m);
            prop_assert!(disorder(&scores) < most, "{}", disorder(&scores));
        }
    }

    /// The reported mean forces equal those of the motions with their symmetry and direction applied.
    #[test]
    fn all_mean_forces_are_those_of_the_transformed_motions(scene in proptest::collection::vec((node(), step()), 1..4)) {
        let basis = basis();
        let seeds = SeedLibrary::new(&basis, HALF_SIDE_M);
        let (positions_m, steps_m): (Vec<Vec2>, Vec<Vec2>) = scene.into_iter().unzip();
        let reported = seeds.all_mean_forces(&positions_m).map(|there| {
            let back: Vec<Vec2> = there.iter().map(|mean_force| -mean_force).collect();
            score(&there, &steps_m).max(score(&back, &steps_m))
        });
        let mut reported: Vec<f64> = reported.collect();
        let mut transformed = scores(&basis, &all(&seeds, &basis, &positions_m, &steps_m), &positions_m, &steps_m);
        prop_assert_eq!(reported.len(), transformed.len());
        reported.sort_by(f64::total_cmp);
        transformed.sort_by(f64::total_cmp);
        let worst = reported.iter().zip(&transformed).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        prop_assert!(worst < 0.05, "{worst}");
    }

    #[test]
    fn the_best_few_are_the_first_of_all(
        scene in proptest::collection::vec((place(), step()), 1..13), count in 0..200usize,
    ) {
        let basis = basis();
        let (positions_m, steps_m): (Vec<Vec2>, Vec<Vec2>) = scene.into_iter().unzip();
        let few = SeedLibrary::new(&basis, HALF_SIDE_M).best(&basis, &positions_m, &steps_m, count);
        let motions = all(&SeedLibrary::new(&basis, HALF_SIDE_M), &basis, &positions_m, &steps_m);
        prop_assert_eq!(&few[..], &motions[..count]);
    }
}

/// A motion turned by a quarter or mirrored is in the seed library too, forwards or backwards, and each of the eight
/// images only once.
#[test]
fn seeds_are_closed_under_the_symmetries_of_the_square() {
    let basis = basis();
    let n = basis.per_axis();
    let seeds = SeedLibrary::new(&basis, HALF_SIDE_M);
    let motions = all(&seeds, &basis, &[Vec2::new(0.05, 0.02)], &[Vec2::new(0.01, -0.003)]);
    // The first coefficient of spin is made positive; its size is the same in all eight.
    let key = |motion: Vec<f64>| {
        let sign = motion[2 * n].signum();
        motion.iter().map(|c| ((c * sign + 0.0) * 1e12).round() as i64).collect::<Vec<i64>>()
    };
    let keys: std::collections::BTreeSet<_> = motions.iter().cloned().map(key).collect();
    assert_eq!(keys.len(), motions.len());
    let mut alike = std::collections::BTreeMap::new();
    keys.iter().for_each(|key| *alike.entry(key[2 * n]).or_insert(0) += 1);
    assert!(alike.values().all(|&times| times == SYMMETRIES));
    for motion in motions {
        let transformed = |onto: fn(f64, f64) -> (f64, f64), spin: f64| {
            let mut transformed = motion.clone();
            (0..n).for_each(|j| (transformed[j], transformed[n + j]) = onto(motion[j], motion[n + j]));
            transformed[2 * n..].iter_mut().for_each(|c| *c *= spin);
            key(transformed)
        };
        assert!(keys.contains(&transformed(|x, y| (-y, x), 1.0)), "turned");
        assert!(keys.contains(&transformed(|x, y| (-x, y), -1.0)), "mirrored");
    }
}

/// Opposite steps select the same motion with opposite sign and the same score.
#[test]
fn opposite_steps_get_opposite_motions() {
    let basis = basis();
    let seeds = SeedLibrary::new(&basis, HALF_SIDE_M);
    let positions_m = [Vec2::new(0.05, 0.02), Vec2::new(-0.07, 0.03)];
    let steps_m = [Vec2::new(0.01, -0.003), Vec2::new(0.0, 0.008)];
    let there = seeds.best(&basis, &positions_m, &steps_m, 20);
    let back = seeds.best(&basis, &positions_m, &steps_m.map(|s| -s), 20);
    for (there, back) in there.iter().zip(back) {
        assert!(there.iter().zip(back).all(|(a, b)| *a == -b));
    }
}
