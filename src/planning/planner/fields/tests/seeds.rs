use proptest::prelude::*;

use super::super::harmonic_basis::PlateInstant;
use super::super::seeds::SeedLibrary;
use super::*;

/// Nodes along a side of the seed library's tables.
const NODES: usize = 17;
/// Price of a displacement across the wanted step, relative to one along it.
const CROSS_STEP_PRICE: f64 = 0.3;
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

fn node() -> impl Strategy<Value = Vec2> {
    let at = |k: usize| HALF_SIDE_M * (2.0 * k as f64 / (NODES - 1) as f64 - 1.0);
    (0..NODES, 0..NODES).prop_map(move |(x, y)| Vec2::new(at(x), at(y)))
}

fn step() -> impl Strategy<Value = Vec2> {
    (-0.02..0.02f64, -0.02..0.02f64).prop_map(|(x, y)| Vec2::new(x, y))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

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

}
