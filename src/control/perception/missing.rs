//! Frames of the present that show the plate without a part.

/// Number of frames that must lack a part before frames that never arrived count, too.
const LEAST_OBSERVATIONS: u32 = 5;

/// How long parts have been missing in frames that show the plate.
#[derive(Default)]
pub(super) struct MissingParts {
    /// Number of consecutive frames that show a part off the plate.
    pub(super) off_plate: u32,
    /// Number of frames that lacked a part, those that never arrived included.
    with_absent: f64,
    /// Number of those that did arrive.
    arrived: u32,
}

impl MissingParts {
    /// A frame shows all parts.
    pub(super) fn clear(&mut self) {
        (self.with_absent, self.arrived) = (0.0, 0);
    }

    /// A frame lacks a part, and came `frames` after the last one.
    pub(super) fn count(&mut self, frames: f64) {
        (self.with_absent, self.arrived) = (self.with_absent + frames.max(0.0), self.arrived + 1);
    }

    /// Number of frames that lacked a part.
    pub(super) fn frames(&self) -> u32 {
        if self.arrived < LEAST_OBSERVATIONS { self.arrived } else { self.with_absent.round() as u32 }
    }
}
