//! Repeated localisation of table and parts: after a knock, and before a task counts as completed.

use super::naming::match_parts;
use super::settling::{Displacement, PlateInImage, SWING_S};
use super::{FramePurpose, Perception, TABLE_OBSERVATIONS};
use crate::run_end::{OrEnd, RunEnd, check_stop};
use crate::{ConfirmedFacts, LocalisedFacts, RunIo, Sink};
use upm_core::geometry::Vec2;
use upm_core::job::Finding;
use upm_core::time::Clock;
use upm_perception::vision::{CoinFinder, Detection, Table, Tracker, locate_table};

/// Allowed change of the distances between corners where the table is located anew: px, plus this share of the corners'
/// displacement.
const SHAPE_PX: f64 = 0.5;
const SHAPE_OF_WAY: f64 = 0.02;
/// Consecutive observations at rest that must show the plate elsewhere: a swing of 5 Hz goes from end to end in this
/// time.
const MOVED: u32 = 6;
/// Number of observations with the table located anew before a task counts as completed.
const CONFIRMING_LOOKS: usize = 2;
/// Number of consecutive observations at a still plate before these, and the displacement of a corner up to which the
/// plate has swung out, px.
const STILL_LOOKS: usize = 2;
const STILL_PX: f64 = 0.25;
/// Largest differences of corners and parts between such observations.
const SAME_CORNER_PX: f64 = 0.7;
const SAME_PART_M: f64 = 0.2e-3;

/// Table and parts of one frame, located without prior knowledge.
pub(super) struct Relocated {
    table: Table,
    found: Vec<Detection>,
    localise_us: f64,
}

/// True when the corners of `table` are as far apart as those of `before`. Knocks of camera or plate preserve these
/// distances up to perspective; a hand at a corner does not.
fn has_shape_of(table: &Table, before: &Table) -> bool {
    let moved = table.corners_px.iter().zip(&before.corners_px).map(|(now, before)| (now - before).norm());
    let allowed_px = SHAPE_PX + SHAPE_OF_WAY * moved.fold(0.0, f64::max);
    let pairs = (0..4).flat_map(|a| (0..a).map(move |b| [a, b]));
    let apart_px = |of: &Table, [a, b]: [usize; 2]| (of.corners_px[a] - of.corners_px[b]).norm();
    pairs.into_iter().all(|pair| (apart_px(table, pair) - apart_px(before, pair)).abs() < allowed_px)
}

impl Perception {
    /// Table and parts of the newest frame, located without prior knowledge; otherwise the reason for the failure.
    fn locate(&self, clock: &dyn Clock) -> Result<Relocated, String> {
        let started = clock.elapsed();
        let table =
            locate_table(&self.frame, &self.model.lens, self.table.side_m).map_err(|fault| fault.to_string())?;
        if !has_shape_of(&table, &self.table) && self.guards.has(Finding::TableMissing) {
            return Err(
                "it has another shape than before: something hides part of it, or the picture is mirrored".to_owned()
            );
        }
        let size = [self.frame.width, self.frame.height];
        let mut finder = CoinFinder::new(&table, size, &self.scene.kinds, self.model.dark_parts);
        let found = finder.find(&self.frame);
        let localise_us = (clock.elapsed() - started).as_secs_f64() * 1e6;
        Ok(Relocated { table, found, localise_us })
    }

    /// Reports a plate that moves about another place than the table's; true where there is one.
    pub(crate) fn sees_knock(&mut self, sink: &mut dyn Sink) -> bool {
        let Some(corner_px) = self.delay.knocked_px() else { return false };
        self.note_knock(corner_px, sink);
        true
    }

    fn note_knock(&mut self, corner_px: f64, sink: &mut dyn Sink) -> String {
        self.displaced.is_noted = true;
        let by = if corner_px.is_finite() { format!("by {corner_px:.1} px") } else { "by more than 6 px".to_owned() };
        let reason = format!("the plate has moved in the picture {by}; it is located anew");
        self.findings.note(self.frame.exposed_at, Finding::CameraMoved, reason, sink);
        by
    }

    /// Locates table and parts anew once the plate has been seen elsewhere for long enough.
    pub(super) fn settle_place(&mut self, place: &PlateInImage, io: &mut RunIo<'_>) -> OrEnd {
        let corner_px = match *place {
            PlateInImage::Elsewhere { corner_px } => corner_px,
            PlateInImage::SwungOut => return self.locate_swung_out(io),
            PlateInImage::Same | PlateInImage::Swinging | PlateInImage::Unknown => {
                self.displaced = Displacement::default();
                return Ok(());
            }
        };
        if self.delay.looks_late() && self.guards.has(Finding::CameraLate) {
            // late pictures show a plate at rest as still swinging
            return Ok(());
        }
        self.displaced.observe(corner_px);
        if self.displaced.observations < MOVED {
            return Ok(());
        }
        let by = self.note_knock(corner_px, io.sink);
        match self.locate(io.clock) {
            Ok(found) => self.relocate(found, true, io.sink),
            Err(fault) if self.displaced.observations > MOVED + TABLE_OBSERVATIONS as u32 => {
                Err(RunEnd::failed_because(
                    Finding::CameraMoved,
                    format!("the plate has moved in the picture {by}: {fault}"),
                ))
            }
            Err(_) => Ok(()),
        }
    }

