//! Checks of a frame beyond the parts' positions: whether it is of the present, whether the plate is visible, whether
//! it is where it was, and whether a foreign object is on it.

use nalgebra::Vector3;

use super::settling::{PlateInImage, Settling};
use crate::guards::{Freshness, Unusable};
use upm_core::geometry::Vec2;
use upm_core::job::Finding;
use upm_core::rig::{PartKind, RigModel};
use upm_core::signal::Frame;
use upm_core::time::PlateTime;
use upm_perception::vision::{PlateWatch, Table, TableMotion, TableWatch, Track};

/// Durations after which a run ends, s: of stale frames, of frames without a plate, and of a hand in view.
const STALE_S: f64 = 2.0;
const DARK_S: f64 = 5.0;
pub(super) const HAND_S: f64 = 10.0;
/// Hidden share of the plate below which it counts as in view.
const HIDDEN: f64 = 0.02;
/// The same while the plate moves and shows its ground at the sides.
const COVERED: f64 = 0.06;

/// Time for which a run waits for usable frames, s.
pub(super) fn longest_s(finding: Finding) -> f64 {
    match finding {
        Finding::CameraDark => DARK_S,
        Finding::ViewHidden => HAND_S,
        _ => STALE_S,
    }
}

/// Obstruction of the view in a frame that shows no plate, or a plate of which part is hidden.
fn obstruction(is_dark: bool, is_hidden: bool) -> Option<Unusable> {
    match (is_dark, is_hidden) {
        (true, _) => Some((Finding::CameraDark, "the camera's frames show no plate".into())),
        (false, true) => Some((Finding::ViewHidden, "part of the plate is hidden from the camera".into())),
        (false, false) => None,
    }
}

/// Monitors everything in the scene that should not change.
pub(super) struct SceneMonitor {
    pub(super) freshness: Freshness,
    table: TableWatch,
    plate: PlateWatch,
    pub(super) kinds: Vec<PartKind>,
    dark_parts: bool,
    /// Place of an object that does not belong to the job in the newest frame at rest, m.
    pub(super) foreign_m: Option<Vec2>,
    settling: Settling,
}

impl SceneMonitor {
    /// A monitor of what `first` shows, which arrived at `now` and in which `table` was located; later frames are
    /// compared with it.
    pub(super) fn new(table: &Table, model: &RigModel, kinds: &[PartKind], first: &Frame, now: PlateTime) -> Self {
        let mut monitor = Self {
            freshness: Freshness::new(model.frame_hz, model.exposure_s),
            table: TableWatch::new(table, model.frame_size_px),
            plate: PlateWatch::new(table, model.frame_size_px, kinds, model.dark_parts),
            kinds: kinds.to_vec(),
            dark_parts: model.dark_parts,
            foreign_m: None,
            settling: Settling::default(),
        };
        monitor.freshness.check(first, now, (None, 0.0));
        monitor.table.set_rest(first);
        monitor
    }

    /// View and place of the plate in a frame taken at rest, in which `tracks` were followed.
    pub(super) fn examine(&mut self, frame: &Frame, tracks: &[Track]) -> (Option<Unusable>, PlateInImage) {
        let place = self.settling.place(frame.exposed_at, self.table.check(frame));
        if place == PlateInImage::SwungOut {
            self.table.set_rest(frame);
        }
        if let PlateInImage::Elsewhere { .. } = place {
            // objects on a plate that has moved are detected once it is located anew
            self.foreign_m = None;
            return (None, place);
        }
        let sight = self.plate.check(frame, tracks);
        // a hand is visible; where nothing hides the plate and its sides are gone, the picture shows no plate
        let is_hidden = sight.hidden_share > HIDDEN;
        let is_dark = sight.dark || (place == PlateInImage::Unknown && !is_hidden);
        self.foreign_m = sight.foreign_m.first().copied();
        (obstruction(is_dark, is_hidden), place)
    }

    /// Obstruction of the view in a frame in which the plate has swung by `swing_px` or, where that is not known, may
    /// move; `None` when the camera was knocked.
    pub(super) fn covered(
        &mut self,
        frame: &Frame,
        tracks: &[Track],
        swing_px: Option<Vector3<f64>>,
    ) -> Option<Unusable> {
        self.foreign_m = None;
        if swing_px.is_none() && self.table.check(frame) == TableMotion::Displaced {
            // the camera was knocked: foreign objects are detected once the plate is at rest
            return None;
        }
        let sight = self.plate.check_swung(frame, tracks, swing_px.unwrap_or_default());
        self.foreign_m = sight.foreign_m.first().copied().filter(|_| swing_px.is_some());
        obstruction(sight.dark, sight.hidden_share > COVERED)
    }

    /// Motion of the plate in the picture since the table was located.
    pub(super) fn table_motion(&self, frame: &Frame) -> TableMotion {
        self.table.check(frame)
    }

    /// Swing of a plate that is near one of `swings_px`, px.
    pub(super) fn swing_near(&self, frame: &Frame, swings_px: &[Vector3<f64>]) -> Option<Vector3<f64>> {
        self.table.swing_near(frame, swings_px)
    }

    /// Takes over the table that was located anew in `frame`, on a plate that may swing.
    pub(super) fn relocate(&mut self, table: &Table, frame: &Frame, swings: bool) {
        self.table = TableWatch::new(table, [frame.width, frame.height]);
        self.settling.relocate(frame.exposed_at, swings);
        if !swings {
            self.table.set_rest(frame);
        }
        self.forget_plate(table, frame);
    }

    /// Forgets the plate's appearance and learns it again from `frame`.
    pub(super) fn forget_plate(&mut self, table: &Table, frame: &Frame) {
        self.plate = PlateWatch::new(table, [frame.width, frame.height], &self.kinds, self.dark_parts);
    }
}
