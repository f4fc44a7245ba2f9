//! Whether a plate that is seen at rest is where it was, and whether it still swings.

use nalgebra::Vector3;

use upm_core::geometry::Vec2;
use upm_core::time::PlateTime;
use upm_perception::vision::TableMotion;

/// Largest displacements of a corner and of the plate as a whole that are attributed to the swing after a pulse, px.
/// Frames at rest with larger ones start no cycle.
const SWING_CORNER_PX: f64 = 0.95;
const SWING_SHIFT_PX: f64 = 0.7;
/// Shift between two observations from which on the plate still swings, px, and the time without one after which it has
/// swung out, s: half of the slowest swing.
const SWINGS_PX: f64 = 0.1;
const STILL_S: f64 = 0.12;
/// The same from one frame to the next for a plate that swings on after a pulse that was cut short: six deviations of a
/// difference by a camera's noise.
const SWINGS_ON_PX: f64 = 0.4;
/// Largest difference between observations that show the same displacement of a corner, px.
const SAME_PLACE_PX: f64 = 0.3;
/// Time in which a plate swings out, s, and the longest time that it may swing on after a pulse that was cut short.
pub(super) const SWING_S: f64 = 0.4;
const LONGEST_SWING_S: f64 = 2.0;

/// The plate's place in the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum PlateInImage {
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

/// Time at which a plate whose pulse was cut short has swung out.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SwingOut {
    /// Expected time.
    pub(super) from: PlateTime,
    /// Latest such time.
    by: PlateTime,
    /// Swing in the last frame, px.
    last_px: Option<Vector3<f64>>,
}

impl SwingOut {
    /// That of a pulse which was cut short at `now`.
    pub(super) fn after_stop_at(now: PlateTime) -> Self {
        Self { from: now + SWING_S, by: now + LONGEST_SWING_S, last_px: None }
    }

    /// Takes the plate's swing in a frame exposed at `at`: one that was knocked rests elsewhere.
    pub(super) fn observe(&mut self, at: PlateTime, swing_px: Option<Vector3<f64>>) {
        let last_px = std::mem::replace(&mut self.last_px, swing_px);
        if swing_px.zip(last_px).is_some_and(|(now_px, last_px)| (now_px - last_px).norm() > SWINGS_ON_PX) {
            self.from = self.from.max((at + STILL_S).min(self.by));
        }
    }
}

/// Consecutive observations at rest that show the plate elsewhere.
#[derive(Default)]
pub(super) struct Displacement {
    /// Their number.
    pub(super) observations: u32,
    /// Displacement of a corner in the first of them, px.
    corner_px: f64,
    /// True once the knock is reported: parts are missing because the picture is another one.
    pub(super) is_noted: bool,
}

impl Displacement {
    /// Takes an observation with a corner displaced by `corner_px`. A plate that still swings in the picture is soon
    /// elsewhere.
    pub(super) fn observe(&mut self, corner_px: f64) {
        if (corner_px - self.corner_px).abs() < SAME_PLACE_PX || corner_px == self.corner_px {
            self.observations += 1;
        } else {
            *self = Self { observations: 1, corner_px, ..*self };
        }
    }
}

/// Follows the swing of a plate over the frames at rest.
#[derive(Clone, Debug, Default)]
pub(super) struct Settling {
    /// Time from which the plate will have swung out and can be measured, after a table was located anew.
    rest_from: Option<PlateTime>,
    /// Time by which a plate that was seen elsewhere at rest has swung through its rest position and back.
    settled_from: PlateTime,
    /// Shift of the plate since the table was located, as of the last observation, px.
    shift_px: Vec2,
}

impl Settling {
    /// Takes the plate's motion in a frame at rest that was exposed at `at`.
    pub(super) fn place(&mut self, at: PlateTime, motion: TableMotion) -> PlateInImage {
        let corner_px = match motion {
            TableMotion::Seen { corner_px, swing_px }
                if corner_px < SWING_CORNER_PX && swing_px.xy().norm() < SWING_SHIFT_PX =>
            {
                return self.near(at, swing_px.xy());
            }
            TableMotion::Seen { corner_px, .. } => corner_px,
            TableMotion::Displaced => f64::INFINITY,
            TableMotion::Hidden => return PlateInImage::Unknown,
        };
        self.settled_from = at + STILL_S;
        PlateInImage::Elsewhere { corner_px }
    }

