use nalgebra::DVector;
use proptest::prelude::*;

use super::super::optimizer::{Iterate, RolloutPool, ShootingProblem};
use super::super::separation::SeparationPenalty;
use super::*;
use crate::planner::{Limit, PartState};

const FRICTION: f64 = 0.3;

/// A few coins, their wanted steps and a motion to start from.
#[derive(Clone, Debug)]
struct ShootingSetup {
    discs: Vec<RolloutDisc>,
    steps_m: DVector<f64>,
    start: Vec<f64>,
}

fn scene(most: usize) -> impl Strategy<Value = ShootingSetup> {
    let part = (place(), -0.015..0.015f64, -0.015..0.015f64);
    (proptest::collection::vec(part, 1..=most), motion(8)).prop_map(|(parts, start)| ShootingSetup {
        discs: parts.iter().map(|&(p, ..)| coin(p, FRICTION)).collect(),
        steps_m: DVector::from_iterator(2 * parts.len(), parts.iter().flat_map(|&(_, x, y)| [x, y])),
        start,
    })
}

fn went(iterate: &Iterate, discs: &[RolloutDisc]) -> DVector<f64> {
    let went = iterate.rollout.ends_m.iter().zip(discs).flat_map(|(end, disc)| <[f64; 2]>::from(end - disc.position_m));
    DVector::from_iterator(2 * discs.len(), went)
}

/// The cost that the search minimises, computed from the ends alone.
fn cost(problem: &ShootingProblem<'_>, iterate: &Iterate) -> f64 {
    let missing = problem.steps_m - went(iterate, problem.discs);
    let went_m = went(iterate, problem.discs);
    missing.norm_squared() + problem.penalties.iter().map(|guard| guard.missing(went_m.as_slice()).powi(2)).sum::<f64>()
}

fn parts(discs: &[RolloutDisc]) -> Vec<PartState> {
    let part = |disc: &RolloutDisc| PartState {
        position_m: disc.position_m,
        step_m: Vec2::zeros(),
        radius_m: disc.radius_m,
        gain: 1.0,
    };
    discs.iter().map(part).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn more_rounds_never_cost_more(scene in scene(6), sustain_s in 0.0..0.2f64, penalised in any::<bool>()) {
        let basis = upm_2_basis();
        let effort = upm_2_effort(&basis);
        let penalties: Vec<SeparationPenalty> =
            penalised.then(|| SeparationPenalty::of_limit(Limit::Edge { part: 0 }, &parts(&scene.discs), scene.steps_m.as_slice())).flatten().into_iter().collect();
        let ShootingSetup { discs, steps_m, start } = scene;
        let problem = ShootingProblem {
            basis: &basis, effort: &effort, discs: &discs, steps_m: &steps_m,
            envelope: &upm_2_envelope(sustain_s), penalties: &penalties, corridors: &[], pool: &RolloutPool::default(),
        };
        let first = problem.iterate(&start);
        let mut before = cost(&problem, &first);
        let at_first = before;
        for rounds in 0..10 {
            let iterate = problem.improved(first.clone(), rounds);
            let now = cost(&problem, &iterate);
            prop_assert!(now <= before * (1.0 + 1e-12), "{rounds}: {now} {before}");
            let left = (problem.steps_m - went(&iterate, &discs)).norm() / steps_m.norm();
            prop_assert!((iterate.left(&steps_m) - left).abs() < 1e-12);
            before = now;
        }
        prop_assert!(before < at_first, "ten rounds better something");
    }

    /// Starts a fifth of the motion away, or nearer where that misses more than a third of the steps, and converges to
    /// the 2 % at which the search ends.
    #[test]
    fn ends_of_a_known_motion_are_met_from_nearby(scene in scene(8), off in motion(8), sustain_s in 0.0..0.2f64) {
        let basis = upm_2_basis();
        let effort = upm_2_effort(&basis);
        let envelope = upm_2_envelope(sustain_s);
        let ShootingSetup { discs, start: mut known, .. } = scene;
        effort.scale(&basis, &mut known, f64::INFINITY);
        let mut off = off;
        let scale = 0.2 * effort.norm(&known) / effort.norm(&off);
        off.iter_mut().for_each(|c| *c *= scale);
        let blank = DVector::zeros(2 * discs.len());
        let problem = ShootingProblem { basis: &basis, effort: &effort, discs: &discs, steps_m: &blank, envelope: &envelope, penalties: &[], corridors: &[], pool: &RolloutPool::default() };
        let steps_m = went(&problem.iterate(&known), &discs);
        let problem = ShootingProblem { steps_m: &steps_m, ..problem };
        let away = |share: f64| -> Vec<f64> { known.iter().zip(&off).map(|(c, d)| c + share * d).collect() };
        let iterates = (0..8).map(|halvings| problem.iterate(&away(0.5f64.powi(halvings))));
        let first = iterates.into_iter().find(|iterate| iterate.left(&steps_m) < 1.0 / 3.0).unwrap();
        let before = first.left(&steps_m);
        let iterate = problem.improved(first, 20);
        prop_assert!(iterate.left(&steps_m) < 0.04, "{} of {before} left", iterate.left(&steps_m));
    }
}

/// Away from the edge beside a part; along the line between two parts, with the second part's displacement counted
/// negative.
#[test]
fn penalties_act_away_from_the_edge_and_along_the_pair() {
    let discs = [coin(Vec2::new(0.02, -0.13), FRICTION), coin(Vec2::new(0.05, -0.09), FRICTION)];
    let parts = parts(&discs);
    let nothing = [0.0; 4];
    let edge = SeparationPenalty::of_limit(Limit::Edge { part: 0 }, &parts, &nothing).unwrap();
    assert_eq!(edge.missing(&[1.0, 0.0, 1.0, 1.0]), 0.0);
    let inwards = edge.missing(&[0.0, 1.0, 0.0, 0.0]);
    assert!(inwards < -1.0, "inwards is more than asked, and counts more than any other direction");
    let pair = SeparationPenalty::of_limit(Limit::Separation { parts: [0, 1] }, &parts, &nothing).unwrap();
    assert!(pair.missing(&[0.3, -0.7, 0.3, -0.7]).abs() < 1e-12, "together");
    assert!(pair.missing(&[0.4, -0.3, 0.0, 0.0]).abs() < 1e-12, "past each other");
    let towards = [0.3, 0.4, -0.3, -0.4];
    assert!((pair.missing(&towards) + inwards).abs() < 1e-12, "both together nearer by 1");
    let asked = SeparationPenalty::of_limit(Limit::Separation { parts: [0, 1] }, &parts, &towards).unwrap();
    assert!(asked.missing(&towards).abs() < 1e-12 && asked.missing(&nothing) < 0.0, "they were to come nearer");
    let mut pushed = asked;
    pushed.push(0.5);
    assert!((pushed.missing(&nothing) + 0.5 * inwards).abs() < 1e-12, "not nearer in any case, and away by 0.5");
    assert_eq!(SeparationPenalty::of_limit(Limit::Unreachable, &parts, &nothing), None);
    assert_eq!(SeparationPenalty::of_limit(Limit::Edge { part: 2 }, &parts, &nothing), None);
    let one_place = [parts[0], parts[0]];
    assert_eq!(SeparationPenalty::of_limit(Limit::Separation { parts: [0, 1] }, &one_place, &nothing), None);
}
