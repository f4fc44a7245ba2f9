use proptest::prelude::*;

use super::super::limits::Clearances;
use super::super::planner::FieldPlanner;
use super::*;
use crate::planner::fixture::{self, mm, penny};
use crate::planner::friction::friction_of;
use crate::planner::{FieldPulse, Limit, PartState, Plan, PlanStatus, PlannedPulse, PlannerParams};

/// Instants per period at which the planner checks the limits.
const OBSERVATIONS: usize = 4;
const SWAY_M: f64 = 0.25e-3;

fn params() -> PlannerParams {
    PlannerParams { half_side_m: HALF_SIDE_M, edge_margin_m: 0.0015, separation_m: 0.002, ..fixture::params() }
}

/// A planner for upm-2; the library is read once per process, its motions are drawn once per thread.
fn planner() -> FieldPlanner {
    thread_local! {
        static MADE: FieldPlanner = FieldPlanner::new(&upm_2(), params()).unwrap();
    }
    MADE.with(FieldPlanner::clone)
}

/// The pulse of a plan that has one.
fn pulse(plan: &Plan) -> Option<&FieldPulse> {
    match &plan.pulses[..] {
        [] => None,
        [PlannedPulse::Field(pulse)] => Some(pulse),
        pulses => panic!("one field at most, not {pulses:?}"),
    }
}

/// The forecast rollout of a pulse.
fn course(parts: &[PartState], pulse: &FieldPulse) -> Rollout {
    let friction = friction_of(&upm_2()).unwrap();
    let disc = |part: &PartState| RolloutDisc {
        position_m: part.position_m,
        velocity_mps: Vec2::zeros(),
        radius_m: part.radius_m,
        friction: friction * part.gain,
    };
    let discs: Vec<RolloutDisc> = parts.iter().map(disc).collect();
    let basis = upm_2_basis();
    let mut rollout = Rollout::default();
    rollout.run(&basis, &basis.coefficients(&pulse.wave), &upm_2_envelope(pulse.sustain_s), &discs);
    rollout
}

/// Positions of all parts at every `every`-th step of the forecast rollout.
fn rollout(parts: &[PartState], pulse: &FieldPulse, every: usize) -> Vec<Vec<Vec2>> {
    course(parts, pulse).places_m(every).collect()
}

fn left_m(parts: &[PartState], ends_m: &[Vec2]) -> f64 {
    let missing = |(part, end): (&PartState, &Vec2)| (part.position_m + part.step_m - end).norm_squared();
    parts.iter().zip(ends_m).map(missing).sum::<f64>().sqrt()
}

/// Smallest gap between rims and between a rim and the edge of the plate, m.
fn least_gaps_m(parts: &[PartState], places_m: &[Vec2]) -> (f64, f64) {
    let (mut rims_m, mut edge_m) = (f64::INFINITY, f64::INFINITY);
    for (i, (a, at)) in parts.iter().zip(places_m).enumerate() {
        edge_m = edge_m.min(HALF_SIDE_M - at.x.abs().max(at.y.abs()) - a.radius_m);
        for (b, other) in parts.iter().zip(places_m).skip(i + 1) {
            rims_m = rims_m.min((at - other).norm() - a.radius_m - b.radius_m);
        }
    }
    (rims_m, edge_m)
}

/// Up to 12 pennies anywhere on the plate that keep every limit, some barely, with steps to anywhere within it.
fn scene() -> impl Strategy<Value = Vec<PartState>> {
    let part = (-0.14..0.14f64, -0.14..0.14f64, -0.14..0.14f64, -0.14..0.14f64, 0.8..1.25f64);
    (proptest::collection::vec(part, 1..13), 0.01..1.0f64).prop_map(|(drawn, nearness)| {
        let mut parts: Vec<PartState> = Vec::new();
        for (x, y, to_x, to_y, gain) in drawn {
            let position_m = Vec2::new(x, y);
            let apart_m = 2.0 * PENNY_M + params().separation_m;
            if parts.iter().all(|other| (other.position_m - position_m).norm() > apart_m) {
                let step_m = (Vec2::new(to_x, to_y) - position_m) * nearness;
                parts.push(PartState { gain, ..penny(position_m, step_m) });
            }
        }
        parts
    })
}

