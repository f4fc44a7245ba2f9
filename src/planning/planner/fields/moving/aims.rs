//! Where moving parts should be heading: velocities that bring all of them home at the same time and keep them apart.

use crate::planner::PlannerParams;
use crate::planner::fields::rollout::RolloutDisc;
use nalgebra::DVector;
use upm_core::geometry::Vec2;
use upm_core::units::GRAVITY_MPS2;

/// Largest speed with which parts approach each other or the edge, per distance left, 1/s.
pub(super) const CLOSING_PER_S: f64 = 5.0;
/// Distance beyond the configured ones at which wishes begin to keep clear, m: the forecast's error in a segment. Two
/// parts that come to rest nearer to each other keep as clear as their targets: dense rows would be pushed apart.
const SPARE_M: f64 = 0.3e-3;
/// Gap from which on a pair is far, m.
const FAR_M: f64 = 0.05;
/// Distance from the edge within which a part is carried only where its target is, m: a rim that the shaken plate does
/// not carry cannot be seen.
const EDGE_M: f64 = 5e-3;
/// Passes over all pairs.
const PASSES: usize = 30;
/// Largest speed per distance left, 1/s: a part is seen, and its next motion planned, a segment and a half before.
const APPROACH_PER_S: f64 = 8.0;
/// Periods from the beginning of a segment to the middle of the stretch in which its drift is judged.
pub(super) const AHEAD: f64 = 1.5;
/// Change of speed that is asked of a part, relative to that which the last motions made.
const AMBITION: f64 = 2.0;
/// Share of full friction with which motions carry parts: at first, and its bounds.
const SHARE: f64 = 0.1;
const SHARES: (f64, f64) = (0.05, 0.5);
/// The share grows where less than the first share of what is asked is left, and falls where more than the second is.
const LITTLE_LEFT: f64 = 0.35;
const MUCH_LEFT: f64 = 0.6;
const GROWS: f64 = 1.12;
const FALLS: f64 = 0.93;

/// Where a part is heading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Heading {
    /// The place where it should come to rest, m, or where it should be [`super::MovingPlanner::ahead_s`] after the
    /// segment begins.
    pub target_m: Vec2,
    /// The next place on its way there that keeps it clear of others, m.
    pub subgoal_m: Vec2,
    /// Velocity with which it passes its target, m/s; `None` where it comes to rest.
    pub along_mps: Option<Vec2>,
}

/// A part on the plate, moving.
#[derive(Clone, Copy, Debug)]
pub(super) struct MovingPart {
    pub disc: RolloutDisc,
    /// Mean velocity over the last period, m/s.
    pub drift_mps: Vec2,
    /// Where it is heading, m, and the length of its way from there on, m.
    pub target_m: Vec2,
    pub beyond_m: f64,
    /// Velocity with which it should pass there; `None` where it should come to rest.
    pub along_mps: Option<Vec2>,
}

impl MovingPart {
    /// Distance of its rim from the edge of the plate at rest that it should keep, m: more than the edge moves inwards,
    /// unless its target is nearer.
    pub fn edge_margin_m(&self, params: &PlannerParams) -> f64 {
        let at_target_m = params.half_side_m - self.disc.radius_m - self.target_m.amax();
        at_target_m.clamp(params.edge_margin_m, params.edge_margin_m.max(EDGE_M))
    }

    pub fn left_m(&self) -> Vec2 {
        self.target_m - self.disc.position_m
    }
}

/// The strength with which motions have carried parts so far.
#[derive(Clone, Copy, Debug)]
pub(super) struct Aims {
    /// Share of full friction.
    share: f64,
}

impl Default for Aims {
    fn default() -> Self {
        Self { share: SHARE }
    }
}

/// The wish for the drifts at the end of the next segment: `drift + rate · place = aim` for each part.
#[derive(Clone, Debug, Default)]
pub(super) struct Wish {
    pub rates: Vec<f64>,
    pub aims_mps: Vec<Vec2>,
    /// Change of each part's drift, m/s.
    pub changes_mps: Vec<Vec2>,
    /// True where a part is asked for less than it wants.
    pub is_clipped: bool,
}

impl Wish {
    /// The share of what is asked that `residual` leaves.
    pub fn left(&self, residual: &DVector<f64>) -> f64 {
        let asked_mps = self.changes_mps.iter().map(|change| change.norm_squared()).sum::<f64>().sqrt();
        residual.norm() / asked_mps.max(f64::MIN_POSITIVE)
    }
}

