use proptest::prelude::*;

use super::super::bank::Bank;
use super::*;

/// Nodes along a side of the bank's tables.
const NODES: usize = 17;
/// Price of what goes astray against what goes right.
const ASTRAY: f64 = 0.3;
/// Ways to lay a square on itself.
const SYMMETRIES: usize = 8;

fn waves() -> Waves {
    Waves::new(200.0, 4, HALF_SIDE_M)
}

/// Every motion the bank has for these steps, best first.
fn all(bank: &Bank, waves: &Waves, positions_m: &[Vec2], steps_m: &[Vec2]) -> Vec<Vec<f64>> {
    bank.best(waves, positions_m, steps_m, usize::MAX)
}

/// Mean direction of a motion's slip at `p` over every sample of a period.
fn push(samples: &[[f64; 3]], p: Vec2) -> Vec2 {
    let direction = |[x, y, spin]: &[f64; 3]| Vec2::new(x - spin * p.y, y + spin * p.x).normalize();
    samples.iter().map(direction).sum::<Vec2>() / samples.len() as f64
}

/// What the motion promises, from its mean pushes: what goes along the steps less a share of what goes astray.
fn promise(pushes: &[Vec2], steps_m: &[Vec2]) -> f64 {
    let length = steps_m.iter().map(Vec2::norm_squared).sum::<f64>().sqrt();
    let along = pushes.iter().zip(steps_m).map(|(push, step)| push.dot(step)).sum::<f64>() / length;
    let square: f64 = pushes.iter().map(Vec2::norm_squared).sum();
    along - ASTRAY * (square - along * along).max(0.0).sqrt()
}

/// What each of `motions` promises.
fn promises(waves: &Waves, motions: &[Vec<f64>], positions_m: &[Vec2], steps_m: &[Vec2]) -> Vec<f64> {
    let of = |motion: &Vec<f64>| {
        let samples = waves.motion(motion);
        let pushes: Vec<Vec2> = positions_m.iter().map(|&p| push(&samples, p)).collect();
        promise(&pushes, steps_m)
    };
    motions.iter().map(of).collect()
}

/// How far a later one promises more than an earlier one, at most.
fn disorder(promises: &[f64]) -> f64 {
    let fold = |(worst, least): (f64, f64), &p: &f64| (worst.max(p - least), least.min(p));
    promises.iter().fold((0.0, f64::INFINITY), fold).0
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

    /// Each motion that is laid some way on the plate, and run the way it should, is judged by its own mean pushes: the
    /// order is theirs. At nodes this is the table itself, between them its interpolation.
    #[test]
    fn the_order_is_that_of_the_laid_motions(
        at_nodes in proptest::collection::vec((node(), step()), 1..5), between in proptest::collection::vec((place(), step()), 1..5),
    ) {
        let waves = waves();
        let bank = Bank::new(&waves, HALF_SIDE_M);
        for (scene, off) in [(at_nodes, 0.0), (between, 0.0)] {
            let (positions_m, steps_m): (Vec<Vec2>, Vec<Vec2>) = scene.into_iter().unzip();
            let motions = all(&bank, &waves, &positions_m, &steps_m);
            let promises = promises(&waves, &motions, &positions_m, &steps_m);
            println!("ORDER {} {off} {} {}", positions_m.len(), disorder(&promises), promises[0] - promises[promises.len() - 1]);
        }
    }
}