    /// The place of a plate that is seen where it should be, shifted by `shift_px`.
    fn near(&mut self, at: PlateTime, shift_px: Vec2) -> PlateInImage {
        let since_last_px = (shift_px - std::mem::replace(&mut self.shift_px, shift_px)).norm();
        if since_last_px > SWINGS_PX {
            // pushed again, or the swing was a long one
            self.rest_from = self.rest_from.map(|from| from.max(at + STILL_S));
        }
        match self.rest_from {
            Some(from) if at < from => PlateInImage::Swinging,
            Some(_) => {
                self.rest_from = None;
                PlateInImage::SwungOut
            }
            None if at < self.settled_from => PlateInImage::Swinging,
            None => PlateInImage::Same,
        }
    }

    /// The table was located anew at `at`, on a plate that may swing.
    pub(super) fn relocate(&mut self, at: PlateTime, swings: bool) {
        self.rest_from = swings.then_some(at + SWING_S);
        self.settled_from = PlateTime::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME_S: f64 = 1.0 / 60.0;

    fn at(frame: u32) -> PlateTime {
        PlateTime::from_secs(f64::from(frame) * FRAME_S)
    }

    /// The corners displaced by a turn, the plate as a whole by a shift, px.
    fn seen(turn_px: f64, shift_px: f64) -> TableMotion {
        let corner_px = turn_px.abs() + shift_px;
        TableMotion::Seen { swing_px: Vector3::new(shift_px, 0.0, turn_px), corner_px }
    }

    #[test]
    fn plate_that_swings_back_from_elsewhere_is_relied_on_after_half_of_the_slowest_swing() {
        let mut settling = Settling::default();
        assert_eq!(settling.place(at(0), seen(0.1, 0.1)), PlateInImage::Same);
        // a turned camera: the plate swings through where it was, and rests elsewhere
        let swings: Vec<PlateInImage> =
            (1..).zip([2.9, 1.1, 0.5, 0.4]).map(|(i, px)| settling.place(at(i), seen(px, 0.0))).collect();
        assert!(matches!(swings[..2], [PlateInImage::Elsewhere { .. }, PlateInImage::Elsewhere { .. }]), "{swings:?}");
        assert_eq!(swings[2..], [PlateInImage::Swinging; 2]);
        assert_eq!(settling.place(at(9), seen(0.2, 0.0)), PlateInImage::Swinging);
        assert_eq!(settling.place(at(10), seen(0.2, 0.0)), PlateInImage::Same);
    }

    #[test]
    fn plate_located_while_it_swings_is_located_once_more_when_it_has_swung_out() {
        let mut settling = Settling::default();
        settling.relocate(at(0), true);
        assert_eq!(settling.place(at(20), seen(0.0, 0.05)), PlateInImage::Swinging);
        // a shift from one observation to the next: it still swings
        assert_eq!(settling.place(at(24), seen(0.0, 0.2)), PlateInImage::Swinging);
        assert_eq!(settling.place(at(33), seen(0.0, 0.2)), PlateInImage::SwungOut);
        assert_eq!(settling.place(at(34), seen(0.0, 0.2)), PlateInImage::Same);
        settling.relocate(at(40), false);
        assert_eq!(settling.place(at(41), seen(0.0, 0.0)), PlateInImage::Same);
    }

    #[test]
    fn hidden_plate_is_unknown_and_displaced_plate_is_off_by_an_unknown_amount() {
        let mut settling = Settling::default();
        assert_eq!(settling.place(at(0), TableMotion::Hidden), PlateInImage::Unknown);
        assert_eq!(settling.place(at(1), TableMotion::Displaced), PlateInImage::Elsewhere { corner_px: f64::INFINITY });
        assert_eq!(settling.place(at(2), seen(0.0, 0.8)), PlateInImage::Elsewhere { corner_px: 0.8 });
    }
}
