//! Checks of a frame beyond the parts' positions: whether it is of the present, whether the plate is visible, whether
//! it is where it was, and whether a foreign object is on it.

use crate::condition::Condition;
use crate::guards::{Freshness, Stale};
use upm_core::geometry::Vec2;
use upm_core::rig::{PartKind, RigModel};
use upm_core::signal::Frame;
use upm_core::time::PlateTime;
use upm_perception::vision::{PlateWatch, Table, TableMotion, TableWatch, Track};

/// Largest displacements of a corner and of the plate as a whole that are attributed to the swing after a pulse, px.
/// Frames at rest with larger ones start no cycle.
const SWING_CORNER_PX: f64 = 0.95;
const SWING_SHIFT_PX: f64 = 0.7;
/// The same for a corner once the plate has swung out.
const STILL_PX: f64 = 0.25;
/// Shift between two looks from which on the plate still swings, px, and the time without one after which it has swung
/// out, s: half of the slowest swing.
const SWINGS_PX: f64 = 0.1;
const STILL_S: f64 = 0.12;
/// Time in which a plate swings out, s.
pub(super) const SWING_S: f64 = 0.4;
/// Durations after which a run ends, s: of stale frames, of frames without a plate, and of a hand in view.
const STALE_S: f64 = 2.0;
const DARK_S: f64 = 5.0;
pub(super) const HAND_S: f64 = 10.0;
/// Hidden share of the plate below which it counts as in view.
const HIDDEN: f64 = 0.02;
/// The same while the plate moves and shows its ground at the sides.
const COVERED: f64 = 0.06;

/// Reason for which a frame is unusable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Blind {
    /// The frame is not of the present.
    Stale(Stale),
    /// The frame shows no plate.
    Dark,
    /// Something hides part of the plate.
    Hidden,
}

impl Blind {
    /// The condition to report.
    pub(super) fn condition(self) -> Condition {
        match self {
            Self::Stale(Stale::Repeated) => Condition::CameraFrozen,
            Self::Stale(Stale::Stamp { .. }) => Condition::CameraStale,
            Self::Dark => Condition::CameraDark,
            Self::Hidden => Condition::ViewHidden,
        }
    }

    /// Time for which a run waits for it to end, s.
    pub(super) fn longest_s(self) -> f64 {
        match self {
            Self::Stale(_) => STALE_S,
            Self::Dark => DARK_S,
            Self::Hidden => HAND_S,
        }
    }

    /// The reason for people.
    pub(super) fn reason(self) -> String {
        match self {
            Self::Stale(Stale::Repeated) => "the camera sends the same picture again".into(),
            Self::Stale(Stale::Stamp { older_s }) => {
                format!("a frame's number or stamp does not fit: it is {:.0} ms old", older_s * 1e3)
            }
            Self::Dark => "the camera's frames show no plate".into(),
            Self::Hidden => "part of the plate is hidden from the camera".into(),
        }
    }
}

/// The plate's place in the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Place {
    /// The place where it was.
    Same,
    /// The same place, but it may still swing: it was elsewhere a moment ago, or was knocked before the table was
    /// located.
    Swinging,
    /// The same place, and it no longer swings: the table can be located as accurately as at first.
    SwungOut,
    /// Elsewhere, by this much at a corner, px; infinite where the displacement is unknown.
    Elsewhere {
        /// Displacement, px.
        corner_px: f64,
    },
    /// The frame does not show it.
    Unknown,
}

/// Findings in a frame at rest.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    pub(super) blind: Option<Blind>,
    pub(super) place: Place,
    /// Place of an object that does not belong to the job, m.
    pub(super) foreign_m: Option<Vec2>,
}

/// Monitors everything in the scene that should not change.
pub(super) struct Scene {
    freshness: Freshness,
    table: TableWatch,
    plate: PlateWatch,
    foreign_m: Option<Vec2>,
    /// Time from which the plate will have swung out and can be measured, after a table was located anew.
    rest_from: Option<PlateTime>,
    /// Time by which a plate that was seen elsewhere at rest has swung through its rest position and back.
    settled_from: PlateTime,
    /// Shift of the plate since the table was located, as of the last look, px.
    shift_px: Vec2,
}

impl Scene {
    pub(super) fn new(table: &Table, model: &RigModel, kinds: &[PartKind]) -> Self {
        Self {
            freshness: Freshness::new(model.frame_hz, model.exposure_s),
            table: TableWatch::new(table, model.frame_size_px),
            plate: PlateWatch::new(table, model.frame_size_px, kinds, model.dark_parts),
            foreign_m: None,
            rest_from: None,
            settled_from: PlateTime::default(),
            shift_px: Vec2::zeros(),
        }
    }

    /// The first frame, in which the table was located; later frames are compared with it.
    pub(super) fn see_first(&mut self, frame: &Frame, now: PlateTime) {
        self.freshness.check(frame, now);
        self.table.set_rest(frame);
    }