/// Componentwise minimum of two pairs of gaps.
fn least(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    (a.0.min(b.0), a.1.min(b.1))
}

/// Plans for `parts` and checks every guarantee of a solved plan.
fn kept_plan(planner: &mut FieldPlanner, parts: &[PartState]) -> Plan {
    let (library, limits, basis) = (upm_2(), params(), upm_2_basis());
    let mut twin = planner.clone();
    let plan = planner.plan(parts, &[]);
    assert_eq!(twin.plan(parts, &[]), plan, "equal parts and states, equal plans");
    let Some(pulse) = pulse(&plan) else {
        assert!(plan.status != PlanStatus::Solved && plan.predicted_m.is_empty());
        return plan;
    };
    assert_eq!(plan.status, PlanStatus::Solved);
    assert!((0.0..=limits.max_sustain_s).contains(&pulse.sustain_s), "{}", pulse.sustain_s);
    let peak_counts = library.field_drive(&pulse.wave, pulse.follows, pulse.sustain_s).unwrap().peak_counts();
    assert!(peak_counts <= library.fields.as_ref().unwrap().limit_counts, "{peak_counts}");

    let forecast_m = planner.forecast(parts, pulse);
    assert_eq!(plan.predicted_m.len(), 1);
    let off = |(a, b): (&Vec2, &Vec2)| (a - b).norm() < 1e-12;
    assert!(plan.predicted_m[0].iter().zip(&forecast_m).all(off), "{:?} {forecast_m:?}", plan.predicted_m);
    let start_m: Vec<Vec2> = parts.iter().map(|part| part.position_m).collect();
    assert!(left_m(parts, &forecast_m) < left_m(parts, &start_m));

    let clearances = Clearances::of(parts, &limits);
    let mut before_m = start_m.clone();
    for places_m in rollout(parts, pulse, basis.steps_a_period() / OBSERVATIONS) {
        assert_eq!(clearances.broken_after(&start_m, &before_m, &places_m, SWAY_M), None);
        before_m = places_m;
    }
    // Half the separation and half the margin are left on the path, or the gap at the start less the sway.
    let gaps_m = rollout(parts, pulse, 1).iter().map(|places_m| least_gaps_m(parts, places_m)).reduce(least).unwrap();
    let at_first_m = least_gaps_m(parts, &start_m);
    let sway = |asked_m: f64, first_m: f64| if first_m < asked_m { SWAY_M + 0.1e-3 } else { 0.1e-3 };
    let (rims_m, edge_m) = (0.5 * limits.separation_m, 0.5 * limits.edge_margin_m);
    assert!(gaps_m.0 > at_first_m.0.min(rims_m) - sway(rims_m, at_first_m.0), "{gaps_m:?} {at_first_m:?}");
    assert!(gaps_m.1 > at_first_m.1.min(edge_m) - sway(edge_m, at_first_m.1), "{gaps_m:?} {at_first_m:?}");
    let shares = course(parts, pulse).edge_shares(limits.half_side_m);
    assert!(shares.iter().all(|share| *share >= 0.3), "the plate swings away from under a part: {shares:?}");
    plan
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    /// When all limits are kept at the start a plan is found, also by a planner with state from other parts.
    #[test]
    fn plans_are_solved_and_their_forecasts_kept(scenes in proptest::collection::vec(scene(), 1..4)) {
        let mut planner = planner();
        for parts in &scenes {
            let plan = kept_plan(&mut planner, parts);
            let largest_m = parts.iter().map(|part| part.step_m.norm()).fold(0.0, f64::max);
            let is_worth_it = largest_m >= 0.5 * params().min_distance_m;
            let expected = if is_worth_it { PlanStatus::Solved } else { PlanStatus::NothingToDo };
            prop_assert_eq!(plan.status, expected);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn parts_too_near_each_other_never_end_nearer(
        place in place(), turn in 0.0..6.3f64, gap_mm in 0.05..0.95f64, aside in -2.0..2.0f64, far in -0.02..0.02f64,
    ) {
        let mut planner = planner();
        let along = Vec2::new(turn.cos(), turn.sin());
        let apart_m = 2.0 * PENNY_M + 1e-3 * gap_mm;
        let mut parts = [
            penny(0.7 * place, 0.02 * along),
            penny(0.7 * place + apart_m * along, 0.02 * (aside * upm_core::geometry::perp(along) - along)),
            penny(-0.7 * place, Vec2::new(far, -far)),
        ];
        prop_assume!(left_m(&parts[2..], &[parts[0].position_m]) > 0.1);
        let gap_m = |parts: &[PartState]| (parts[0].position_m - parts[1].position_m).norm();
        for _ in 0..4 {
            let before_m = gap_m(&parts);
            let plan = planner.plan(&parts, &[]);
            for (part, end) in parts.iter_mut().zip(plan.predicted_m.iter().flatten()) {
                part.position_m = *end;
            }
            let asked_m = 2.0 * PENNY_M + 0.5 * params().separation_m;
            prop_assert!(gap_m(&parts) > before_m.min(asked_m) - 1e-6, "{} {before_m}", gap_m(&parts));
        }
    }
}

#[test]
fn trivial_steps_and_nonfinite_inputs_end_without_a_pulse() {
    fixture::ends_without_a_plan(|parts| planner().plan(parts, &[]).status);
    let nowhere = penny(mm(1.0, 2.0), mm(f64::INFINITY, 0.0));
    assert!(matches!(planner().plan(&[nowhere], &[]).status, PlanStatus::SolverFailed(_)));
}

fn at(x_mm: f64, y_mm: f64, step_x_mm: f64, step_y_mm: f64) -> PartState {
    penny(mm(x_mm, y_mm), mm(step_x_mm, step_y_mm))
}

/// Single pennies and points within the limits arrive within the tolerance at which the search ends.
#[test]
fn one_part_alone_gets_there() {
    for step_m in [mm(5.0, 0.0), mm(0.0, -8.0), mm(-9.0, 4.0)] {
        for radius_m in [0.0, PENNY_M] {
            let part = PartState { radius_m, step_m, ..at(30.0, -40.0, 0.0, 0.0) };
            let plan = kept_plan(&mut planner(), &[part]);
            assert!((plan.predicted_m[0][0] - part.position_m - step_m).norm() < 0.05 * step_m.norm(), "{plan:?}");
        }
    }
    let stays = at(60.0, 50.0, 0.0, 0.0);
    let plan = kept_plan(&mut planner(), &[at(10.0, 0.0, 5.0, 0.0), stays]);
    assert!((plan.predicted_m[0][1] - stays.position_m).norm() < 0.3e-3, "{plan:?}");
}

#[test]
fn parts_that_cannot_go_on_stop_the_plan() {
    let touching = 1e3 * (HALF_SIDE_M - PENNY_M);
    let out_of_the_corner = [at(touching, touching, 5.0, 5.0)];
    let status = kept_plan(&mut planner(), &out_of_the_corner).status;
    assert_eq!(status, PlanStatus::Infeasible(Limit::Edge { part: 0 }));
    let onto_each_other = [at(0.0, 0.0, 5.0, 0.0), at(19.05, 0.0, -5.0, 0.0)];
    let status = kept_plan(&mut planner(), &onto_each_other).status;
    assert_eq!(status, PlanStatus::Infeasible(Limit::Separation { parts: [0, 1] }));
    // Two parts at the same position with opposite steps: no motion can separate them.
    let one_place = [at(10.0, 0.0, -5.0, 0.0), at(10.0, 0.0, 5.0, 0.0)];
    assert!(matches!(kept_plan(&mut planner(), &one_place).status, PlanStatus::Infeasible(_)));
}

/// For any positions the plan keeps its guarantees or there is none.
#[test]
fn odd_scenes_end_in_a_status() {
    let touching = 1e3 * (HALF_SIDE_M - PENNY_M);
    let scenes = [
        vec![at(touching, touching, -5.0, -5.0)],
        vec![at(touching, -touching, -5.0, 5.0), at(touching - 19.05, -touching, -5.0, 0.0)],
        vec![at(155.0, 155.0, -5.0, -5.0), at(0.0, 0.0, 3.0, 0.0)],
        vec![at(1000.0, 0.0, -5.0, 0.0)],
        vec![at(0.0, 0.0, -5.0, 0.0), at(19.05, 0.0, 5.0, 0.0)],
        vec![at(0.0, 0.0, -5.0, 0.0), at(10.0, 0.0, 5.0, 0.0)],
        vec![at(10.0, 0.0, 5.0, 0.0), at(10.0, 0.0, 5.0, 0.0)],
        vec![at(10.0, 0.0, 1e6, 0.0), at(60.0, 0.0, 0.0, 1e-9)],
    ];
    for parts in scenes {
        kept_plan(&mut planner(), &parts);
    }
}

#[test]
fn a_library_without_fields_or_friction_has_no_planner() {
    let without_fields = Library { fields: None, ..Library::clone(&upm_2()) };
    assert!(FieldPlanner::new(&Arc::new(without_fields), params()).is_none());
    let without_friction = Library { displacement: Default::default(), ..Library::clone(&upm_2()) };
    assert!(FieldPlanner::new(&Arc::new(without_friction), params()).is_none());
}

/// When the parts did not move although a plan predicted it, the same plan is not made again.
#[test]
fn plan_that_moved_nothing_is_not_repeated() {
    let parts = [at(-30.0, 10.0, 0.4, -0.3), at(40.0, -20.0, -0.2, 0.5), at(0.0, 60.0, 0.3, 0.3)];
    let mut planner = planner();
    let plans: Vec<Plan> = (0..4).map(|_| kept_plan(&mut planner, &parts)).collect();
    for (i, plan) in plans.iter().enumerate() {
        assert_eq!(plan.status, PlanStatus::Solved);
        assert!(plans[..i].iter().all(|other| other.pulses != plan.pulses), "number {i}");
    }
}

#[test]
fn shares_of_a_plan_make_its_pulse_and_no_shares_exceed_the_limit() {
    let mut planner = planner();
    let parts = [penny(mm(20.0, 30.0), mm(12.0, -5.0)), penny(mm(-40.0, 10.0), mm(-8.0, 3.0))];
    let plan = planner.plan(&parts, &[]);
    let planned = pulse(&plan).unwrap();
    let shares = planner.shares_of(planned);
    let again = planner.pulse_of(&shares, planned.sustain_s);
    let velocity = |pulse: &FieldPulse| upm_2_basis().coefficients(&pulse.wave);
    let off = velocity(planned).iter().zip(velocity(&again)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(off < 1e-12, "{off}");
    let peak = |shares: &[f64]| {
        upm_2().field_drive(&planner.pulse_of(shares, 0.1).wave, again.follows, 0.1).unwrap().peak_counts()
    };
    let limit = upm_2().fields.as_ref().unwrap().limit_counts;
    for share in 0..planner.coefficients() {
        let alone: Vec<f64> = (0..planner.coefficients()).map(|i| f64::from(u8::from(i == share))).collect();
        assert!((0.98..=1.0).contains(&(peak(&alone) / limit)), "{share}");
    }
    assert!(peak(&vec![1.0; 99]) <= limit && peak(&[0.01]) < 0.1 * limit && peak(&[]) == 0.0);
}