impl Aims {
    /// Drifts for `parts` at the beginning of a segment.
    pub fn wish(&self, parts: &[MovingPart], params: &PlannerParams, period_s: f64) -> Wish {
        let ahead_s = AHEAD * period_s;
        let ahead_m: Vec<Vec2> = parts.iter().map(|p| p.disc.position_m + p.drift_mps * ahead_s).collect();
        let pull_mps2 = |part: &MovingPart| self.share * part.disc.friction * GRAVITY_MPS2;
        // common to all, so that they arrive together: straight ways in step hardly cross
        let brake_mps2 = parts.iter().map(pull_mps2).sum::<f64>() / parts.len() as f64;
        let of_places = |length_m: &dyn Fn(&MovingPart) -> f64| {
            rms(parts.iter().filter(|part| part.along_mps.is_none()).map(length_m))
        };
        let left_m = of_places(&|part| part.left_m().norm());
        let way_m = of_places(&|part| part.left_m().norm() + part.beyond_m);
        let to_places = APPROACH_PER_S.min((2.0 * brake_mps2 * way_m).sqrt() / left_m.max(f64::MIN_POSITIVE));
        let rate_of = |part: &MovingPart| if part.along_mps.is_some() { APPROACH_PER_S } else { to_places };
        let wanted = |(part, at_m): (&MovingPart, &Vec2)| {
            (part.target_m - at_m) * rate_of(part) + part.along_mps.unwrap_or_default()
        };
        let mut wanted_mps: Vec<Vec2> = parts.iter().zip(&ahead_m).map(wanted).collect();
        keep_clear(parts, params, &ahead_m, &mut wanted_mps);
        let mut wish = Wish::default();
        for ((part, at_m), wanted_mps) in parts.iter().zip(&ahead_m).zip(&wanted_mps) {
            let most_mps = AMBITION * pull_mps2(part) * ahead_s;
            let change_mps = wanted_mps - part.drift_mps;
            let share = (most_mps / change_mps.norm().max(f64::MIN_POSITIVE)).min(1.0);
            let change_mps = change_mps * share;
            wish.is_clipped |= share < 1.0;
            let rate = rate_of(part) * share;
            wish.rates.push(rate);
            wish.aims_mps.push(part.drift_mps + change_mps + at_m * rate);
            wish.changes_mps.push(change_mps);
        }
        wish
    }

    /// Learns from a segment that leaves this share of what was asked.
    pub fn learn(&mut self, is_clipped: bool, left: f64) {
        let factor = match left {
            _ if left < LITTLE_LEFT => GROWS,
            _ if left > MUCH_LEFT && is_clipped => FALLS,
            _ => 1.0,
        };
        self.share = (factor * self.share).clamp(SHARES.0, SHARES.1);
    }
}

/// Root mean square; 0 of none.
pub(super) fn rms(of: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = of.fold((0.0, 0), |(sum, count), x| (sum + x * x, count + 1));
    (sum / f64::from(count.max(1))).sqrt()
}

/// Changes `velocities_mps` of parts at `places_m` until none closes a gap, beyond the one to keep, faster than
/// [`CLOSING_PER_S`] times that gap.
fn keep_clear(parts: &[MovingPart], params: &PlannerParams, places_m: &[Vec2], velocities_mps: &mut [Vec2]) {
    for _ in 0..PASSES {
        for i in 0..parts.len() {
            for j in 0..i {
                let apart_m = places_m[i] - places_m[j];
                let radii_m = parts[i].disc.radius_m + parts[j].disc.radius_m;
                let gap_m = apart_m.norm() - radii_m;
                let Some(normal) = apart_m.try_normalize(0.0).filter(|_| gap_m < FAR_M) else { continue };
                let closing_mps = -normal.dot(&(velocities_mps[i] - velocities_mps[j]));
                let at_targets_m = (parts[i].target_m - parts[j].target_m).norm() - radii_m - params.separation_m;
                let comes_to_rest = parts[i].along_mps.is_none() && parts[j].along_mps.is_none();
                let spare_m = if comes_to_rest { at_targets_m.clamp(0.0, SPARE_M) } else { SPARE_M };
                let excess_mps = closing_mps - CLOSING_PER_S * (gap_m - params.separation_m - spare_m);
                if excess_mps > 0.0 {
                    velocities_mps[i] += normal * (0.5 * excess_mps);
                    velocities_mps[j] -= normal * (0.5 * excess_mps);
                }
            }
            let bound_m = params.half_side_m - parts[i].disc.radius_m - parts[i].edge_margin_m(params) - SPARE_M;
            for axis in 0..2 {
                let most_mps = CLOSING_PER_S * (bound_m - places_m[i][axis].abs());
                let outwards = if places_m[i][axis] > 0.0 { 1.0 } else { -1.0 };
                velocities_mps[i][axis] = outwards * (outwards * velocities_mps[i][axis]).min(most_mps);
            }
        }
    }
}
