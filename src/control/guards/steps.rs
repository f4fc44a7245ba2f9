use super::{GROSS, SLIGHT};
use crate::PulsePositions;
use crate::progress::SERVED;
use upm_core::geometry::Vec2;

/// Error of the forecasts of synthesised fields among many parts, m.
const FORECAST_M: f64 = 1e-3;
/// Forecast steps below this are no evidence, m.
const SHORTEST_M: f64 = 2.0 * FORECAST_M;
/// The same among more parts than one motion serves: one for 24 parts leaves some of them in place during five pulses
/// that should carry them by up to 2.4 mm.
const SHORTEST_OF_MANY_M: f64 = 3.0 * FORECAST_M;

/// Compares the measured step of each part with its forecast.
#[derive(Clone, Debug, Default)]
pub struct StepGuard {
    /// For each part the number of its last steps, in a row, in which it hardly moved.
    missed: Vec<u32>,
    /// Steps that were compared, and those in which the part hardly moved.
    pub compared: [u64; 2],
}

impl StepGuard {
    /// Takes the steps of one pulse, at whose end the plate is `swayed_m` from where it was, under each part: one that
    /// sticks to it goes with it. Returns the first part that has hardly moved in `limit` of its steps in a row.
    pub fn check(&mut self, seen: &PulsePositions, swayed_m: &[Vec2], limit: u32) -> Option<usize> {
        let parts = seen.before_m.len();
        self.missed.resize(parts, 0);
        let shortest_m = if parts > SERVED as usize { SHORTEST_OF_MANY_M } else { SHORTEST_M };
        for (part, wanted, went) in steps(seen, shortest_m) {
            let on_plate = went - swayed_m.get(part).copied().unwrap_or_default();
            let is_missed = went.norm().min(on_plate.norm()) < SLIGHT * wanted.norm();
            self.missed[part] = if is_missed { self.missed[part] + 1 } else { 0 };
            self.compared = [self.compared[0] + 1, self.compared[1] + u64::from(is_missed)];
        }
        self.missed.iter().position(|missed| *missed >= limit)
    }
}

/// How a pulse carried a part, most parts or the plate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum PulseOutcome {
    /// As planned, within the accuracy of forecasts.
    AsPlanned,
    /// Nearly so, as by a plate that moves slightly off its plan.
    About,
    /// Otherwise, or not at all.
    Otherwise,
}

/// The parts that should go `shortest_m` or farther, with the step of each and the one that it went.
fn steps(seen: &PulsePositions, shortest_m: f64) -> impl Iterator<Item = (usize, Vec2, Vec2)> {
    let PulsePositions { before_m, by_learning_m, after_m, .. } = seen;
    let steps = before_m.iter().zip(by_learning_m).zip(after_m).zip(0..);
    let steps = steps.map(|(((from, to), after), part)| (part, to - from, after - from));
    steps.filter(move |(_, wanted, _)| wanted.norm() >= shortest_m)
}

/// How a pulse carried most parts; `None` when no part should move far enough to judge.
pub fn went(seen: &PulsePositions) -> Option<PulseOutcome> {
    let outcome = |(_, wanted, went): (usize, Vec2, Vec2)| {
        let length_m = wanted.norm();
        let along = went.dot(&wanted) / (length_m * length_m);
        let across = (went - wanted * along).norm() / length_m;
        match along > GROSS && along < 1.0 / GROSS && across < GROSS {
            true if (went - wanted).norm() < FORECAST_M.max(SLIGHT * length_m) => PulseOutcome::AsPlanned,
            true => PulseOutcome::About,
            false => PulseOutcome::Otherwise,
        }
    };
    let mut all: Vec<PulseOutcome> = steps(seen, SHORTEST_M).map(outcome).collect();
    all.sort_unstable();
    // the best outcome that more than half of the parts reach
    all.get(all.len() / 2).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Positions of parts that should go `step_m` and went to `after_m`.
    fn positions(step_m: Vec2, after_m: Vec<Vec2>) -> PulsePositions {
        let (before_m, forecast_m) = (vec![Vec2::zeros(); after_m.len()], vec![step_m; after_m.len()]);
        PulsePositions { before_m, after_m, by_library_m: Vec::new(), by_learning_m: forecast_m }
    }

    /// Findings in each of several pulses that should carry two parts 4 mm along x; the second moves `share` of it.
    fn found(shares: &[f64]) -> Vec<Option<usize>> {
        let mut guard = StepGuard::default();
        let step = Vec2::new(4e-3, 0.0);
        shares.iter().map(|&share| guard.check(&positions(step, vec![step, step * share]), &[], 4)).collect()
    }

    #[test]
    fn part_that_hardly_moves_four_times_is_found() {
        assert_eq!(found(&[0.0, 0.1, 0.05, 0.0]), [None, None, None, Some(1)]);
        assert_eq!(found(&[0.0, 0.0, 0.0, 0.5, 0.0, 0.0]), [None; 6], "in a row");
        assert_eq!(found(&[0.5, 1.5, 0.3, -1.0]), [None; 4]);
        let (mut guard, step) = (StepGuard::default(), Vec2::new(4e-3, 0.0));
        let sways = [3e-3, -2e-3].map(|sway_m| Vec2::new(0.0, sway_m));
        let glued = sways.map(|sway| guard.check(&positions(step, vec![sway]), &[sway], 2));
        assert_eq!(glued, [None, Some(0)], "it goes with the plate");
    }

    #[test]
    fn pulse_outcome_follows_the_majority_of_parts() {
        let step = Vec2::new(4e-3, 0.0);
        let of = |shares: [f64; 3]| went(&positions(step, shares.map(|share| step * share).to_vec()));
        assert_eq!(
            (of([1.0, 0.9, 0.0]), of([0.0, 0.1, 1.0])),
            (Some(PulseOutcome::AsPlanned), Some(PulseOutcome::Otherwise))
        );
        assert_eq!(of([1.0, 0.7, 1.3]), Some(PulseOutcome::About), "one is near");
        assert_eq!(went(&positions(Vec2::zeros(), vec![step; 3])), None);
        let gliding = went(&positions(step, vec![Vec2::new(6e-3, 3e-3)]));
        assert_eq!(gliding, Some(PulseOutcome::Otherwise), "parts that glide go elsewhere");
    }
}
