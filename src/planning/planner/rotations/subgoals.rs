//! Subgoals of the next sequence, and the clearance that parts keep on their paths there.

use super::motion_set::LibraryMotion;
use crate::planner::corridor::UNSEEN_M;
use crate::planner::{Corridor, Limit, PartState, PlannerParams};
use upm_core::geometry::{Segment, Vec2};

/// Clearance from the edge along the path, m: a pulse's arc bulges past the straight line between its ends.
const EDGE_M: f64 = 2.5e-3;
/// Iterations in which subgoals are pushed apart.
const ROUNDS: usize = 60;
/// Clearance at a subgoal, relative to that along the path.
const SUBGOAL_ROOM: f64 = 1.5;
/// Fractions of the clearance from others and from the edge that a pulse about to be played must still keep.
const PLAYED_GAP: f64 = 0.6;
const PLAYED_EDGE: f64 = 0.5;
/// Share of a corridor's half width that a candidate pulse may take up, for one part and for several: pulses of one
/// part go straight, those of several cross the corridor to and fro.
const STRAIGHT: f64 = 0.5;
const CROSSING: f64 = 1.0;

/// Clearances of parts from each other and from the edge.
#[derive(Clone, Debug)]
pub(super) struct Clearance {
    half_side_m: f64,
    radii_m: Vec<f64>,
    gap_m: f64,
    /// Clearance of each part from the edge, m: less where its target has less.
    edge_m: Vec<f64>,
    corridors: Vec<Option<Corridor>>,
    /// Distance of each part from its line before the first pulse, m.
    off_m: Vec<f64>,
}

/// A limit on the path, and the excess over it, m.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shortfall {
    pub by_m: f64,
    pub limit: Limit,
}

impl Clearance {
    /// Clearances for parts on their paths to `targets_m`.
    pub fn of(parts: &[PartState], targets_m: &[Vec2], params: &PlannerParams, corridors: &[Option<Corridor>]) -> Self {
        let edge_m = |(part, target): (&PartState, &Vec2)| {
            let at_target_m = params.half_side_m - part.radius_m - target.amax();
            EDGE_M.min(at_target_m.max(params.edge_margin_m))
        };
        let off_m = |(corridor, part): (&Option<Corridor>, &PartState)| {
            corridor.as_ref().map_or(0.0, |corridor| corridor.off(part.position_m).norm())
        };
        Self {
            half_side_m: params.half_side_m,
            radii_m: parts.iter().map(|part| part.radius_m).collect(),
            gap_m: params.separation_m,
            edge_m: parts.iter().zip(targets_m).map(edge_m).collect(),
            off_m: corridors.iter().zip(parts).map(off_m).collect(),
            corridors: corridors.to_vec(),
        }
    }

    /// Largest |x| and |y| of part `i`, m.
    pub fn bound_m(&self, i: usize) -> f64 {
        self.half_side_m - self.radii_m[i] - self.edge_m[i]
    }

    /// Least distance of the centres of parts `i` and `j`, m.
    pub fn apart_m(&self, i: usize, j: usize) -> f64 {
        self.radii_m[i] + self.radii_m[j] + self.gap_m
    }

    /// The reduced clearance for a pulse about to be played.
    pub fn for_playing(&self) -> Self {
        let edge_m = self.edge_m.iter().map(|edge_m| PLAYED_EDGE * edge_m).collect();
        Self { gap_m: PLAYED_GAP * self.gap_m, edge_m, ..self.clone() }
    }

    /// Corridors of the parts that have one.
    pub fn corridors(&self) -> impl Iterator<Item = (usize, &Corridor)> {
        self.corridors.iter().enumerate().filter_map(|(i, corridor)| Some((i, corridor.as_ref()?)))
    }

