use std::sync::Arc;

use super::disturbance::{ModelDisturbance, normal};
use super::{ClosestApproach, DryRunParams};
use crate::ControlParams;
use crate::pulse_planner::PulsePlanner;
use upm_cor_library::Library;
use upm_core::geometry::{Segment, Vec2};
use upm_core::time::PlateTime;
use upm_planner::{FieldPulse, PartState, PlannedPulse, Rotation};

/// Limit for the deviation of friction, in standard deviations, and its least value relative to the usual one.
const FRICTION_CUT: f64 = 3.0;
const LEAST_FRICTION: f64 = 0.1;

/// Frames captured before the first cycle: one for the table, one to start from.
pub(super) const OPENING_FRAMES: u64 = 2;

/// Number of passes of the overlap resolution: a part that is pushed may touch the next.
const PUSHES: usize = 8;

/// A pulse that ends less than this after a frame ends with that frame, in frames.
const ROUNDING: f64 = 1e-6;

/// Parts on a plate that is reduced to a displacement model.
pub(super) struct KinematicPlate {
    /// Positions of the parts, m.
    pub positions_m: Vec<Vec2>,
    /// Outlines of the parts, m.
    pub radii_m: Vec<f64>,
    /// The least gap so far.
    pub nearest: Option<ClosestApproach>,
    library: Arc<Library>,
    /// Displacement of each part relative to the measured one.
    friction: Vec<f64>,
    disturbance: ModelDisturbance,
    frame_hz: f64,
    frames: u64,
}

impl KinematicPlate {
    /// Parts at their starting positions, each with a drawn friction.
    pub fn new(library: Arc<Library>, params: &ControlParams, dry_run: &DryRunParams) -> Self {
        let DryRunParams { starts_m, frame_hz, .. } = dry_run;
        let disturbance = ModelDisturbance::new(&library, dry_run);
        let mut stage = Self {
            positions_m: starts_m.clone(),
            radii_m: (0..starts_m.len()).map(|part| params.radius_m(part)).collect(),
            nearest: None,
            library,
            friction: friction(dry_run),
            disturbance,
            frame_hz: *frame_hz,
            frames: OPENING_FRAMES,
        };
        stage.note_gaps(&stage.positions_m.clone());
        stage
    }

    /// Plate time of the newest frame.
    pub fn now(&self) -> PlateTime {
        PlateTime::from_secs(self.frames as f64 / self.frame_hz)
    }

    /// Waits for a frame at rest.
    pub fn observe(&mut self) {
        self.frames += 1;
    }

    /// The parts with a gain for each, and no steps.
    pub fn states(&self, gain: impl Fn(usize) -> f64) -> Vec<PartState> {
        let places = self.positions_m.iter().zip(&self.radii_m).enumerate();
        let state = |(part, (&position_m, &radius_m)): (usize, (&Vec2, &f64))| PartState {
            position_m,
            step_m: Vec2::zeros(),
            radius_m,
            gain: gain(part),
        };
        places.map(state).collect()
    }

    /// Plays a pulse to the first frame after its end: parts move as `plans` forecasts them with their own friction, on
    /// a plate that deviates slightly from the commanded motion.
    pub fn play(&mut self, pulse: &PlannedPulse, plans: &dyn PulsePlanner) {
        self.frames += (self.length_s(pulse) * self.frame_hz - ROUNDING).ceil().max(1.0) as u64;
        let before_m = self.positions_m.clone();
        let made = self.disturbance.made(pulse);
        if let Some(after_m) = plans.forecast(&self.states(|part| self.friction[part]), &made) {
            for (at, after) in self.positions_m.iter_mut().zip(after_m) {
                *at = self.disturbance.end_m(&made, *at, after);
            }
        }
        self.note_gaps(&before_m);
        self.push_apart();
    }

    /// Length of a pulse with its rest, s.
    fn length_s(&self, pulse: &PlannedPulse) -> f64 {
        let library = &self.library;
        match pulse {
            PlannedPulse::Rotation(Rotation { sustain_s, rest_s, .. }) => 2.0 * library.attack_s + sustain_s + rest_s,
            PlannedPulse::Field(FieldPulse { sustain_s, .. }) => {
                library.fields.as_ref().map_or(0.0, |fields| 2.0 * fields.attack_s + fields.rest_s) + sustain_s
            }
        }
    }

    /// Separates overlapping parts; each moves by half the overlap.
    fn push_apart(&mut self) {
        for _ in 0..PUSHES {
            let mut pushed = false;
            for i in 0..self.positions_m.len() {
                for j in i + 1..self.positions_m.len() {
                    let apart = self.positions_m[j] - self.positions_m[i];
                    let overlap_m = self.radii_m[i] + self.radii_m[j] - apart.norm();
                    if overlap_m > 0.0 {
                        let way = 0.5 * overlap_m * apart.try_normalize(0.0).unwrap_or_else(Vec2::x);
                        self.positions_m[i] -= way;
                        self.positions_m[j] += way;
                        pushed = true;
                    }
                }
            }
            if !pushed {
                return;
            }
        }
    }

    /// Records the least gap while all parts move straight and in step from `before_m` to their present positions.
    fn note_gaps(&mut self, before_m: &[Vec2]) {
        let at_s = self.now().secs();
        for i in 0..self.positions_m.len() {
            for j in i + 1..self.positions_m.len() {
                let apart = Segment { from: before_m[i] - before_m[j], to: self.positions_m[i] - self.positions_m[j] };
                let gap_m = apart.distance(Vec2::zeros()) - self.radii_m[i] - self.radii_m[j];
                if self.nearest.is_none_or(|nearest| gap_m < nearest.gap_m) {
                    self.nearest = Some(ClosestApproach { gap_m, parts: [i, j], at_s });
                }
            }
        }
    }
}

/// Displacement of each part relative to the measured one. Pairs of opposite draws keep the mean of a few dry runs
/// near the mean of all.
pub(super) fn friction(dry_run: &DryRunParams) -> Vec<f64> {
    let DryRunParams { starts_m, friction_spread, streams, number, .. } = dry_run;
    // the name of the stream seeds its numbers: with another name, all forecasts change
    let mut draws = streams.numbered("rehearsal friction", number.div_ceil(2));
    let sign = match number {
        0 => 0.0,
        number if number % 2 == 1 => 1.0,
        _ => -1.0,
    };
    let draw = |_: &Vec2| sign * friction_spread * normal(&mut draws).clamp(-FRICTION_CUT, FRICTION_CUT);
    starts_m.iter().map(draw).map(|off| (1.0 + off).max(LEAST_FRICTION)).collect()
}
