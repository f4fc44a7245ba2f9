//! In which order the pulses go, and what becomes of the parts after each.

use super::field::{Belt, Columns, reference_speed};
use super::limits::Clearances;
use super::{Limit, PartState, Rotation};
use upm_core::geometry::Vec2;
use upm_library::Library;

/// Orders tried before giving up, counted in pulses simulated.
const MAX_TRIALS: usize = 400;

/// Pulses in the order they are played and where the parts are after each.
#[derive(Clone, Debug, Default)]
pub(super) struct Sequence {
    /// First to last.
    pub pulses: Vec<Rotation>,
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

    /// Where parts at `positions_m` are after `pulse`.
    pub fn after(&self, pulse: &Rotation, positions_m: &[Vec2]) -> Vec<Vec2> {
        let reverse = if pulse.distance_m < 0.0 { -1.0 } else { 1.0 };
        let belt = Belt::at(&self.library.displacement, pulse.sustain_s);
        let Some(entry) = self.library.entries.get(pulse.entry) else { return positions_m.to_vec() };
        let moved = |(part, &p): (&PartState, &Vec2)| {
            let velocity_mps = entry.pump.velocity_at(p);
            let speed_mps = velocity_mps.norm();
            if speed_mps == 0.0 {
                return p;
            }
            let way_m = reverse * part.gain * belt.distance(speed_mps);
            let tangent = velocity_mps / speed_mps;
            p + round_the_center(tangent * way_m, way_m * entry.pump.spin_radps / speed_mps, speed_mps)
        };
        self.parts.iter().zip(positions_m).map(moved).collect()
    }
}

/// The step of a part that sets out along `step_m` and turns by `angle_rad` about the centre of rotation: along its circle,
/// thrown outwards by `g (D/r)²` of the radius as it goes. A part without friction under a force that turns with it
/// would have g = 1/3; on slow belts the pump damps it. Measured on the simulated plate for radii from 10 to 250 mm, g =
/// 0.22 s/m times the belt's speed, 0.17 at most.
fn round_the_center(step_m: Vec2, angle_rad: f64, speed_mps: f64) -> Vec2 {
    if angle_rad.abs() < 1e-6 {
        return step_m;
    }
    let growth = 1.0 + (0.22 * speed_mps).min(0.17) * angle_rad * angle_rad;
    // with the centre at the origin the part starts at `out`: the step turned back by a quarter, a radius long
    let out = Vec2::new(step_m.y, -step_m.x) / angle_rad;
    let (sin, cos) = angle_rad.sin_cos();
    Vec2::new(cos * out.x - sin * out.y, sin * out.x + cos * out.y) * growth - out
}

/// Where parts at `positions_m` are after these `(entry, distance_m)`, limits or not.
pub(super) fn end_of(flow: Flow<'_>, positions_m: &[Vec2], pulses: impl Iterator<Item = (usize, f64)>) -> Vec<Vec2> {
    pulses.fold(positions_m.to_vec(), |positions, (entry, distance_m)| {
        let sustain_s = flow.sustain(entry, distance_m, &positions);
        flow.after(&Rotation { entry, distance_m, sustain_s }, &positions)
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
            let pulse = Rotation { entry, distance_m, sustain_s: self.flow.sustain(entry, distance_m, positions_m) };
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
    use crate::fixture::{HALF_SIDE_M, PENNY_M, library, params, penny};
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
        fn a_slow_belt_carries_round_its_center_and_back(
            x in -0.06..0.06f64, y in -0.06..0.06f64, entry in 0usize..289, sustain_s in 0.0..0.05f64,
        ) {
            let mut library = (*library()).clone();
            library.entries[entry].pump = library.entries[entry].pump * 0.02;
            let (start, center) = (Vec2::new(x, y), library.entries[entry].center_m().unwrap());
            let parts = [penny(start, Vec2::zeros())];
            let flow = Flow { library: &library, parts: &parts };
            let radius = (start - center).norm();
            prop_assume!(radius > 0.02);
            prop_assume!(library.displacement_at(entry, start, sustain_s).norm() > 1e-4);
            let there = Rotation { entry, distance_m: 0.01, sustain_s };
            let end = flow.after(&there, &[start])[0];
            let way = (end - start).norm();
            prop_assert!(((end - center).norm() - radius).abs() < 0.01 * way, "{} {radius}", (end - center).norm());
            let back = flow.after(&Rotation { distance_m: -0.01, ..there }, &[end])[0];
            prop_assert!((back - start).norm() < 0.02 * way);
        }

        #[test]
        fn steps_round_a_center_are_rotations_that_grow(x in 0.01..0.3f64, angle in -1.0..1.0f64, speed in 0.0..2.0f64) {
            // a part at (x, 0) from its centre sets out along ± y
            let step = round_the_center(Vec2::new(0.0, x * angle), angle, speed);
            let end = Vec2::new(x, 0.0) + step;
            let growth = 1.0 + (0.22 * speed).min(0.17) * angle * angle;
            prop_assert!((end - Vec2::new(angle.cos(), angle.sin()) * x * growth).norm() < 1e-9);
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