    /// The part that leaves its corridor most at `places_m`, and by how much, m. A part outside before the first pulse
    /// counts only where it goes farther out.
    pub fn corridor_excess(&self, places_m: &[Vec2]) -> Option<(usize, f64)> {
        let excess = |(i, corridor): (usize, &Corridor)| {
            let over_m = corridor.off(places_m[i]).norm() - corridor.half_width_m.max(self.off_m[i]);
            (over_m > UNSEEN_M).then_some((i, over_m))
        };
        self.corridors().filter_map(excess).max_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// True if the course of a pulse of `motion` fits into the corridors, shifted to begin on their lines.
    pub fn holds_course(&self, motion: &LibraryMotion, parts: &[PartState]) -> bool {
        let share = if parts.len() == 1 { STRAIGHT } else { CROSSING };
        self.corridors().all(|(i, corridor)| {
            let from = parts[i].position_m;
            let (shift, end) = (corridor.off(from), motion.carry(from, parts[i].gain).0);
            let fits = |p: Vec2| corridor.off(p - shift).norm() <= share * corridor.half_width_m;
            fits(end) && fits(motion.middle(from, end))
        })
    }

    /// The limit broken most while all parts move straight from `before_m` to `after_m`, in step. A limit that is
    /// broken before counts only where it gets worse.
    pub fn shortfall(&self, before_m: &[Vec2], after_m: &[Vec2]) -> Option<Shortfall> {
        let mut worst: Option<Shortfall> = None;
        let mut note = |by_m: f64, limit: Limit| {
            if by_m > 1e-7 && worst.is_none_or(|worst| by_m > worst.by_m) {
                worst = Some(Shortfall { by_m, limit });
            }
        };
        for (i, (before, after)) in before_m.iter().zip(after_m).enumerate() {
            let bound_m = self.bound_m(i);
            for axis in 0..2 {
                note(after[axis].abs() - bound_m.max(before[axis].abs()), Limit::Edge { part: i });
            }
            for j in 0..i {
                let (from, to) = (before - before_m[j], after - after_m[j]);
                let asked_m = self.apart_m(i, j);
                if from.norm_squared().min(to.norm_squared()) > 4.0 * asked_m * asked_m {
                    continue;
                }
                let least_m = asked_m.min(from.norm());
                note(least_m - Segment { from, to }.distance(Vec2::zeros()), Limit::Separation { parts: [j, i] });
            }
        }
        worst
    }

    /// Moves `places_m` apart and off the edge until they have clearance to spare.
    pub fn spread_out(&self, places_m: &mut [Vec2], targets_m: &[Vec2]) {
        for _ in 0..ROUNDS {
            let mut moved = false;
            for i in 0..places_m.len() {
                for j in 0..i {
                    let between = places_m[i] - places_m[j];
                    let distance_m = between.norm();
                    let room_m = (targets_m[i] - targets_m[j]).norm();
                    let wanted_m = (self.apart_m(i, j) + (SUBGOAL_ROOM - 1.0) * self.gap_m).min(room_m);
                    if distance_m < wanted_m && distance_m > 0.0 {
                        let push = between * (0.5 * (wanted_m - distance_m) / distance_m);
                        places_m[i] += push;
                        places_m[j] -= push;
                        moved = true;
                    }
                }
                let bound_m = (self.bound_m(i) - (SUBGOAL_ROOM - 1.0) * self.edge_m[i]).max(targets_m[i].amax());
                let inside = places_m[i].map(|v| v.clamp(-bound_m, bound_m));
                moved |= inside != places_m[i];
                places_m[i] = inside;
            }
            if !moved {
                break;
            }
        }
    }
}

/// Weight of a broken limit against the distance from the straight path.
const LIMIT: f64 = 20.0;

/// Greedy order: the next pulse is the one after which the parts are nearest to their share of the straight path by
/// `steps_m`; a broken limit costs most.
pub(super) fn order(motions: &[LibraryMotion], parts: &[PartState], steps_m: &[Vec2], room: &Clearance) -> Vec<usize> {
    let start_m: Vec<Vec2> = parts.iter().map(|part| part.position_m).collect();
    let mut at_m = start_m.clone();
    let mut left: Vec<usize> = (0..motions.len()).collect();
    let mut order = Vec::with_capacity(motions.len());
    let mut after_m = at_m.clone();
    while !left.is_empty() {
        let share = (order.len() + 1) as f64 / motions.len() as f64;
        let mut best: Option<(f64, usize, Vec<Vec2>)> = None;
        for (place, &k) in left.iter().enumerate() {
            let mut off = 0.0;
            for (i, part) in parts.iter().enumerate() {
                after_m[i] = motions[k].carry(at_m[i], part.gain).0;
                off += (after_m[i] - start_m[i] - steps_m[i] * share).norm_squared();
            }
            let broken_m = room.shortfall(&at_m, &after_m).map_or(0.0, |shortfall| shortfall.by_m)
                + room.corridor_excess(&after_m).map_or(0.0, |(_, by_m)| by_m);
            let cost = off.sqrt() + LIMIT * broken_m;
            if best.as_ref().is_none_or(|(least, ..)| cost < *least) {
                best = Some((cost, place, after_m.clone()));
            }
        }
        let Some((_, place, after)) = best else { break };
        order.push(left.remove(place));
        at_m = after;
    }
    order
}
