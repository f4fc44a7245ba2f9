//! In which order the pulses go, and what becomes of the parts after each.

use super::field::{Belt, Columns, reference_speed};
use super::limits::Clearances;
use super::{Limit, PartState, PlannedPulse};
use crate::geometry::Vec2;
use crate::library::Library;

/// Orders tried before giving up, counted in pulses simulated.
const MAX_TRIALS: usize = 120;

/// Times a step is looked up anew where it was half way.
const HALF_WAYS: usize = 3;

/// Pulses in the order they are played and where the parts are after each.
#[derive(Clone, Debug, Default)]
pub(super) struct Sequence {
    /// First to last.
    pub pulses: Vec<PlannedPulse>,
    /// `predicted_m[pulse][part]`.
    pub predicted_m: Vec<Vec<Vec2>>,
}

/// What moves parts, as measured.
#[derive(Clone, Copy, Debug)]
pub(super) struct Flow<'a> {
    /// Motions and distances.
    pub library: &'a Library,
    /// The parts, for their gains.
    pub parts: &'a [PartState],
}

impl Flow<'_> {
    /// The sustain at which the part on the fastest belt goes `|distance_m|`, or the nearest that was measured, s.
    pub fn sustain(&self, entry: usize, distance_m: f64, positions_m: &[Vec2]) -> f64 {
        let model = &self.library.displacement;
        let speed = self.library.entries.get(entry).map_or(0.0, |e| reference_speed(e, positions_m.iter().copied()));
        model.sustain_for(speed, distance_m.abs()).unwrap_or_else(|| {
            let short = distance_m.abs() < model.min_distance(speed);
            let end = if short { model.sustain_s.first() } else { model.sustain_s.last() };
            end.copied().unwrap_or(0.0)
        })
    }

    /// Where parts at `positions_m` are after `pulse`: each a straight step along the flow half way, which for a rotation
    /// keeps it on its circle. Calibration measures distances along the flow half way, too.
    pub fn after(&self, pulse: &PlannedPulse, positions_m: &[Vec2]) -> Vec<Vec2> {
        let reverse = if pulse.distance_m < 0.0 { -1.0 } else { 1.0 };
        let belt = Belt::at(&self.library.displacement, pulse.sustain_s);
        let Some(entry) = self.library.entries.get(pulse.entry) else { return positions_m.to_vec() };
        let moved = |(part, &p): (&PartState, &Vec2)| {
            let step = |at: Vec2| {
                let velocity_mps = entry.pump.velocity_at(at);
                let speed_mps = velocity_mps.norm();
                let per_speed = if speed_mps > 0.0 { belt.distance(speed_mps) / speed_mps } else { 0.0 };
                velocity_mps * (reverse * part.gain * per_speed)
            };
            p + (0..HALF_WAYS).fold(step(p), |found, _| step(p + 0.5 * found))
        };
        self.parts.iter().zip(positions_m).map(moved).collect()
    }
}

/// Where parts at `positions_m` are after these `(entry, distance_m)`, limits or not.
pub(super) fn end_of(flow: Flow<'_>, positions_m: &[Vec2], pulses: impl Iterator<Item = (usize, f64)>) -> Vec<Vec2> {
    pulses.fold(positions_m.to_vec(), |positions, (entry, distance_m)| {
        let sustain_s = flow.sustain(entry, distance_m, &positions);
        flow.after(&PlannedPulse { entry, distance_m, sustain_s }, &positions)
    })
}

/// An order in which the parts stay near the straight way to their ends: each next pulse is the one after
/// which the sum so far is nearest to its share of the whole. `columns` belong to `distances_m`, one by one.
pub(super) fn balanced_order(columns: &Columns, distances_m: &[f64]) -> Vec<usize> {
    let moved = |j: usize| columns.column(j).iter().map(move |flow| flow * distances_m[j]);
    let mut whole = vec![0.0; columns.column(0).len()];
    for j in 0..columns.len() {
        whole.iter_mut().zip(moved(j)).for_each(|(sum, step)| *sum += step);
    }
    let mut so_far = vec![0.0; whole.len()];
    let mut left: Vec<usize> = (0..columns.len()).collect();
    let mut order = Vec::with_capacity(left.len());
    while !left.is_empty() {
        let share = (order.len() + 1) as f64 / columns.len() as f64;
        let off = |j: usize| -> f64 {
            so_far.iter().zip(&whole).zip(moved(j)).map(|((s, w), step)| (s + step - share * w).powi(2)).sum()
        };
        let nearest = left.iter().enumerate().map(|(place, &j)| (off(j), place));
        let Some((_, place)) = nearest.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))) else { break };
        let j = left.remove(place);
        so_far.iter_mut().zip(moved(j)).for_each(|(sum, step)| *sum += step);
        order.push(j);
    }
    order
}

/// Finds an order of `(entry, distance_m)` in which nothing breaks a limit on the way: depth first, the given
/// order first, back one pulse where it does not go on. `Err` has the limit at the farthest point reached.
pub(super) fn arrange(
    flow: Flow<'_>,
    clearances: &Clearances,
    pulses: &[(usize, f64)],
) -> Result<Sequence, Option<Limit>> {
    let start: Vec<Vec2> = flow.parts.iter().map(|part| part.position_m).collect();
    let mut search = Search { flow, clearances, pulses, trials: 0, farthest: 0, stopped_by: None };
    let mut sequence = Sequence::default();
    let mut used = vec![false; pulses.len()];
    if search.extend(&start, &mut used, &mut sequence) { Ok(sequence) } else { Err(search.stopped_by) }
}

