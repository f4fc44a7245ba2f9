use upm_core::geometry::{Polyline, Vec2};

/// Distance beyond a corridor at which a part still counts as inside, m: three times what the camera scatters.
pub(crate) const UNSEEN_M: f64 = 0.01e-3;

/// A line that a part follows, and the largest distance from it: a limit on the whole course of every pulse.
#[derive(Clone, Debug, PartialEq)]
pub struct Corridor {
    /// The line, from behind the part to beyond its subgoal.
    pub line: Polyline,
    /// Largest distance from the line, m.
    pub half_width_m: f64,
}

impl Corridor {
    /// Vector from the nearest point of the line to `p_m`, m.
    pub(crate) fn off(&self, p_m: Vec2) -> Vec2 {
        p_m - self.line.at(self.line.nearest(p_m, 0.0, self.line.length_m()).0)
    }
}
