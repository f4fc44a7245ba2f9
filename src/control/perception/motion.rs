//! Expected effect of a pulse in the camera's frames: the parts' displacement and the plate's swing.

use nalgebra::Vector3;

use super::{Perception, REACH_M};
use crate::Sink;
use crate::guards::{PlateSwing, Unusable, corner_px};
use crate::run_end::OrEnd;
use upm_core::geometry::Vec2;
use upm_core::job::Finding;
use upm_core::time::PlateTime;
use upm_perception::vision::TableMotion;

/// Additional tolerance for a part's place after a pulse, as a share of its forecast displacement.
const REACH_OF_WAY: f64 = 0.7;
/// Distance beyond the tolerance, m, from which on the detection is another disc: not even a hand pushes a part that
/// far from one observation to the next.
const LEAP_M: f64 = 0.04;

impl Perception {
    /// Announces a pulse at `at` that should carry the parts to `forecast_m` and swing the plate by `swing`; `None`
    /// where the library gives no forecast.
    pub(crate) fn expect_pulse(&mut self, at: PlateTime, forecast_m: Option<&[Vec2]>, swing: Option<PlateSwing>) {
        self.expect_places(forecast_m.unwrap_or_default());
        if let Some(swing) = swing {
            self.delay.begin(at.secs(), swing);
        }
        (self.motors_stopped, self.relocated) = (false, false);
    }

    /// The parts are next seen at rest at `forecast_m`.
    pub(crate) fn expect_places(&mut self, forecast_m: &[Vec2]) {
        let reach_m = |from: &Vec2, to: &Vec2| REACH_M + REACH_OF_WAY * (to - from).norm();
        let places_m = self.positions_m();
        self.expected_m = places_m.iter().zip(forecast_m).map(|(from, to)| (*to, reach_m(from, to))).collect();
    }

    /// The present pulse was cut short: the parts are next seen at rest anywhere on their way.
    pub(super) fn expect_less(&mut self) {
        let places_m = self.positions_m();
        for ((expected_m, reach_m), place_m) in self.expected_m.iter_mut().zip(places_m) {
            *reach_m += (*expected_m - place_m).norm();
        }
    }

    /// True once a frame has differed from the first.
    pub fn has_changed(&self) -> bool {
        self.scene.freshness.changed
    }

    /// Reason for which the newest frame, which arrived at `now` and shows the corners `seen_px` from their places, is
    /// not of the present; `None` for a frame of the present.
    pub(super) fn stale(&mut self, now: PlateTime, seen_px: Option<f64>) -> Option<Unusable> {
        let expected_px = corner_px(self.delay.expected_px(self.frame.exposed_at.secs()));
        let stale = self.scene.freshness.check(&self.frame, now, (seen_px, expected_px));
        stale.filter(|(finding, _)| self.guards.has(*finding))
    }

    /// The plate's swing in the newest frame, px, which shows this motion from where the table was located: near there,
    /// or where it may be.
    pub(super) fn swing_px(&self, motion: TableMotion) -> Option<Vector3<f64>> {
        let possible_px = || self.delay.possible_px(self.frame.exposed_at.secs());
        motion.swing_px().or_else(|| self.scene.swing_near(&self.frame, &possible_px()))
    }

    /// Obstruction of the view while the plate moves and has swung by `swing_px`, or, where that is not known, in a
    /// frame that lacks a part.
    pub(super) fn covered(&mut self, swing_px: Option<Vector3<f64>>) -> Option<Unusable> {
        if swing_px.is_none() && self.frames_missing() == 0 {
            return None;
        }
        let covered = self.scene.covered(&self.frame, self.tracker.tracks(), swing_px);
        let covered = covered.filter(|(finding, _)| self.guards.has(*finding));
        self.count_foreign(covered.is_none());
        covered
    }

    /// Ends the run when most parts are farther away than the last pulse carries them: the picture is another one.
    pub(super) fn check_jumps(&mut self, sink: &mut dyn Sink) -> OrEnd {
        let places_m = self.positions_m();
        let beyond = |by_m: f64| {
            let parts = places_m.iter().zip(&self.expected_m);
            parts.filter(|(at_m, (expected_m, reach_m))| (*at_m - expected_m).norm() > reach_m + by_m).count()
        };
        let far = beyond(0.0);
        let are_many = far >= 2 && 2 * far > places_m.len();
        if !(are_many || beyond(LEAP_M) > 0) || !self.guards.has(Finding::PartsJumped) {
            return Ok(());
        }
        let reason = format!("{far} of {} parts lie where the last pulse cannot have carried them", places_m.len());
        Err(self.end_by(Finding::PartsJumped, reason, sink))
    }
}
