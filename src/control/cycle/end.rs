//! The end of a run: its limits, the confirmation of a reached goal, and lost parts.

use super::ControlCycle;
use crate::run_end::{OrEnd, RunEnd};
use upm_core::geometry::Vec2;
use upm_core::job::Finding;

/// How often the goal may seem reached without a second observation confirming it.
const MOST_UNCONFIRMED: u32 = 5;

impl ControlCycle<'_, '_> {
    pub(super) fn check_limits(&mut self) -> OrEnd {
        self.check_stop()?;
        let limit_s = self.params.time_limit_s;
        if self.io.rig.now().secs() >= limit_s && self.params.guards.has(Finding::TimeLimit) {
            let reason = format!("plate time limit of {limit_s} s reached");
            return Err(if !self.params.endless {
                RunEnd::failed_because(Finding::TimeLimit, reason)
            } else if self.makes_progress() {
                self.confirmed(RunEnd::completed(reason))
            } else {
                RunEnd::failed_because(Finding::NoProgress, format!("{reason} without progress"))
            });
        }
        Ok(())
    }

    pub(super) fn makes_progress(&self) -> bool {
        self.watch.makes_progress() || !self.params.guards.has(Finding::NoProgress)
    }

    /// Returns `ending` of a task without an end if two more observations, with the table located anew, agree with the
    /// tracking.
    fn confirmed(&mut self, ending: RunEnd) -> RunEnd {
        match self.perception.confirm(self.io) {
            Ok(true) => ending,
            Ok(false) => RunEnd::failed_because(
                Finding::CameraMoved,
                format!("{}, and the confirming observations disagreed with what was tracked", ending.reason),
            ),
            Err(other) => other,
        }
    }

    /// Ends the run as completed if two more observations, with the table located anew, confirm the goal of its last
    /// task; otherwise the run goes on, with the next task where there is one, from the positions these observations
    /// show.
    pub(super) fn finish(&mut self, reason: String) -> OrEnd<Vec<Vec2>> {
        self.check_limits()?;
        if self.perception.confirm(self.io)? {
            // motion of parts while the plate swings out counts, too
            let (at, places_m) = (self.perception.seen_at(), self.perception.positions_m());
            if self.task.next(at, &places_m).done {
                return if self.task.go_on(&places_m) { Ok(places_m) } else { Err(RunEnd::completed(reason)) };
            }
        }
        self.unconfirmed += 1;
        if self.unconfirmed > MOST_UNCONFIRMED {
            let reason = format!("the goal was reached {MOST_UNCONFIRMED} times, but later observations disagreed");
            return Err(RunEnd::failed_because(Finding::CameraMoved, reason));
        }
        self.observe_at_rest()
    }

    pub(super) fn is_part_lost(&self) -> bool {
        self.perception.frames_missing_in_clear_view() > self.params.lost_after_frames
    }

    pub(super) fn check_lost(&self) -> OrEnd {
        if !self.is_part_lost() || !self.params.guards.has(Finding::PartLost) {
            return Ok(());
        }
        let places = self.perception.positions_m();
        let each = self.perception.missing_parts().into_iter().map(|part| {
            let id = self.params.id(part);
            let place = places.get(part).copied().unwrap_or_default() * 1e3;
            format!("{id} is lost, last seen at ({:.1}, {:.1}) mm", place.x, place.y)
        });
        Err(RunEnd::failed_because(Finding::PartLost, each.collect::<Vec<_>>().join("; ")))
    }
}