    /// True once a frame has differed from the first.
    pub(super) fn has_changed(&self) -> bool {
        self.freshness.has_changed()
    }

    /// The reason for which `frame`, which arrived at `now`, is not of the present; `None` for one that is.
    pub(super) fn stale(&mut self, frame: &Frame, now: PlateTime) -> Option<Blind> {
        self.freshness.check(frame, now).map(Blind::Stale)
    }

    /// Examines a frame taken at rest, in which `tracks` were followed.
    pub(super) fn examine(&mut self, frame: &Frame, tracks: &[Track]) -> Seen {
        let motion = self.table.check(frame);
        let place = match motion {
            TableMotion::Seen { corner_px, shift_px, .. }
                if corner_px < SWING_CORNER_PX && shift_px.norm() < SWING_SHIFT_PX =>
            {
                self.settle(frame, shift_px)
            }
            TableMotion::Seen { corner_px, .. } => Place::Elsewhere { corner_px },
            TableMotion::Displaced => Place::Elsewhere { corner_px: f64::INFINITY },
            TableMotion::Hidden => Place::Unknown,
        };
        if let Place::Elsewhere { .. } = place {
            // objects on a plate that has moved are detected once it is located anew
            self.foreign_m = None;
            self.settled_from = frame.exposed_at + STILL_S;
            return Seen { blind: None, place, foreign_m: None };
        }
        let sight = self.plate.check(frame, tracks);
        // a hand is visible; where nothing hides the plate and its sides are gone, the picture shows no plate
        let is_hidden = sight.hidden_share > HIDDEN;
        let is_dark = sight.dark || (place == Place::Unknown && !is_hidden);
        let blind = if is_dark { Some(Blind::Dark) } else { is_hidden.then_some(Blind::Hidden) };
        self.foreign_m = sight.foreign.first().map(|part| part.position_m);
        Seen { blind, place, foreign_m: self.foreign_m }
    }

    /// Obstruction of the view in a frame in which the plate may move; `None` when the camera was knocked.
    pub(super) fn covered(&mut self, frame: &Frame, tracks: &[Track]) -> Option<Blind> {
        if self.table.check(frame) == TableMotion::Displaced {
            // the camera was knocked: foreign objects are detected once the plate is at rest
            return None;
        }
        let sight = self.plate.check(frame, tracks);
        if sight.dark { Some(Blind::Dark) } else { (sight.hidden_share > COVERED).then_some(Blind::Hidden) }
    }

    /// The place of a plate that is seen where it should be, shifted by `shift_px`.
    fn settle(&mut self, frame: &Frame, shift_px: Vec2) -> Place {
        let since_last_px = (shift_px - std::mem::replace(&mut self.shift_px, shift_px)).norm();
        if since_last_px > SWINGS_PX {
            // pushed again, or the swing was a long one
            self.rest_from = self.rest_from.map(|from| from.max(frame.exposed_at + STILL_S));
        }
        match self.rest_from {
            Some(from) if frame.exposed_at < from => Place::Swinging,
            Some(_) => {
                self.table.set_rest(frame);
                self.rest_from = None;
                Place::SwungOut
            }
            None if frame.exposed_at < self.settled_from => Place::Swinging,
            None => Place::Same,
        }
    }

    /// True when the plate is where it was to a fraction of a pixel: it no longer swings and was not knocked.
    pub(super) fn is_still(&self, frame: &Frame) -> bool {
        self.table.check(frame).corner_px().is_some_and(|corner_px| corner_px < STILL_PX)
    }

    /// Largest displacement of the plate's corners since the table was located, px; `None` where it is not visible.
    pub(super) fn swing_px(&self, frame: &Frame) -> Option<f64> {
        self.table.check(frame).corner_px()
    }

    /// Place of a foreign object in the newest frame, m.
    pub(super) fn foreign_m(&self) -> Option<Vec2> {
        self.foreign_m
    }

    /// Takes over the table that was located anew in `frame`, on a plate that may swing.
    pub(super) fn relocate(
        &mut self,
        table: &Table,
        frame: &Frame,
        swings: bool,
        kinds: &[PartKind],
        dark_parts: bool,
    ) {
        self.table = TableWatch::new(table, [frame.width, frame.height]);
        self.rest_from = swings.then_some(frame.exposed_at + SWING_S);
        self.settled_from = PlateTime::default();
        if !swings {
            self.table.set_rest(frame);
        }
        self.forget_plate(table, frame, kinds, dark_parts);
    }

    /// Forgets the plate's appearance and learns it again from `frame`.
    pub(super) fn forget_plate(&mut self, table: &Table, frame: &Frame, kinds: &[PartKind], dark_parts: bool) {
        self.plate = PlateWatch::new(table, [frame.width, frame.height], kinds, dark_parts);
    }
}
