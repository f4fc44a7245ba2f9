use upm_core::geometry::Vec2;
use upm_core::job::Finding;

/// Forecast steps below this are no evidence, m: among many parts forecasts of synthesised fields are off by up to 1
/// mm.
const SHORTEST_M: f64 = 2e-3;
/// The same among more than eight parts: one motion for 24 parts leaves some of them in place during five pulses that
/// should carry them by up to 2.4 mm.
const SHORTEST_OF_MANY_M: f64 = 3e-3;
const MANY: usize = 8;
/// A part that moves less than this share of its forecast step hardly moves.
const STUCK: f64 = 0.2;
/// Least share of the forecast step along it, and largest across it, with which a part moved as forecast.
const AS_FORECAST: f64 = 0.5;
/// Largest deviation from the forecast place with which a part is there: m, plus this share of its step.
const NEAR_M: f64 = 5e-4;
const NEAR_OF_STEP: f64 = 0.15;

/// Compares the measured step of each part with its forecast.
#[derive(Clone, Debug)]
pub struct StepGuard {
    in_a_row: u32,
    /// For each part, the steps in a row in which it hardly moved, and in which it went the other way.
    missed: Vec<[u32; 2]>,
    /// Steps that were compared, and those that missed their forecast.
    pub compared: [u64; 2],
}

impl StepGuard {
    /// A guard for which so many steps of a part in a row make a finding.
    pub fn new(in_a_row: u32) -> Self {
        Self { in_a_row, missed: Vec::new(), compared: [0; 2] }
    }

    /// Takes the steps of one pulse. Returns the first part that has missed its forecasts too often in a row, and
    /// whether it hardly moves or moves against them.
    pub fn check(&mut self, before_m: &[Vec2], forecast_m: &[Vec2], after_m: &[Vec2]) -> Option<(usize, Finding)> {
        self.missed.resize(before_m.len(), [0; 2]);
        let shortest_m = if before_m.len() > MANY { SHORTEST_OF_MANY_M } else { SHORTEST_M };
        let mut found = None;
        for (part, ((wanted, went), missed)) in steps(before_m, forecast_m, after_m).zip(&mut self.missed).enumerate() {
            let length_m = wanted.norm();
            if length_m < shortest_m {
                continue;
            }
            let along = went.dot(&wanted) / (length_m * length_m);
            let misses = [went.norm() < STUCK * length_m, along < -STUCK];
            let in_a_row = [0, 1].map(|kind| if misses[kind] { missed[kind] + 1 } else { 0 });
            *missed = in_a_row;
            self.compared[0] += 1;
            self.compared[1] += u64::from(misses.contains(&true));
            let [is_stuck, is_astray] = in_a_row.map(|steps| steps >= self.in_a_row);
            let unlike = if is_astray { Some(Finding::PartAstray) } else { is_stuck.then_some(Finding::PartStuck) };
            found = found.or(unlike.map(|unlike| (part, unlike)));
        }
        found
    }
}

/// The step of each part, as forecast and as measured.
fn steps(before_m: &[Vec2], forecast_m: &[Vec2], after_m: &[Vec2]) -> impl Iterator<Item = (Vec2, Vec2)> {
    before_m.iter().zip(forecast_m).zip(after_m).map(|((before, forecast), after)| (forecast - before, after - before))
}

/// Where most parts with a forecast displacement ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PulseOutcome {
    /// At the forecast places, within the accuracy of forecasts for a plate that moves as planned.
    There,
    /// Near them, as on a plate that moves slightly off its plan.
    About,
    /// At neither, such as parts that stayed or slid on.
    Elsewhere,
}

/// Verdict on most parts in a pulse; `None` when no part should move far enough to judge.
pub fn went(before_m: &[Vec2], forecast_m: &[Vec2], after_m: &[Vec2]) -> Option<PulseOutcome> {
    let steps = steps(before_m, forecast_m, after_m);
    let far: Vec<(Vec2, Vec2)> = steps.filter(|(wanted, _)| wanted.norm() >= SHORTEST_M).collect();
    let most = |count: usize| 2 * count > far.len();
    let is_about = |(wanted, went): &(Vec2, Vec2)| {
        let along = went.dot(wanted) / wanted.norm_squared();
        let across = (went - wanted * along).norm() / wanted.norm();
        along > AS_FORECAST && along < 1.0 / AS_FORECAST && across < AS_FORECAST
    };
    let is_there = |(wanted, went): &(Vec2, Vec2)| (went - wanted).norm() < NEAR_M + NEAR_OF_STEP * wanted.norm();
    let about = far.iter().filter(|step| is_about(step)).count();
    let there = far.iter().filter(|step| is_about(step) && is_there(step)).count();
    match far.len() {
        0 => None,
        _ if most(there) => Some(PulseOutcome::There),
        _ if most(about) => Some(PulseOutcome::About),
        _ => Some(PulseOutcome::Elsewhere),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Findings in each of several pulses that should carry two parts 4 mm along x; the second moves `share` of it.
    fn found(shares: &[f64]) -> Vec<Option<(usize, Finding)>> {
        let (mut guard, start) = (StepGuard::new(4), [Vec2::zeros(); 2]);
        let step = Vec2::new(4e-3, 0.0);
        shares.iter().map(|&share| guard.check(&start, &[step; 2], &[step, step * share])).collect()
    }

    #[test]
    fn part_that_goes_unlike_its_forecast_four_times_is_found() {
        assert_eq!(found(&[0.0, 0.1, 0.05, 0.0]), [None, None, None, Some((1, Finding::PartStuck))]);
        assert_eq!(found(&[-1.0, -0.5, -0.3, -0.4])[3], Some((1, Finding::PartAstray)));
        assert_eq!(found(&[0.0, 0.0, 0.0, 0.5, 0.0, 0.0]), [None; 6], "in a row");
        assert_eq!(found(&[0.5, 1.5, 0.3, 1.0]), [None; 4]);
    }

    #[test]
    fn pulse_outcome_follows_the_majority_of_parts() {
        let (start, step) = ([Vec2::zeros(); 3], Vec2::new(4e-3, 0.0));
        let of = |shares: [f64; 3]| went(&start, &[step; 3], &shares.map(|share| step * share));
        assert_eq!(
            (of([1.0, 0.9, 0.0]), of([0.0, 0.1, 1.0])),
            (Some(PulseOutcome::There), Some(PulseOutcome::Elsewhere))
        );
        assert_eq!(of([1.0, 0.7, 1.3]), Some(PulseOutcome::About), "one is near");
        assert_eq!(went(&start, &start, &start), None);
        let gliding = Vec2::new(6e-3, 3e-3);
        assert_eq!(
            went(&start[..1], &[step], &[gliding]),
            Some(PulseOutcome::Elsewhere),
            "parts that glide go elsewhere"
        );
    }
}
