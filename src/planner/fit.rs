//! How far each pulse of a chosen few should go: first on the straight field, then where the sequence really ends.

use super::Planner;
use super::field::{Columns, push_column, reference_speed};
use super::program::{self, Variable};
use super::sequence::{Sequence, arrange, balanced_order, end_of};
use super::task::Task;
use upm_core::geometry::Vec2;

/// Most corrections of a sequence, and the part of the largest step below which its error is left as it is.
const NEWTON_STEPS: usize = 3;
const GOOD_ENOUGH: f64 = 0.05;

/// A distance of at least this part of the shortest pulse is rounded up to it.
const NEARLY: f64 = 0.8;

/// Price of a metre of the way back of a pair, m: a trace, so that pairs stay short.
const BACK_M: f64 = 1e-6;

/// Change of a distance that shows its effect, m.
const NUDGE_M: f64 = 1e-5;

impl Planner {
    /// Smallest and largest |d| of an entry with parts where they are, m.
    pub(super) fn distance_bounds_m(&self, entry: usize, positions_m: &[Vec2]) -> (f64, f64) {
        let model = &self.library.displacement;
        let speed = self.reference_speed_mps(entry, positions_m);
        let high_m = self.params.max_distance_m.min(model.max_distance(speed));
        (self.params.min_distance_m.max(model.min_distance(speed)).min(high_m), high_m)
    }

    /// Speed of the belt under the part on the fastest one, m/s; 0 when there is no such entry.
    pub(super) fn reference_speed_mps(&self, entry: usize, positions_m: &[Vec2]) -> f64 {
        self.library.entries.get(entry).map_or(0.0, |e| reference_speed(e, positions_m.iter().copied()))
    }

    /// Distances for `support`, signs kept, with columns at each entry's own sustain, by the program without a price;
    /// in a balanced order.
    pub(super) fn fitted(
        &self,
        task: &Task<'_>,
        wanted: &[f64],
        support: &[(usize, f64)],
    ) -> Option<Vec<(usize, f64)>> {
        let mut columns = Columns::default();
        columns.clear(wanted.len());
        let mut variables = Vec::with_capacity(support.len());
        let model = &self.library.displacement;
        let mut entries = Vec::with_capacity(support.len());
        for (entry, distance_m) in self.playable(support, &task.positions_m) {
            let sustain_s = self.flow(task).sustain(entry, distance_m, &task.positions_m);
            let positions = task.positions_m.iter().copied();
            push_column(&mut columns, self.library.entries.get(entry)?, task.parts, positions, |speed| {
                model.distance(speed, sustain_s)
            });
            let back = support.iter().any(|&(other, d)| other == entry && d.signum() != distance_m.signum());
            let cost_m = if back { BACK_M } else { 0.0 };
            variables.push(Variable { cost_m, ..self.one_signed(entry, distance_m, &task.positions_m) });
            entries.push(entry);
        }
        if variables.is_empty() {
            return None;
        }
        let fitted = program::solve(&columns, &variables, &[], wanted, &task.half_spaces).ok()?.distance_m;
        let order = balanced_order(&columns, &fitted);
        Some(order.into_iter().map(|j| (entries[j], fitted[j])).collect())
    }

    /// `support` as pulses that can be played: a distance shorter than the entry's shortest pulse becomes that of two
    /// pulses, there and not all the way back.
    fn playable(&self, support: &[(usize, f64)], positions_m: &[Vec2]) -> Vec<(usize, f64)> {
        let mut pulses = Vec::with_capacity(2 * support.len());
        for (k, &(entry, distance_m)) in support.iter().enumerate() {
            let (low_m, high_m) = self.distance_bounds_m(entry, positions_m);
            let others = support.len() - k - 1;
            let room = pulses.len() + 1 + others < self.params.max_pulses;
            if distance_m.abs() < NEARLY * low_m && 2.0 * low_m <= high_m && room {
                let back_m = low_m.copysign(-distance_m);
                pulses.extend([(entry, distance_m - back_m), (entry, back_m)]);
            } else {
                pulses.push((entry, distance_m.abs().max(low_m).copysign(distance_m)));
            }
        }
        pulses
    }

    fn one_signed(&self, entry: usize, distance_m: f64, positions_m: &[Vec2]) -> Variable {
        let (low_m, high_m) = self.distance_bounds_m(entry, positions_m);
        if distance_m < 0.0 {
            Variable { cost_m: 0.0, low_m: -high_m, high_m: -low_m }
        } else {
            Variable { cost_m: 0.0, low_m, high_m }
        }
    }

    /// The same sequence with its distances corrected for what the straight field leaves out: Newton steps on where the
    /// sequence really ends, each taken when it ends nearer and keeps the limits.
    pub(super) fn refined(&self, task: &Task<'_>, wanted: &[f64], mut sequence: Sequence) -> Sequence {
        let mut error_m = task.error_m(wanted, sequence.predicted_m.last());
        for _ in 0..NEWTON_STEPS {
            if error_m < GOOD_ENOUGH * task.largest_m {
                break;
            }
            let Some(pulses) = self.newton_step(task, wanted, &sequence) else { break };
            let Ok(next) = arrange(self.flow(task), &task.clearances, &pulses) else { break };
            let next_error_m = task.error_m(wanted, next.predicted_m.last());
            if next_error_m >= error_m {
                break;
            }
            (sequence, error_m) = (next, next_error_m);
        }
        sequence
    }

    fn newton_step(&self, task: &Task<'_>, wanted: &[f64], sequence: &Sequence) -> Option<Vec<(usize, f64)>> {
        let pulses: Vec<(usize, f64)> = sequence.pulses.iter().map(|p| (p.entry, p.distance_m)).collect();
        let ends = task.steps_to(sequence.predicted_m.last()?);
        let mut jacobian = Columns::default();
        jacobian.clear(wanted.len());
        let mut offset = ends.clone();
        for (k, &(entry, distance_m)) in pulses.iter().enumerate() {
            let before = if k == 0 { &task.positions_m } else { &sequence.predicted_m[k - 1] };
            let changed = std::iter::once((entry, distance_m + NUDGE_M.copysign(distance_m)));
            let rest = changed.chain(pulses[k + 1..].iter().copied());
            let moved = task.steps_to(&end_of(self.flow(task), before, rest));
            let per_metre = 1.0 / NUDGE_M.copysign(distance_m);
            jacobian.push(moved.iter().zip(&ends).map(|(m, e)| (m - e) * per_metre));
            offset.iter_mut().zip(jacobian.column(k)).for_each(|(o, slope)| *o -= slope * distance_m);
        }
        let variables: Vec<Variable> =
            pulses.iter().map(|&(entry, d)| self.one_signed(entry, d, &task.positions_m)).collect();
        let fitted = program::solve(&jacobian, &variables, &offset, wanted, &task.half_spaces).ok()?;
        Some(pulses.iter().zip(fitted.distance_m).map(|(&(entry, _), d)| (entry, d)).collect())
    }
}
