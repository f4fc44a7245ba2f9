//! A motion with its tables, as strong as motors and travel allow.

use super::model::MovingModel;
use crate::planner::fields::harmonic_basis::{HarmonicBasis, PlateInstant};
use upm_core::geometry::{Vec2, perp};
use upm_core::signal::MOTORS;

/// Share of the motors' limit that a steady motion fills; the rest is for the cross-fade to the next one.
const STEADY: f64 = 0.9;

/// Largest displacement of the plate at a voice coil, m: half the stroke of coils of this force.
const STROKE_M: f64 = 6e-3;
/// Share of its radius that the centre of a part stays from the edge of the shaken plate.
const KEPT: f64 = 0.5;
/// Least room to swing beside a part, m: with less, a part at the edge could not be moved away from it.
const LEAST_ROOM_M: f64 = 2e-3;

/// A part beside the edge of the plate.
#[derive(Clone, Copy, Debug)]
pub(super) struct NearEdge {
    place_m: Vec2,
    /// Unit vector away from the edge.
    inwards: Vec2,
    /// Distance by which the edge may come nearer, m.
    room_m: f64,
}

impl NearEdge {
    /// The sides of a plate beside a part of `radius_m` at `place_m` that no allowed motion could pull from under it.
    pub fn of(place_m: Vec2, radius_m: f64, half_side_m: f64) -> impl Iterator<Item = Self> {
        (0..2).filter_map(move |axis| {
            let room_m = (half_side_m - place_m[axis].abs() - KEPT * radius_m).max(LEAST_ROOM_M);
            let mut inwards = Vec2::zeros();
            inwards[axis] = -place_m[axis].signum();
            // a turn by the whole stroke moves a corner by twice as much or so
            (room_m < 3.0 * STROKE_M).then_some(Self { place_m, inwards, room_m })
        })
    }
}

/// A motion of one period.
#[derive(Clone, Debug)]
pub(super) struct Motion {
    pub coefficients: Vec<f64>,
    /// The plate in every phase of the period.
    pub plate: Vec<PlateInstant>,
    /// Counts in every phase: steady ones, and shares of the envelope's slope and curvature.
    counts: Vec<[[f64; MOTORS]; 3]>,
}

impl Motion {
    /// The plate at rest.
    pub fn rest(basis: &HarmonicBasis) -> Self {
        Self {
            coefficients: vec![0.0; basis.len()],
            plate: vec![PlateInstant::default(); basis.samples],
            counts: vec![[[0.0; MOTORS]; 3]; basis.samples],
        }
    }

    /// The motion `coefficients`, as strong as the limits allow where it asks for more than `least` of them, or as near
    /// to it as the change from `last` permits.
    pub fn scaled(model: &MovingModel, edges: &[NearEdge], coefficients: &[f64], last: &Self, least: f64) -> Self {
        let mut motion = Self {
            coefficients: coefficients.to_vec(),
            plate: model.basis.motion(coefficients),
            counts: model.effort.counts(&model.basis, coefficients),
        };
        let load = motion.load(model, edges);
        if load > least {
            motion.blend(0.0, load.recip(), last);
        }
        let share = motion.share_after(last, model);
        if share < 1.0 {
            motion.blend(1.0 - share, share, last);
        }
        motion
    }

    /// The largest ratio of what the motion and its fade-out ask for to what is allowed.
    fn load(&self, model: &MovingModel, edges: &[NearEdge]) -> f64 {
        let stroke = |plate: &PlateInstant| plate.offset_m.amax() + plate.turn_rad.abs() * model.lever_arm_m;
        let stroke_m = self.plate.iter().map(stroke).fold(0.0, f64::max);
        let edge = |edge: &NearEdge| {
            let inwards = self.plate.iter().map(|plate| {
                let swing_m = plate.offset_m + perp(edge.place_m) * plate.turn_rad;
                swing_m.dot(&edge.inwards)
            });
            inwards.fold(0.0, f64::max) / edge.room_m
        };
        let edges = edges.iter().map(edge).fold(0.0, f64::max);
        let counts = self.counts.iter().zip(&model.flank).flat_map(|([f, g, c], [height, slope, curvature])| {
            (0..MOTORS).map(move |i| {
                let fading = (1.0 - height) * f[i] - slope * g[i] - curvature * c[i];
                (f[i] / STEADY).abs().max(fading.abs())
            })
        });
        (stroke_m / STROKE_M).max(edges).max(counts.fold(0.0, f64::max) / model.effort.limit_counts)
    }

    /// The largest share of the change from `last` to this motion that the motors can play, 0 to 1.
    fn share_after(&self, last: &Self, model: &MovingModel) -> f64 {
        let (mut share, limit) = (1.0f64, model.effort.limit_counts);
        for ((to, from), [height, slope, curvature]) in self.counts.iter().zip(&last.counts).zip(&model.flank) {
            for i in 0..MOTORS {
                let change = [0, 1, 2].map(|part| to[part][i] - from[part][i]);
                let change = height * change[0] + slope * change[1] + curvature * change[2];
                let room = if change > 0.0 { limit - from[0][i] } else { limit + from[0][i] };
                if share * change.abs() > room {
                    share = (room / change.abs()).max(0.0);
                }
            }
        }
        share
    }

    /// `of_last` times `last` and `of_this` times this motion.
    fn blend(&mut self, of_last: f64, of_this: f64, last: &Self) {
        let mixed = |this: &mut f64, last: f64| *this = of_last * last + of_this * *this;
        self.coefficients.iter_mut().zip(&last.coefficients).for_each(|(this, last)| mixed(this, *last));
        for (this, last) in self.plate.iter_mut().zip(&last.plate) {
            *this = this.shaped(of_this, 0.0).plus(&last.shaped(of_last, 0.0));
        }
        for (this, last) in self.counts.iter_mut().flatten().flatten().zip(last.counts.iter().flatten().flatten()) {
            mixed(this, *last);
        }
    }
}