    /// Locates table and parts once more when the plate has swung out from the knock that caused the last localisation.
    fn locate_swung_out(&mut self, io: &mut RunIo<'_>) -> OrEnd {
        self.displaced.observations = 0;
        match self.locate(io.clock) {
            Ok(found) => self.relocate(found, false, io.sink),
            Err(_) => Ok(()),
        }
    }

    /// Continues with a table that was located anew, on a plate that may still swing where it `swings`.
    fn relocate(&mut self, located: Relocated, swings: bool, sink: &mut dyn Sink) -> OrEnd {
        let Relocated { table, found, localise_us } = located;
        let count = found.len();
        let mut before: Vec<Detection> = self.tracker.tracks().iter().map(|track| track.seen.clone()).collect();
        for (part, (expected_m, _)) in before.iter_mut().zip(&self.expected_m) {
            part.position_m = *expected_m;
        }
        let Some((detections, _)) = match_parts(found, &before) else {
            let expected = before.len();
            let reason =
                format!("the plate has moved in the picture, and {count} parts are seen instead of {expected}");
            return Err(RunEnd::failed_because(Finding::CameraMoved, reason));
        };
        let ways = detections.iter().zip(&self.expected_m);
        let off_m =
            |(part, (expected_m, reach_m)): (&Detection, &(Vec2, f64))| (part.position_m - expected_m).norm() - reach_m;
        let too_far_m = ways.map(off_m).fold(0.0, f64::max);
        if too_far_m > 0.0 && self.guards.has(Finding::PartsJumped) {
            let reason = format!(
                "the plate has moved in the picture, and a part is {:.1} mm farther from its last position than it can \
                 have moved",
                too_far_m * 1e3
            );
            return Err(RunEnd::failed_because(Finding::PartsJumped, reason));
        }
        let frame = &self.frame;
        sink.localised(&LocalisedFacts { frame, table: &table, detections: &detections, localise_us });
        self.scene.relocate(&table, frame, swings);
        let size = [frame.width, frame.height];
        self.tracker = Tracker::new(&table, size, &self.scene.kinds, self.model.dark_parts, detections);
        self.table = table;
        self.displaced = Displacement::default();
        self.relocated |= swings;
        self.delay.forget_seen();
        Ok(())
    }

    /// Takes two more observations with table and parts located without prior knowledge; true when both agree with the
    /// tracking. Where they do not, the new localisation replaces the tracked one.
    ///
    /// # Errors
    /// As [`Perception::observe`].
    pub fn confirm(&mut self, io: &mut RunIo<'_>) -> OrEnd<bool> {
        if !self.let_swing_out(io)? {
            return Ok(false);
        }
        for _ in 0..CONFIRMING_LOOKS {
            let located = self.locate_at_rest(io)?;
            let corners = located.table.corners_px.iter().zip(&self.table.corners_px);
            let off_px = corners.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
            let tracked: Vec<Detection> = self.tracker.tracks().iter().map(|track| track.seen.clone()).collect();
            let same = match_parts(located.found.clone(), &tracked).filter(|(_, off_m)| *off_m < SAME_PART_M);
            if let Some((parts, part_m)) = same.filter(|_| off_px < SAME_CORNER_PX) {
                let parts_m: Vec<Vec2> = parts.iter().map(|part| part.position_m).collect();
                let at = self.frame.exposed_at;
                io.sink.confirmed(&ConfirmedFacts { at, corner_px: off_px, part_m, parts_m: &parts_m });
            } else {
                let reason = format!("table and parts located anew differ, the corners by {off_px:.1} px");
                self.findings.note(self.frame.exposed_at, Finding::CameraMoved, reason, io.sink);
                self.relocate(located, true, io.sink)?;
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Waits until plate and parts are still in the picture, for at most the time a plate that was not knocked takes;
    /// false where parts glide on.
    fn let_swing_out(&mut self, io: &mut RunIo<'_>) -> OrEnd<bool> {
        let until = io.rig.settled_at().max(self.frame.exposed_at) + SWING_S;
        // a swinging plate passes its rest position for a moment
        let (mut still, mut glide) = (0, false);
        while io.rig.now() < until && still < STILL_LOOKS {
            check_stop(io.stop)?;
            let before_m = self.positions_m();
            self.observe(io, FramePurpose::Pulse)?;
            glide = before_m.iter().zip(self.positions_m()).any(|(before, now)| (now - before).norm() > SAME_PART_M);
            // it no longer swings and was not knocked
            let is_still = !glide && self.corner_px().is_some_and(|px| px < STILL_PX);
            still = if is_still { still + 1 } else { 0 };
        }
        Ok(!glide)
    }

    fn locate_at_rest(&mut self, io: &mut RunIo<'_>) -> OrEnd<Relocated> {
        let mut last = None;
        for _ in 0..TABLE_OBSERVATIONS {
            while !self.observe(io, FramePurpose::Pulse)? {
                check_stop(io.stop)?;
            }
            match self.locate(io.clock) {
                Ok(located) => return Ok(located),
                Err(fault) => last = Some(fault),
            }
        }
        let why = last.map_or_else(String::new, |fault| format!(": {fault}"));
        let reason = format!("no table found in {TABLE_OBSERVATIONS} frames{why}");
        Err(self.end_by(Finding::TableMissing, reason, io.sink))
    }
}