struct Search<'a> {
    flow: Flow<'a>,
    clearances: &'a Clearances,
    pulses: &'a [(usize, f64)],
    trials: usize,
    farthest: usize,
    stopped_by: Option<Limit>,
}

impl Search<'_> {
    fn extend(&mut self, positions_m: &[Vec2], used: &mut [bool], sequence: &mut Sequence) -> bool {
        if sequence.pulses.len() == self.pulses.len() {
            return true;
        }
        for j in 0..self.pulses.len() {
            if used[j] || self.trials >= MAX_TRIALS {
                continue;
            }
            self.trials += 1;
            let (entry, distance_m) = self.pulses[j];
            let pulse =
                PlannedPulse { entry, distance_m, sustain_s: self.flow.sustain(entry, distance_m, positions_m) };
            let after = self.flow.after(&pulse, positions_m);
            if let Some(limit) = self.clearances.broken_by(positions_m, &after) {
                if self.stopped_by.is_none() || sequence.pulses.len() > self.farthest {
                    (self.farthest, self.stopped_by) = (sequence.pulses.len(), Some(limit));
                }
                continue;
            }
            used[j] = true;
            sequence.pulses.push(pulse);
            sequence.predicted_m.push(after.clone());
            if self.extend(&after, used, sequence) {
                return true;
            }
            used[j] = false;
            sequence.pulses.pop();
            sequence.predicted_m.pop();
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planner::fixture::{HALF_SIDE_M, PENNY_M, library, params, penny};
    use proptest::prelude::*;

    /// Entry of the fixture that carries everything along +x.
    const ALONG_X: usize = 289;

    #[test]
    fn turns_the_order_round_at_the_edge() {
        let edge = HALF_SIDE_M - PENNY_M - 0.002;
        let (library, parts) = (library(), [penny(Vec2::new(edge, 0.0), Vec2::zeros())]);
        let flow = Flow { library: &library, parts: &parts };
        let clearances = Clearances::of(&parts, &params());
        let found = arrange(flow, &clearances, &[(ALONG_X, 0.006), (ALONG_X, -0.006)]).unwrap();
        assert!(found.pulses[0].distance_m < 0.0, "inwards first");
        assert!((found.predicted_m[1][0].x - edge).abs() < 1e-6);
        let out = arrange(flow, &clearances, &[(ALONG_X, 0.006), (ALONG_X, -0.002)]);
        assert_eq!(out.unwrap_err(), Some(Limit::Edge { part: 0 }));
    }

    proptest! {
        #[test]
        fn a_rotation_keeps_a_part_on_its_circle_and_brings_it_back(
            x in -0.06..0.06f64, y in -0.06..0.06f64, entry in 0usize..289, sustain_s in 0.02..0.2f64,
        ) {
            let (library, start) = (library(), Vec2::new(x, y));
            let parts = [penny(start, Vec2::zeros())];
            let flow = Flow { library: &library, parts: &parts };
            let center = library.entries[entry].center_m().unwrap();
            let radius = (start - center).norm();
            prop_assume!(radius > 0.02);
            let there = PlannedPulse { entry, distance_m: 0.01, sustain_s };
            let end = flow.after(&there, &[start])[0];
            let way = (end - start).norm();
            prop_assume!(way < 0.5 * radius);
            prop_assert!(((end - center).norm() - radius).abs() < 0.01 * way, "{} {radius}", (end - center).norm());
            let back = flow.after(&PlannedPulse { distance_m: -0.01, ..there }, &[end])[0];
            prop_assert!((back - start).norm() < 0.01 * way);
        }
    }

    #[test]
    fn parts_do_not_pass_through_each_other() {
        let (library, gap) = (library(), 2.0 * PENNY_M + 0.004);
        let faster = PartState { gain: 3.0, ..penny(Vec2::zeros(), Vec2::zeros()) };
        let parts = [faster, penny(Vec2::new(gap, 0.0), Vec2::zeros())];
        let flow = Flow { library: &library, parts: &parts };
        let clearances = Clearances::of(&parts, &params());
        assert!(arrange(flow, &clearances, &[(ALONG_X, 0.001)]).is_ok());
        let through = arrange(flow, &clearances, &[(ALONG_X, 0.02)]);
        assert_eq!(through.unwrap_err(), Some(Limit::Separation { parts: [0, 1] }), "even if it ends beyond");
    }

    #[test]
    fn a_balanced_order_goes_to_and_fro() {
        let mut columns = Columns::default();
        columns.clear(1);
        columns.push([1.0; 4].into_iter());
        let order = balanced_order(&columns, &[3.0, 3.0, -3.0, -3.0]);
        let mut at = 0.0f64;
        for j in order {
            at += [3.0, 3.0, -3.0, -3.0][j];
            assert!(at.abs() <= 3.0);
        }
    }
}
